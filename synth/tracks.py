"""People in motion, joint by joint, from recorded takes and from clips alike."""

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

import numpy as np

from dmae.clip import Poses3D
from dmae.data import DataConfig, Format, load
from dmae.mapping import convert
from dmae.progress import progress
from dmae.skeleton import BODY25
from synth.body import Body
from synth.landmarks import SKELETON
from synth.motion.cmu import subject_and_trial
from synth.motion.source import Up, cut, read_take
from synth.plan import fit
from synth.simulate import reference_joints

_SUFFIXES = (".amc", ".bvh", ".npz", ".c3d")
"""Of takes; where there is one in several formats, the first of these counts."""
_PERFORMER = Body(1.70)
"""Takes are put on a body of average proportions: joints of their own lie elsewhere in every format."""


@dataclass(frozen=True)
class ReadingConfig:
    """How takes are read whose files do not say, or say wrongly; as in `synth.motion.source.MotionConfig`."""

    fps: float | None = None
    unit: float | None = None
    up: Up = Up.auto
    mapping: str | None = None


@dataclass(frozen=True)
class Track:
    """One person in motion.

    Attributes:
        name: For people to read.
        fps: Frames per second.
        xyz: (F, 25, 3) joints of `BODY25`, m, world, floor at z = 0; NaN where unknown.
    """

    name: str
    fps: float
    xyz: np.ndarray

    @property
    def seconds(self) -> float:
        """For how long anything is known of the person."""
        return float((~np.isnan(self.xyz).all((1, 2))).sum() / self.fps)


def take_tracks(
    path: Path, fps: float, names: Sequence[str] = ("*",), reading: ReadingConfig | None = None
) -> tuple[list[Track], list[str]]:
    """Recorded takes as the generator would have them, but for its paths: on the floor, on one body, at one rate.

    Limbs point where their files have them. Where on a limb a joint lies, and where nose, ears and toes are, is told by
    the body, as it is of simulated people.

    Args:
        path: A file, or a folder with files at any depth.
        fps: Frames per second.
        names: Only takes whose file names without suffix are like one of these, `*` and `?` standing for anything.
        reading: As their files say, if left out.

    Returns:
        The takes, and what was left out since it is one of them in another format, for people to read.

    Raises:
        FileNotFoundError: no takes there.
        ValueError: none is called so, or as `read_take`.
    """
    reading = reading or ReadingConfig()
    found = sorted(path.rglob("*")) if path.is_dir() else [path]
    files = [file for file in found if file.suffix.lower() in _SUFFIXES and file.is_file()]
    if not files:
        raise FileNotFoundError(f"{path}: expected takes ({', '.join(_SUFFIXES)}) or clips, found neither")
    chosen = [file for file in files if any(fnmatch(file.stem, name) for name in names)]
    if not chosen:
        there = ", ".join(sorted({file.stem for file in files}))
        raise ValueError(f"{path}: no take is called {' or '.join(names)}; there are {there}")
    firsts: dict[tuple[int, int], Path] = {}
    kept, again = [], []
    for file in sorted(chosen, key=lambda file: _SUFFIXES.index(file.suffix.lower())):
        take = subject_and_trial(file.stem)
        first = firsts.setdefault(take, file) if any(take) else file
        # Conversions of a take do not lie beside it.
        if first.parent == file.parent:
            kept.append(file)
        else:
            again.append(f"{file.relative_to(path)} is {first.relative_to(path)}")
    tracks = []
    for file in progress(sorted(kept), "reading takes"):
        take = read_take(file, reading.fps, unit=reading.unit, up=reading.up, mapping=reading.mapping)
        motion = fit(cut(take, start=0, seconds=len(take) / take.fps, fps=fps), _PERFORMER)
        joints = reference_joints(_PERFORMER, motion.root, motion.rotations)
        tracks.append(Track(take.name, fps, _on_body25(Poses3D(SKELETON, joints[:, None]))[:, 0]))
    return tracks, again


def clip_tracks(path: Path, *, captured: bool) -> list[Track]:
    """Everybody in a clip, or in the clips of a data set.

    Args:
        path: Of the clip or the data set.
        captured: Whether to take what was captured of those clips of which something was, rather than their truth.

    Raises:
        FileNotFoundError: no clips there.
        ValueError: nobody is in them, or a clip has no such poses, or another frame rate than the first.
    """
    clips = load(DataConfig(Format.clip, str(path)))
    tracks: list[Track] = []
    for folder, clip in progress(zip(clips.folders, clips, strict=True), "reading clips", len(clips)):
        poses = clip.poses if captured and clip.poses is not None else clip.truth
        if poses is None:
            wanted = "poses (dmae capture makes them) or a truth" if captured else "a truth, as simulated clips have it"
            raise ValueError(f"{folder}: expected {wanted}, found none")
        if tracks and clip.fps != tracks[0].fps:
            raise ValueError(f"{folder}: expected {tracks[0].fps:g} frames a second as before, found {clip.fps:g}")
        xyz = _on_body25(poses)
        tracks += [Track(f"{folder.name}, person {p}", clip.fps, xyz[:, p]) for p in range(xyz.shape[1])]
    if not tracks:
        raise ValueError(f"{path}: expected people in its clips, found {len(clips)} clips and nobody")
    return tracks


def _on_body25(poses: Poses3D) -> np.ndarray:
    """(F, P, 25, 3)"""
    return convert(poses, BODY25).xyz
