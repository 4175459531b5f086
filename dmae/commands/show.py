"""`dmae show`: any clip as contact sheet, video and Rerun recording."""

from dataclasses import replace
from pathlib import Path

from dmae.commands.data_sets import each_clip
from dmae.viewing.config import ShowConfig
from dmae.viewing.overlay import chosen_layers
from dmae.viewing.show import Rooms, of_cameras, show_clip


def run(config: ShowConfig, out: Path, rooms: Rooms | None = None) -> None:
    """Draw clips. Print what each clip lacks, and the files that were written.

    `rooms` draws the room of a clip without images; by default a grid on the floor is drawn.
    """
    for clip, _, folder in each_clip(config.data, out, "drawing"):
        for note in clip.provenance.get("notes", ()):
            print(f"{clip.id}: {note}")
        clip = of_cameras(clip.without_lost_images(), config.cameras)
        lacking, backdrop = chosen_layers(clip, config.layers).lacking, None
        if lacking:
            print(f"clip {clip.id}: no {', no '.join(lacking)}")
        if rooms and not clip.has_images:
            try:
                backdrop = rooms(clip)
            except (ValueError, OSError) as error:
                print(f"only the floor of the room is drawn: {error}")
        print(*show_clip(clip, folder, replace(config, cameras=[]), backdrop), sep="\n")
