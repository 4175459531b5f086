"""The motion of a clip: draw a take or a procedural recipe, and cut a stretch of it."""

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dmae.files.checks import check_numbers
from dmae.files.contents import cached_until_changed
from synth.motion.config import PROCEDURAL, RECORDED, MotionConfig, UpAxis
from synth.motion.geometry import slerp
from synth.motion.motion import Motion
from synth.motion.procedural.gait import make_motion
from synth.motion.procedural.sequence import SEATED, make_sequence
from synth.motion.readers import ReadOptions, reader, reader_of
from synth.motion.readers.dialects import read_mapping
from synth.motion.readers.takes import find_takes

_TURN_TIME = 0.3
"""Time in which a take that is played back and forth comes to rest at its ends, s."""
_FARTHEST = 10_000.0
"""Greatest coordinate of a take, m."""


def load_motion(
    config: MotionConfig, *, seconds: float, fps: float, rng: np.random.Generator, seated: float = SEATED
) -> Motion:
    """Draw a stretch of motion: round(seconds * fps) frames, anywhere on the floor.

    For recorded motion, a take of `takes(config)` is drawn with equal probability, and a start within it (see `cut`).
    In procedural motion, `seated` is the hip height on a stool as a fraction of the standing hip height.

    Raises:
        FileNotFoundError: there is no such file or folder, or no file of the format in it.
        ValueError: a file is malformed, or has an unknown skeleton.
    """
    if config.kind == PROCEDURAL:
        span: dict = {"seconds": seconds, "fps": fps, "rng": rng}
        if not config.actions:
            return make_motion(config.procedural, **span)
        return make_sequence(config.actions, config.weights, speed=config.procedural.speed, seated=seated, **span)
    (take,) = draw_takes(config, [(path,) for path in takes(config)], rng=rng)
    return cut(take, start=rng.uniform(), seconds=seconds, fps=fps)


def draw_takes(
    config: MotionConfig, choices: Sequence[tuple[Path, ...]], *, rng: np.random.Generator
) -> tuple[Motion, ...]:
    """Draw a take, or a pair of takes, with equal probability. Takes that cannot be read are left out with a warning.

    Raises ValueError if none of the choices can be read.
    """
    left = list(choices)
    while True:
        chosen = left.pop(rng.integers(len(left)))
        try:
            return tuple(
                read_take(path, config.fps, unit=config.unit, up=config.up, mapping=config.mapping) for path in chosen
            )
        except (ValueError, FileNotFoundError) as error:
            if len(choices) == 1:
                raise
            if not left:
                raise ValueError(
                    f"{config.path}: none of {len(choices)} takes can be read; the last: {error}"
                ) from None
            warnings.warn(f"left out: {error}; `synth split data={config.path}` lists all", stacklevel=2)


def takes(config: MotionConfig) -> list[Path]:
    """Return the files from which recorded motion is drawn: sorted, or in the order of a list.

    Raises:
        ValueError: no path is given, or the kind is procedural.
        FileNotFoundError: there is no such file or folder, or no file of the format in it.
    """
    if config.kind == PROCEDURAL or not config.path:
        kinds = "" if config.kind != PROCEDURAL else f"motion={'|'.join((RECORDED, *reader))} and "
        raise ValueError(f"motion={config.kind}: expected {kinds}motion.path=<file, folder or list>")
    kind = None if config.kind == RECORDED else reader.find(config.kind).name
    return find_takes(Path(config.path), kind, config.sets)


def read_take(
    path: Path,
    fps: float | None = None,
    *,
    unit: float | None = None,
    up: UpAxis = UpAxis.auto,
    mapping: str | None = None,
) -> Motion:
    """Read a whole take, retargeted and on a level floor, with read-only arrays. It is cached until its file changes.

    `fps`, `unit`, `up` and `mapping` are as in `MotionConfig`. The name of the take lists what was repaired. Raises as
    `load_motion`.
    """
    if not path.is_file():
        raise FileNotFoundError(f"no motion file {path}")
    names = tuple(read_mapping(Path(mapping)).items()) if mapping else ()
    return _read_take(path.resolve(), fps, unit, None if up is UpAxis.auto else up.value, names)


@cached_until_changed(128)
def _read_take(
    path: Path, fps: float | None, unit: float | None, up: str | None, names: tuple[tuple[str, str], ...]
) -> Motion:
    options = ReadOptions(fps=fps, unit=unit, up=up, mapping=dict(names))
    try:
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            motion = reader_of(path).function(path, options)
        check_numbers("positions, m", motion.root, _FARTHEST)
        check_numbers("hip height, m", motion.hip_height, _FARTHEST)
    except ValueError as error:
        raise ValueError(str(error) if path.name in str(error) else f"{path}: {error}") from None
    motion.root.setflags(write=False)
    motion.rotations.setflags(write=False)
    return motion


def cut(take: Motion, *, start: float, seconds: float, fps: float) -> Motion:
    """Cut a stretch of a take and resample it: rotations by slerp, positions linearly.

    A take that is too short is played back and forth. It comes to rest within 0.3 s of its ends, so that it reverses
    smoothly. People then sometimes walk backwards.

    `start` is from 0, the first frame, to 1, the last from which the take is long enough. A take that is too short may
    start anywhere, in either direction.
    """
    frames = max(round(seconds * fps), 1)
    times = np.arange(frames) / fps
    length = (len(take) - 1) / take.fps
    if times[-1] <= length:
        times = times + start * (length - times[-1])
        name = f"{take.name} {times[0]:.2f}-{times[-1]:.2f} s"
    else:
        ease = min(_TURN_TIME, length) or _TURN_TIME
        period = length + ease
        phase = (times + start * 2 * period) % (2 * period)
        phase = np.minimum(phase, 2 * period - phase)
        # Constant acceleration from rest over `ease`, and constant deceleration to rest; exact at both ends.
        rising, falling = phase**2 / (2 * ease), length - (period - phase) ** 2 / (2 * ease)
        times = np.where(phase < ease, rising, np.where(phase > length, falling, phase - ease / 2))
        name = f"{take.name} to and fro from {times[0]:.2f} s"
    position = np.clip(times * take.fps, 0, len(take) - 1)
    before = np.minimum(position.astype(int), max(len(take) - 2, 0))
    after = np.minimum(before + 1, len(take) - 1)
    share = position - before
    return Motion(
        name=name,
        fps=fps,
        root=take.root[before] * (1 - share[:, None]) + take.root[after] * share[:, None],
        rotations=slerp(take.rotations[before], take.rotations[after], share),
        hip_height=take.hip_height,
    )
