"""Motion for a clip: which take or recipe, which stretch of it, and where on the floor."""

from dataclasses import dataclass, field, replace
from enum import Enum
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from synth.motion import Motion
from synth.motion.agenda import ACTIONS
from synth.motion.amc import read_amc
from synth.motion.bvh import read_bvh
from synth.motion.c3d import read_c3d
from synth.motion.cmu import true_fps
from synth.motion.dialects import known_joints
from synth.motion.mapping import read_mapping, renamed
from synth.motion.npz import read_npz
from synth.motion.procedural import ProceduralConfig, make_motion
from synth.motion.retarget import retarget
from synth.motion.rotations import about
from synth.motion.sequence import SEATED, WEIGHTS, check_actions, make_sequence

_TURN_TIME = 0.3
"""Seconds in which a take that is played to and fro comes to rest at its ends."""


class MotionKind(Enum):
    """Where motion comes from."""

    procedural = "procedural"
    bvh = "bvh"
    amc = "amc"
    npz = "npz"
    c3d = "c3d"


class Up(Enum):
    """Which axis of the world of a recording points up."""

    auto = "auto"
    """As its format has it: y in BVH and AMC, z in AMASS's npz, in C3D what the file says."""
    x = "x"
    y = "y"
    z = "z"


@dataclass(frozen=True)
class MotionConfig:
    """Motion of one person.

    Attributes:
        kind: Made from published kinematics, or recorded: in BVH, ASF/AMC, AMASS-style npz or C3D files.
        path: File, or folder whose files of the kind, at any depth, are drawn from; for recorded kinds.
        fps: Rate of the recordings, frames per second, where their files state a wrong one. Takes of the CMU database
            that are known to be stated wrongly are put right without.
        unit: Metres a unit of the recordings' lengths, where those of the legs do not tell.
        up: Which axis of the recordings' world points up.
        mapping: YAML file of lines `their name: our name`, of joints, or of markers, that recordings call otherwise.
            Ours are those of any skeleton that is known, or `pelvis spine chest head`, and `l_` and `r_` before
            `upper_arm forearm hand knuckle thigh shin foot`.
        actions: What people do, one thing after the other, who follow no recording. Of none, they walk or stand
            throughout, as `procedural` says, which else only tells how fast they walk.
        weights: How often each action is done relative to the others, 1 if it is not named.
        procedural: How people move who follow no recording.
    """

    kind: MotionKind = MotionKind.procedural
    path: str | None = None
    fps: float | None = None
    unit: float | None = None
    up: Up = Up.auto
    mapping: str | None = None
    actions: list[str] = field(default_factory=lambda: list(ACTIONS))
    weights: dict[str, float] = field(default_factory=lambda: dict(WEIGHTS))
    procedural: ProceduralConfig = field(default_factory=ProceduralConfig)

    def __post_init__(self):
        check_actions(self.actions, self.weights)
        for name in ("fps", "unit"):
            value = getattr(self, name)
            if value is not None and not 0 < value < float("inf"):
                raise ValueError(f"motion.{name}: expected more than 0, got {value}")


def load_motion(
    config: MotionConfig, *, seconds: float, fps: float, rng: np.random.Generator, seated: float = SEATED
) -> Motion:
    """A stretch of motion, drawn at random.

    Of recorded kinds, a take is drawn from `takes(config)`, each as likely, and of that a start (`cut`).

    Args:
        config: Where it comes from.
        seconds: Length wanted.
        fps: Frames per second.
        rng: Draws it.
        seated: Height of the hips in sitting on a stool over that in standing, for motion that is made.

    Returns:
        round(seconds * fps) frames, wherever on the floor the source has them; `place` moves them.

    Raises:
        FileNotFoundError: no such file or folder, or no files of the kind in it.
        ValueError: a file is malformed, or of a skeleton that is not known.
    """
    if config.kind is MotionKind.procedural:
        span = {"seconds": seconds, "fps": fps, "rng": rng}
        if not config.actions:
            return make_motion(config.procedural, **span)
        return make_sequence(config.actions, config.weights, speed=config.procedural.speed, seated=seated, **span)
    paths = takes(config)
    path = paths[rng.integers(len(paths))]
    take = read_take(path, config.fps, unit=config.unit, up=config.up, mapping=config.mapping)
    return cut(take, start=rng.uniform(), seconds=seconds, fps=fps)


def takes(config: MotionConfig) -> list[Path]:
    """The files that a recorded kind draws from, sorted.

    Raises:
        ValueError: no path is given, or the kind is not recorded.
        FileNotFoundError: no such file or folder, or no files of the kind in it.
    """
    if config.kind is MotionKind.procedural or not config.path:
        raise ValueError(
            f"motion of kind {config.kind.name!r} with path {config.path!r} has no takes; "
            "expected motion=bvh, amc, npz or c3d, and motion.path=<file or folder>"
        )
    path, suffix = Path(config.path), f".{config.kind.name}"
    if not path.exists():
        raise FileNotFoundError(f"motion path {path}: no such file or folder")
    found = sorted(path.rglob("*")) if path.is_dir() else [path]
    fitting = [file for file in found if file.suffix.lower() == suffix and file.is_file()]
    if not fitting:
        there = sorted({file.suffix for file in found if file.is_file()})
        raise FileNotFoundError(f"motion path {path}: expected {suffix} files, found {there or 'no files'}")
    return fitting


