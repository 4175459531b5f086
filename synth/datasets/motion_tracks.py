"""Read the tracks of moving people from recorded takes or from clips."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip, Poses3D
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25
from dmae.formats.reading import DataConfig, load
from dmae.progress import progress
from synth.motion.body_fit import fit_to_body
from synth.motion.readers import format_of, reader, take_name
from synth.motion.readers.cmu import subject_and_trial
from synth.motion.source import UpAxis, cut, read_take
from synth.people.body import Body
from synth.people.landmarks import SKELETON
from synth.physics.joint_positions import reference_joints

_FORMATS = sorted(reader, key=lambda name: (reader[name].markers, name))
"""Formats of takes, with joints before markers. If a take exists in several formats, the first of them is used."""
_PERFORMER = Body(1.70)
"""A body with average proportions. Takes are fitted to it, because every format places its joints differently."""


@dataclass(frozen=True)
class ReadingConfig:
    """Overrides for takes with missing or wrong values in their files; as in `synth.motion.source.MotionConfig`."""

    fps: float | None = None
    """Frames per second, where the files state a wrong one."""
    unit: float | None = None
    """Metres per unit of length in the files, if the length of the legs does not determine it."""
    up: UpAxis = UpAxis.auto
    """Axis of the files' world that points up."""
    mapping: str | None = None
    """YAML file of lines `their name: our name` for joints or markers with other names."""


@dataclass(frozen=True)
class Track:
    """The motion of one person.

    Attributes:
        name: Name for messages and tables.
        fps: Frames per second.
        xyz: (F, 25, 3) joints of `BODY25`, m, world, floor at z = 0; NaN where unknown.
    """

    name: str
    fps: float
    xyz: np.ndarray

    @property
    def seconds(self) -> float:
        """The duration for which any joint of the person is known, s."""
        return float((~np.isnan(self.xyz).all((1, 2))).sum() / self.fps)


def take_tracks(
    path: Path, fps: float, names: Sequence[str] = ("*",), reading: ReadingConfig | None = None
) -> tuple[list[Track], list[str]]:
    """Read recorded takes in the same way as the generator: on the floor, on one body, at one frame rate.

    The directions of limbs come from the files. The body determines the positions of joints on limbs, and of nose, ears
    and toes, as for simulated people.

    Args:
        path: A file, or a folder with files at any depth.
        fps: Frames per second.
        names: Patterns of file names without suffix; `*` and `?` match anything.
        reading: Overrides of values in the files.

    Returns:
        tracks: One track per take.
        repeated: Descriptions of files that are left out because they contain one of the takes in another format.

    Raises:
        FileNotFoundError: there are no takes at the path.
        ValueError: no take matches the patterns, or a file is malformed.
    """
    reading = reading or ReadingConfig()
    found = sorted(path.rglob("*")) if path.is_dir() else [path]
    files = [file for file in found if format_of(file) and file.is_file()]
    if not files:
        raise FileNotFoundError(
            f"{path}: expected takes ({', '.join(f'.{name}' for name in _FORMATS)}) or clips, found neither"
        )
    chosen = [file for file in files if any(fnmatch(take_name(file), name) for name in names)]
    if not chosen:
        there = ", ".join(sorted({take_name(file) for file in files}))
        raise ValueError(f"{path}: no take is called {' or '.join(names)}; there are {there}")
    firsts: dict[tuple[int, int], Path] = {}
    kept, again = [], []
    for file in sorted(chosen, key=lambda file: _FORMATS.index(format_of(file))):
        take = subject_and_trial(take_name(file))
        first = firsts.setdefault(take, file) if any(take) else file
        # Files of the same take in the same folder are all kept. Conversions of a take are in other folders.
        if first.parent == file.parent:
            kept.append(file)
        else:
            again.append(f"{file.relative_to(path)} is {first.relative_to(path)}")
    tracks = []
    for file in progress(sorted(kept), "reading takes"):
        take = read_take(file, reading.fps, unit=reading.unit, up=reading.up, mapping=reading.mapping)
        motion = fit_to_body(cut(take, start=0, seconds=len(take) / take.fps, fps=fps), _PERFORMER)
        joints = reference_joints(_PERFORMER, motion.root, motion.rotations)
        tracks.append(Track(take.name, fps, _on_body25(Poses3D(SKELETON, joints[:, None]))[:, 0]))
    return tracks, again


def clip_tracks(path: Path, *, captured: bool) -> list[Track]:
    """Read the track of every person of a clip, or of the clips of a data set.

    Args:
        path: Folder of the clip or the data set.
        captured: Whether to prefer the captured poses of clips that have them to the truth.

    Raises:
        FileNotFoundError: there are no clips at the path.
        ValueError: the clips have no persons, or a clip has no such poses or another frame rate than the first clip.
    """
    clips = load(DataConfig("clip", str(path)))
    named = zip(map(str, clips.folders), clips, strict=True)
    return tracks_of(progress(named, "reading clips", len(clips)), captured=captured)


def tracks_of(clips: Iterable[tuple[str, Clip]], *, captured: bool) -> list[Track]:
    """Return the track of every person of clips.

    Args:
        clips: Pairs of a name and a clip.
        captured: Whether to prefer the captured poses of clips that have them to the truth.

    Raises:
        ValueError: the same cases as in `clip_tracks`.
    """
    tracks: list[Track] = []
    names = []
    for name, clip in clips:
        names.append(name)
        poses = clip.poses if captured and clip.poses is not None else clip.truth
        if poses is None:
            wanted = "poses (dmae capture makes them) or a truth" if captured else "a truth, as in simulated clips"
            raise ValueError(f"{name}: expected {wanted}, found none")
        if tracks and clip.fps != tracks[0].fps:
            raise ValueError(f"{name}: expected {tracks[0].fps:g} frames a second as before, found {clip.fps:g}")
        xyz = _on_body25(poses)
        tracks += [Track(f"{Path(name).name}, person {p}", clip.fps, xyz[:, p]) for p in range(xyz.shape[1])]
    if not tracks:
        raise ValueError(f"expected people in the clips, found {len(names)} clips without people")
    return tracks


def same_rate(recorded: Sequence[Track], simulated: Sequence[Track], real: str, sim: str) -> None:
    """Raise ValueError if recorded tracks of `real` and simulated tracks of `sim` have different frame rates."""
    rates = recorded[0].fps, simulated[0].fps
    if rates[0] != rates[1]:
        raise ValueError(
            f"expected one frame rate, found {rates[0]:g} a second in {real} and {rates[1]:g} in {sim}; simulate with "
            f"scene.fps={rates[0]:g}"
        )


def _on_body25(poses: Poses3D) -> np.ndarray:
    """Return (F, P, 25, 3) joints of BODY25, m, world."""
    return convert(poses, BODY25).xyz
