"""C3D, the binary format of biomechanics: mm, z up, one marker per joint; written by ezc3d."""

import tempfile
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.store import write_atomic
from dmae.formats.registry import pose_writer
from dmae.formats.trc import marker

_ABSENT, _MODELLED = -1.0, 0.0
"""Residuals that the format reserves: of a point that is not valid, and of one that was not measured."""


@pose_writer("c3d")
def write_c3d(poses: Poses3D, clip: Clip, path: Path) -> None:
    """C3D of biomechanics: all persons in one file, with the standard error of each joint as its residual.

    The residual of a measured joint is its standard error, rounded up to whole mm from 1 to 127, and 1 where it is
    unknown; 0 where a joint was completed, as the format has it for points that were not measured; -1 where it is
    absent. Markers of several persons are called
    `P1:LShoulder`.

    Raises:
        ValueError: ezc3d is not installed.
    """
    try:
        import ezc3d
    except ImportError:
        raise ValueError("format=c3d needs ezc3d: pip install 'dmae-synth[c3d]'") from None
    frames, persons, joints = poses.source.shape
    names = [marker(joint) for joint in poses.skeleton.joints]
    labels = names if persons == 1 else [f"P{person + 1}:{name}" for person in range(persons) for name in names]
    points = np.ones((4, persons * joints, frames))
    points[:3] = 1000 * poses.xyz.reshape(frames, -1, 3).transpose(2, 1, 0)
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["parameters"]["POINT"]["RATE"]["value"] = [clip.fps]
    file["parameters"]["POINT"]["LABELS"]["value"] = labels
    file.add_parameter("POINT", "X_SCREEN", ["+Y"])
    file.add_parameter("POINT", "Y_SCREEN", ["+Z"])
    file["data"]["points"] = points
    file["data"]["meta_points"]["residuals"] = _residuals(poses).reshape(frames, -1).T[None]
    with tempfile.TemporaryDirectory() as folder:
        written = Path(folder, "poses.c3d")
        file.write(str(written))
        write_atomic(Path(path), written.read_bytes())


def _residuals(poses: Poses3D) -> np.ndarray:
    """(F, P, J)"""
    variance = np.trace(poses.cov.astype(np.float64), axis1=-2, axis2=-1) / 3
    # The format holds residuals as whole numbers of a byte.
    error = np.clip(np.ceil(np.nan_to_num(1000 * np.sqrt(variance)) - 1e-3), 1, 127)
    return np.select([poses.source == Source.ABSENT, poses.source == Source.COMPLETED], [_ABSENT, _MODELLED], error)