def read_take(
    path: Path,
    fps: float | None = None,
    *,
    unit: float | None = None,
    up: Up = Up.auto,
    mapping: str | None = None,
) -> Motion:
    """A whole take, retargeted and levelled, read once as long as its file does not change.

    Args:
        path: A .bvh, .amc, .npz or .c3d file.
        fps: Replaces the rate that the file states, and what is known of the CMU database's.
        unit, up, mapping: As in `MotionConfig`.

    Returns:
        The take; its arrays are read-only. Its name says what was repaired.

    Raises:
        FileNotFoundError, ValueError: as `load_motion`.
    """
    if not path.is_file():
        raise FileNotFoundError(f"no motion file {path}")
    names = tuple(read_mapping(Path(mapping)).items()) if mapping else ()
    return _read_take(path.resolve(), fps, unit, None if up is Up.auto else up.value, names, path.stat().st_mtime_ns)


@lru_cache(maxsize=128)
def _read_take(
    path: Path, fps: float | None, unit: float | None, up: str | None, names: tuple[tuple[str, str], ...], mtime_ns: int
) -> Motion:
    mapping, kind = dict(names), path.suffix.lower()
    if kind == ".c3d":
        motion = read_c3d(path, fps=fps, unit=unit, up=up, mapping=mapping)
    elif kind == ".npz":
        if mapping:
            raise ValueError(f"{path}: motion.mapping names joints, but npz files have them by number, not by name")
        motion = read_npz(path, fps=fps, unit=unit, up=up)
    else:
        recording = read_amc(path) if kind == ".amc" else read_bvh(path)
        recording = replace(
            recording,
            fps=fps or true_fps(path.stem, recording.fps),
            joints=renamed(recording.joints, mapping, known_joints(), path),
        )
        motion = retarget(recording, unit=unit, up=up)
    motion.root.setflags(write=False)
    motion.rotations.setflags(write=False)
    return motion


def cut(take: Motion, *, start: float, seconds: float, fps: float) -> Motion:
    """A stretch of a take at another rate, rotations by slerp, places linearly.

    A take that is too short is played to and fro, coming to rest within 0.3 s of its ends so that the turns are
    smooth. People then walk backwards in part, which bodies can, where a loop would make them jump and a hold freeze.

    Args:
        take: The take.
        start: Share, 0 to 1, of the possible starts, the first to the last at which the take suffices; a take that is
            too short may start anywhere, either way.
        seconds: Length wanted.
        fps: Rate wanted.
    """
    frames = max(round(seconds * fps), 1)
    times = np.arange(frames) / fps
    length = (len(take) - 1) / take.fps
    if times[-1] <= length:
        times = times + start * (length - times[-1])
        name = f"{take.name} {times[0]:.2f}-{times[-1]:.2f} s"
    else:
        ease = min(_TURN_TIME, length) or _TURN_TIME
        way = length + ease
        phase = (times + start * 2 * way) % (2 * way)
        phase = np.minimum(phase, 2 * way - phase)
        # Speed grows evenly from rest over `ease`, and falls likewise; exact at both ends.
        rising, falling = phase**2 / (2 * ease), length - (way - phase) ** 2 / (2 * ease)
        times = np.where(phase < ease, rising, np.where(phase > length, falling, phase - ease / 2))
        name = f"{take.name} to and fro from {times[0]:.2f} s"
    position = np.clip(times * take.fps, 0, len(take) - 1)
    before = np.minimum(position.astype(int), max(len(take) - 2, 0))
    after = np.minimum(before + 1, len(take) - 1)
    share = (position - before)[:, None]
    first = take.rotations[before]
    turned = Rotation.from_matrix((first.swapaxes(-1, -2) @ take.rotations[after]).reshape(-1, 3, 3)).as_rotvec()
    step = Rotation.from_rotvec((turned.reshape(frames, -1, 3) * share[..., None]).reshape(-1, 3)).as_matrix()
    return Motion(
        name=name,
        fps=fps,
        root=take.root[before] * (1 - share) + take.root[after] * share,
        rotations=first @ step.reshape(first.shape),
        hip_height=take.hip_height,
    )


def place(motion: Motion, xy: tuple[float, float], yaw: float, leader: Motion | None = None) -> Motion:
    """The motion elsewhere on the floor.

    Args:
        motion: The motion to move.
        xy: Where the mean of the root lands, m, world.
        yaw: Where the pelvis faces on the whole (the direction of the mean of its x axis), rad from +x to +y.
        leader: The motion whose root and facing land there instead, along with which this one is moved: its partner.
    """
    leader = leader or motion
    facing = leader.rotations[:, 0, :2, 0].mean(0)
    turn = about("z", yaw - np.arctan2(facing[1], facing[0]))
    centre = np.array((*leader.root[:, :2].mean(0), 0))
    root = (motion.root - centre) @ turn.T + (*xy, 0)
    return replace(motion, root=root, rotations=turn @ motion.rotations)
