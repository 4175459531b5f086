"""`synth show`: a clip as contact sheet, video and Rerun recording."""

from dataclasses import dataclass, field
from importlib import util
from pathlib import Path

from dmae.data.clip import Clip
from dmae.data.store import load_clip
from synth.viewing.show import draw_rooms, has_images, write_overlay_video, write_sheet

WRITES = "folder"
EXAMPLES = (
    "synth show clip=runs/data/000000 out=runs/show",
    "synth show clip=runs/data/000000 frames=8 views=[0,2] width=640",
)


@dataclass(frozen=True)
class ShowCommand:
    """Draw a clip: `sheet.png`, `clip.mp4` and, where rerun-sdk is installed, `clip.rrd`."""

    clip: str = "???"
    """Folder of a simulated clip."""
    out: str = "runs/show"
    """Folder of the pictures."""
    frames: int = 4
    """How many the sheet shows, evenly spread over the clip."""
    views: list[str] = field(default_factory=list)
    """Names of the cameras; none for all."""
    width: int = 480
    """px; of a view."""

    def __post_init__(self):
        for name, least in (("frames", 1), ("width", 160)):
            if getattr(self, name) < least:
                raise ValueError(f"{name}: expected {least} or more, got {getattr(self, name)}")


def run(config: ShowCommand, out: Path) -> None:
    clip, rooms = _chosen(load_clip(Path(config.clip)), config), None
    if not has_images(clip):
        try:
            rooms = draw_rooms(clip)
        except (ValueError, OSError) as error:
            print(f"only the floor of the room is drawn: {error}")
    write_sheet(clip, out / "sheet.png", rows=config.frames, width=config.width, rooms=rooms)
    print(out / "sheet.png")
    write_overlay_video(clip, out / "clip.mp4", width=config.width, rooms=rooms)
    print(out / "clip.mp4")
    if util.find_spec("rerun") is None:
        print("no recording for the Rerun viewer: rerun-sdk is not installed (pip install 'dmae-synth[viz]' adds it)")
        return
    from synth.viewing.rerun import write_recording

    write_recording(clip, out / "clip.rrd")
    print(out / "clip.rrd")


def _chosen(clip: Clip, config: ShowCommand) -> Clip:
    unknown = sorted(set(config.views) - set(clip.rig.names))
    if unknown:
        raise ValueError(f"views: {config.clip} has no camera {unknown}; it has {list(clip.rig.names)}")
    return clip.select(views=[clip.rig.names.index(name) for name in config.views]) if config.views else clip
