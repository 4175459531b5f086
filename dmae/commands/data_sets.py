"""What commands share that turn clips into clips: a data set at both ends, or a single clip."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.store import CHECKSUMS, MANIFEST, write_manifest
from dmae.formats.reading import DataConfig, is_data_set, load
from dmae.progress import progress

T = TypeVar("T")


def each_clip(data: DataConfig, out: Path, doing: str) -> Iterator[tuple[Clip, str, Path]]:
    """Each clip that `data=` names, the name of its folder, and the folder in `out` that its result goes to."""
    clips, several = load(data), is_data_set(data)
    for clip, folder in progress(zip(clips, clips.folders, strict=True), doing, len(clips)):
        yield clip, folder.name, out / folder.name if several else out


class Manifest:
    """The manifest of a data set that is being written; of a single clip there is none.

    It is written on leaving, after errors as well, so that the clips that are whole are a data set. Before the first
    clip is written, an earlier manifest and its `config.yaml` are removed. A command that is killed then leaves no
    data set, instead of one with clips of two runs.
    """

    def __init__(self, out: Path, several: bool):
        self.out, self.several, self.lines = out, several, []

    def write(self, name: str, write: Callable[[], T], **facts) -> T:
        """Write a clip, and note it as whole."""
        if not self.lines:
            for earlier in (MANIFEST, CHECKSUMS, "config.yaml"):
                (self.out / earlier).unlink(missing_ok=True)
        written = write()
        self.lines.append({"id": name, "status": "ok", **facts})
        return written

    def __enter__(self) -> "Manifest":
        return self

    def __exit__(self, *_) -> None:
        if self.several and self.lines:
            write_manifest(self.out, self.lines)


def finished(out: Path) -> str:
    """Which clips of a data set a command that was interrupted has written to a folder."""
    whole = len(list(Path(out).glob("*/clip.json")))
    if (Path(out) / MANIFEST).is_file():
        return f"{whole} clips in {out} are whole and can be used"
    return f"nothing in {out} is to be used" if whole else "nothing was written"


def describe_joints(poses: Poses3D) -> str:
    """How much of the joints was measured and completed, and how many joints are NaN because a person is not there.

    A "person-frame" is a person in a frame. Where no joint is known there, the person is not there; the shares of
    joints are of the other person-frames.
    """
    present = (poses.source != Source.ABSENT).any(-1)
    if not present.any():
        return "no person captured"
    known = poses.source[present]
    completed, absent = (known == Source.COMPLETED).mean(), (known == Source.ABSENT).mean()
    shares = f"joints {1 - completed - absent:.1%} measured, {completed:.1%} completed, {absent:.1%} absent"
    away = int((~present).sum())
    if not away:
        return shares
    return (
        f"{shares}; not counting {away} of {present.size} person-frames ({away / present.size:.1%}) in which the "
        f"person is not there: with them {(poses.source == Source.ABSENT).mean():.1%} of all joints are NaN"
    )
