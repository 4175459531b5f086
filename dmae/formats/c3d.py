"""C3D, the binary format of biomechanics: mm, z up, one marker per joint; written by ezc3d."""

import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip, Poses3D, Source, person_names
from dmae.files.contents import write_atomic
from dmae.files.mapped import by_frames, frame_blocks, in_steps
from dmae.formats.registry import pose_writer
from dmae.formats.trc import opensim_marker

_ABSENT, _MODELLED = -1.0, 0.0
"""Residuals that the format reserves for a point that is not valid, and for a point that was not measured."""

_MOST_FRAMES, _PART_FRAMES = 65535, 50_000
"""Largest number of frames in a file, which the format stores in 16 bits, and number of frames per file above it."""


@pose_writer("c3d", table=True, needs=["ezc3d"])
def write_c3d(poses: Poses3D, clip: Clip, path: Path) -> list[Path]:
    """C3D of biomechanics: all persons in one file, with the standard error of each joint as its residual.

    The residual of a measured joint is its standard error, rounded up to whole mm from 1 to 127; it is 1 if the error
    is unknown. The residual of a completed joint is 0, the format's value for points that were not measured. The
    residual of an absent joint is -1. If there are several persons, markers have names such as `P1:LShoulder`.

    A file contains at most 65535 frames. Longer recordings are written to files of 50,000 frames, named after their
    first frame: `<name>_000000.c3d`, `<name>_050000.c3d` and so on.
    """
    path, frames, people = Path(path), len(poses.xyz), person_names(clip, poses.xyz.shape[1])
    if frames <= _MOST_FRAMES:
        _write(poses, clip.fps, people, path)
        return [path]
    parts = []
    for start in in_steps(range(0, frames, _PART_FRAMES)):
        part = path.with_name(f"{path.stem}_{start:06d}{path.suffix}")
        _write(poses.select(slice(start, start + _PART_FRAMES)), clip.fps, people, part)
        parts.append(part)
    return parts


def _write(poses: Poses3D, fps: float, people: Sequence[str], path: Path) -> None:
    """Write one file of at most `_MOST_FRAMES` frames."""
    import ezc3d

    frames, persons, joints = poses.source.shape
    names = [opensim_marker(joint, poses.skeleton) for joint in poses.skeleton.joints]
    labels = names if persons == 1 else [f"{person}:{name}" for person in people for name in names]
    points = np.ones((4, persons * joints, frames))
    for part in frame_blocks(poses.xyz):
        points[:3, :, part] = 1000 * poses.xyz[part].reshape(-1, persons * joints, 3).transpose(2, 1, 0)
    residuals = by_frames(_residuals, poses.cov, poses.source)
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["parameters"]["POINT"]["RATE"]["value"] = [fps]
    file["parameters"]["POINT"]["LABELS"]["value"] = labels
    file.add_parameter("POINT", "X_SCREEN", ["+Y"])
    file.add_parameter("POINT", "Y_SCREEN", ["+Z"])
    file["data"]["points"] = points
    file["data"]["meta_points"]["residuals"] = residuals.reshape(frames, -1).T[None]
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder, "poses.c3d")
        file.write(str(made))
        with made.open("rb") as pieces:
            write_atomic(path, iter(partial(pieces.read, 1 << 20), b""))


def _residuals(cov: np.ndarray, source: np.ndarray) -> np.ndarray:
    """Return the residuals (F, P, J), mm, of joints with covariances (F, P, J, 3, 3) m^2 and sources (F, P, J)."""
    variance = np.trace(cov.astype(np.float64), axis1=-2, axis2=-1) / 3
    # The format stores a residual as a whole number in one byte.
    error = np.clip(np.ceil(np.nan_to_num(1000 * np.sqrt(variance)) - 1e-3), 1, 127)
    return np.select([source == Source.ABSENT, source == Source.COMPLETED], [_ABSENT, _MODELLED], error)
