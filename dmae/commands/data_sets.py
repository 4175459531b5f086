"""What commands share that turn clips into clips: a data set at both ends, or a single clip."""

import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TypeVar

from dmae.commands.unfinished import begin_run, end_run
from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.store import MANIFEST, read_manifest, write_manifest
from dmae.files.checksums import (
    RECORD,
    Checksum,
    begin_data_set,
    clip_checksum,
    end_data_set,
    number_of,
    write_checksums,
)
from dmae.formats.reading import Clips, DataConfig, is_data_set, load
from dmae.parts import PART, Part, write_part
from dmae.progress import progress
from dmae.reconstruction.sides import exchanged_detections
from dmae.reporting.tables import counted

T = TypeVar("T")
_FEW_EXCHANGES = 0.02
"""Share of frames with exchanged sides below which a camera is not named."""
_GENERATED = "config.json"
"""In the folder of generated data sets alone."""
_NOT_OF_PARTS = ("out", "first", "clips", "shard", "workers", "backend", "dry_run")
"""Options in which the parts of one result may differ."""


def each_clip(data: DataConfig, out: Path, doing: str) -> Iterator[tuple[Clip, str, Path]]:
    """Each clip that `data=` names, the name of its folder, and the folder in `out` that its result goes to."""
    clips, several = load(data), is_data_set(data)
    for clip, folder in progress(zip(clips, clips.folders, strict=True), doing, len(clips)):
        yield clip, folder.name, out / folder.name if several else out


def part_of(command: str, config, clips: Clips, numbers: range) -> Part | None:
    """Return what `part.json` says of a result for some of the clips of a data set; None for one of all of them.

    Args:
        command: As "dmae capture".
        config: Its configuration, with `data`.
        clips: All clips of the data set.
        numbers: Of the clips of the result.
    """
    if len(numbers) == len(clips):
        return None
    options = {name: value for name, value in asdict(config).items() if name not in _NOT_OF_PARTS}
    data = number_of(Path(config.data.path)) or Path(config.data.path).resolve().name
    return Part(command, json.loads(json.dumps(options)), data, len(clips), numbers.start, numbers.stop)


class Manifest:
    """The manifest and the checksums of a data set that is being written; of a single clip there are none.

    They are written on leaving, after errors as well, so that the clips that are whole are a data set. Before the first
    clip is written, an earlier manifest, its checksums and its `config.yaml` are removed. A command that is killed then
    leaves no data set, instead of one with clips of two runs. Clips of an earlier run that this one does not make are
    removed once all others are written; until then they are shown as foreign.

    Args:
        out: Folder of the data set, or of the clip.
        several: Whether it is a data set.
        part: Which part of a larger one it is; None for a whole one.
        sealed: Whether clips are in our own format, and so get checksums.
        settings: What the clips depend on (`settings_of`), if an interrupted run can continue; otherwise None.
    """

    def __init__(
        self, out: Path, several: bool, part: Part | None = None, *, sealed: bool = True, settings: dict | None = None
    ):
        self.out, self.several, self.part, self.sealed = Path(out), several, part, several and sealed
        self.settings = settings if several else None
        self.lines: list[dict] = []
        self.checksums: dict[str, Checksum | None] = {}
        self.earlier: list[str] = []

    def write(self, name: str, write: Callable[[], T], **facts) -> T:
        """Write a clip, and note it as whole."""
        if not self.lines:
            self._begin()
        written = write()
        if self.sealed:
            write_checksums(self.out / name)
            self.checksums[name] = clip_checksum(self.out / name)
        self.lines.append({"id": name, "status": "ok", **facts})
        return written

    def keep(self, name: str, **facts) -> None:
        """Note a clip as whole that an interrupted run of the same settings has written (`whole_clips`)."""
        if not self.lines:
            self._begin()
        self.checksums[name] = clip_checksum(self.out / name)
        self.lines.append({"id": name, "status": "ok", **facts})

    def _begin(self) -> None:
        if (self.out / _GENERATED).is_file():
            raise ValueError(
                f"out={self.out}: holds a data set that synth generate made; choose another folder for out"
            )
        if self.several and (self.out / MANIFEST).is_file():
            try:
                self.earlier = [line["id"] for line in read_manifest(self.out)]
            except ValueError:
                self.earlier = []
        begin_data_set(self.out)
        for earlier in (MANIFEST, PART, RECORD):
            (self.out / earlier).unlink(missing_ok=True)
        if self.settings is not None:
            begin_run(self.out, self.settings)

    def __enter__(self) -> "Manifest":
        return self

    def __exit__(self, error: type[BaseException] | None = None, *_) -> None:
        if not (self.several and self.lines):
            return
        if error is None:
            for name in {*self.earlier} - {line["id"] for line in self.lines}:
                if (self.out / name / "clip.json").is_file():
                    shutil.rmtree(self.out / name)
            write_part(self.out, self.part)
        write_manifest(self.out, self.lines)
        if self.sealed:
            end_data_set(self.out, (PART,), self.checksums)
        if error is None and self.settings is not None:
            end_run(self.out)


def finished(out: Path) -> str:
    """Which clips of a data set a command that was interrupted has written to a folder."""
    whole = len(list(Path(out).glob("*/clip.json")))
    if (Path(out) / MANIFEST).is_file():
        return f"{out}: {counted(len(read_manifest(out)), 'whole clip')}, which can be used"
    return f"nothing in {out} is to be used" if whole else "nothing was written"


def describe_sides(clip: Clip, poses: Poses3D) -> list[str]:
    """Say in which cameras the detector exchanged left and right, by poses captured from the clip."""
    if poses.skeleton != clip.detections.skeleton:
        return []
    counts = exchanged_detections(clip, poses).sum(0)
    least = max(_FEW_EXCHANGES * len(clip), 2)
    return [
        f"camera {name}: its detections have left and right exchanged in {count} of {len(clip)} frames"
        for name, count in zip(clip.rig.names, counts, strict=True)
        if count >= least
    ]


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
        f"person is not present: with them {(poses.source == Source.ABSENT).mean():.1%} of all joints are NaN"
    )
