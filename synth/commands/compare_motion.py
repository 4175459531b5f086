"""`synth compare-motion`: compare the motion of recorded people with that of generated people."""

import io
import json
from dataclasses import dataclass, field
from pathlib import Path

from dmae.data.rng import Stream, generator
from dmae.data.store import MANIFEST
from dmae.files.contents import write_atomic
from dmae.reporting.tables import print_tables
from synth.datasets.motion_comparison import (
    MIN_SECONDS,
    ReadingConfig,
    clip_tracks,
    compare,
    draw,
    largest_differences,
    measure,
    numbers,
    same_rate,
    table,
    take_tracks,
    write_page,
)

WRITES = "folder"
EXAMPLES = (
    "synth compare-motion real=takes sim=runs/data out=runs/compare_motion",
    "synth compare-motion real=takes sim=runs/data takes=[kick*,punch*] longest=5",
)


@dataclass(frozen=True)
class CompareMotionCommand:
    """Compare recorded with generated motion: `motion.html`, `motion.png` and `motion.json`."""

    real: str = "???"
    """A take (BVH, ASF/AMC, AMASS-style npz, C3D) or a folder with takes at any depth; or a clip or data set of clips:
    the captured poses of each clip, or its truth if nothing was captured."""
    sim: str = "???"
    """A simulated clip or data set of clips; the truth is used."""
    takes: list[str] = field(default_factory=lambda: ["*"])
    """Only takes with a file name (without suffix) that matches one of these; `*` and `?` are wildcards."""
    longest: float = 10.0
    """s; longest part of a take, or of a person of a clip, that is used."""
    motion: ReadingConfig = field(default_factory=ReadingConfig)
    out: str = "runs/compare_motion"
    """Folder of the page, the figure and the numbers."""

    def __post_init__(self):
        if not self.longest >= MIN_SECONDS:
            raise ValueError(f"longest={self.longest}: expected {MIN_SECONDS} s or more")


def run(config: CompareMotionCommand, out: Path) -> None:
    """Print and draw the differences, and write `motion.html`, `motion.png` and `motion.json`.

    Raises:
        FileNotFoundError, ValueError: there are no takes or clips, or none can be measured; the message says which.
    """
    path, left_out = Path(config.real), []
    if not path.exists():
        raise FileNotFoundError(f"real={path}: no such file or folder")
    simulated = clip_tracks(Path(config.sim), captured=False)
    if (path / "clip.json").is_file() or (path / MANIFEST).is_file():
        recorded = clip_tracks(path, captured=True)
    else:
        recorded, left_out = take_tracks(path, simulated[0].fps, config.takes, config.motion)
    same_rate(recorded, simulated, config.real, config.sim)
    short = [track for track in recorded + simulated if track.seconds < MIN_SECONDS]
    left_out += [f"{track.name}, of {track.seconds:.2f} s" for track in short]
    real, sim = (measure(tracks, config.longest) for tracks in (recorded, simulated))
    differences = compare(real, sim, rng=generator(0, 0, Stream.VALIDATION))
    figure, image = draw(real, sim, differences), io.BytesIO()
    figure.savefig(image, format="png", dpi=110)
    write_atomic(out / "motion.png", image.getvalue())
    write_atomic(out / "motion.json", json.dumps(numbers(real, sim, differences, left_out), indent=1))
    write_page(out / "motion.html", real, sim, differences, figure, left_out)
    print_tables([table(differences)])
    for line in left_out:
        print(f"left out: {line}")
    print(largest_differences(differences))
    print(out / "motion.html")
