"""movement: netCDF files of its data sets of poses, in 2D for each camera, or in 3D.

A data set of poses in 3D has `position` (time, space, keypoints, individuals), m, world z up; `confidence`, 1 where
measured and 0 where completed; `source`, as `Source`; and `standard_error`, m, along an axis. Absent is NaN. The
attribute `skeleton` is a name, or the definition of your own skeleton as JSON. movement itself reads the first two.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from dmae.data.array_fields import UNSET
from dmae.data.clip import Clip, Poses3D, Source, person_names
from dmae.data.skeleton import Skeleton
from dmae.files.checks import MOST_METRES, check_numbers, check_rate
from dmae.files.contents import write_atomic
from dmae.files.hdf5 import Hdf5, open_hdf5
from dmae.formats.poses import PoseFile
from dmae.formats.recordings import NumberedDetections, camera_files
from dmae.formats.registry import pose_reader, pose_writer, reader
from dmae.formats.skeletons import NamedDetections, named_detections, named_skeleton, read_skeleton_text, skeleton_text

_WHAT = "a data set of movement"
_AXES = ("time", "space", "keypoints", "individuals")
_FROM_0_17 = {"keypoint": "keypoints", "individual": "individuals"}  # Axes as movement calls them from 0.17 on
_MOST_FRAMES, _MOST_INDIVIDUALS = 10_000_000, 1000


@reader("movement", signs=[["*.nc"]], cameras=False)
def read_detections(path: Path, *, skeleton: Skeleton | None = None) -> NumberedDetections:
    """movement's <camera>.nc, poses in 2D of each camera, with a calibration of any format.

    A missing confidence of a keypoint becomes 1.

    Args:
        skeleton: By default the one that the files name, or else one for their keypoints, see
            `dmae.formats.skeletons.named_skeleton`.

    Raises:
        FileNotFoundError: there are no such files.
        ValueError: a file is malformed or in 3D, or its keypoints are not the joints of the skeleton.
    """
    rates = set()

    def read(file: Path) -> NamedDetections:
        with open_hdf5(file, _WHAT) as data_set:
            names, position, confidence, _, rate = _read(file, data_set, ["x", "y"])
            stated = _stated_skeleton(file, data_set)
        rates.add(rate)
        score = np.where(np.isnan(confidence), 1.0, confidence)
        return NamedDetections(names, np.concatenate([position, score[..., None]], -1), skeleton=stated)

    files = {file.stem: file for file in camera_files(Path(path), "*.nc")}
    found = named_detections(files, read, skeleton)
    return replace(found, fps=rates.pop() if len(rates) == 1 else None)


@pose_reader("movement", file="*.nc")
def read_movement_poses(path: Path) -> PoseFile:
    """movement's poses in 3D, m; keypoints without a source count as measured."""
    path = Path(path)
    with open_hdf5(path, _WHAT) as data_set:
        names, position, _, source, rate = _read(path, data_set, ["x", "y", "z"])
        skeleton, index, _ = named_skeleton(names, [], _stated_skeleton(path, data_set), path)
    check_numbers(f"{path}: position", position, MOST_METRES)
    xyz = np.where(np.isfinite(position).all(-1, keepdims=True), position, np.nan)[:, :, index]
    if source is not None:
        # Other values become 255, which is refused below.
        fine = (source == np.round(source)) & (source >= 0) & (source <= 255)
        source = np.where(fine, source, 255).astype(np.uint8)[:, :, index]
    try:
        poses = Poses3D(skeleton, xyz, UNSET if source is None else source)
        poses.check_numbers()
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return PoseFile(poses, rate)


@pose_writer("movement", errors=True, needs=["xarray", "h5netcdf"], extra="animals")
def write_movement(poses: Poses3D, clip: Clip, path: Path) -> None:
    """A netCDF file of movement: positions, sources and standard errors of all joints."""
    data_set = movement_data_set(poses, clip.fps, person_names(clip, poses.xyz.shape[1]))
    write_atomic(path, bytes(data_set.to_netcdf(engine="h5netcdf")))


def movement_data_set(poses: Poses3D, fps: float, people: list[str]):
    """Return poses of named people as an xarray data set, as above."""
    import xarray

    frames = len(poses.source)
    measured, absent = poses.measured, poses.source == Source.ABSENT
    variance = np.trace(poses.cov.astype(np.float64), axis1=-2, axis2=-1) / 3
    per_joint = ("time", "keypoints", "individuals")
    return xarray.Dataset(
        {
            "position": (_AXES, poses.xyz.astype(np.float64).transpose(0, 3, 2, 1)),
            "confidence": (per_joint, np.where(absent, np.nan, measured.astype(float)).swapaxes(1, 2)),
            "source": (
                per_joint,
                poses.source.swapaxes(1, 2),
                {"flag_values": [int(kind) for kind in Source],
                 "flag_meanings": " ".join(kind.name.lower() for kind in Source)},
            ),
            "standard_error": (per_joint, np.sqrt(variance).swapaxes(1, 2), {"units": "m"}),
        },
        {
            "time": np.arange(frames) / fps,
            "space": ["x", "y", "z"],
            "keypoints": list(poses.skeleton.joints),
            "individuals": people,
        },
        {
            "fps": float(fps),
            "time_unit": "seconds",
            "source_software": "dmae",
            "ds_type": "poses",
            "skeleton": skeleton_text(poses.skeleton),
        },
    )  # fmt: skip


def _read(
    path: Path, data_set: Hdf5, space: list[str]
) -> tuple[list[str], np.ndarray, np.ndarray, np.ndarray | None, float | None]:
    """Return keypoints, positions (F, P, J, 2 or 3), confidences and sources (F, P, J), and frames per second."""
    found, names = data_set.texts("space"), data_set.texts("keypoint" if "keypoint" in data_set else "keypoints")
    if found != space:
        kind = "2D of one camera" if len(space) == 2 else "3D"
        raise ValueError(f"{path}: expected {_WHAT} in {kind}, with space {', '.join(space)}; found {', '.join(found)}")
    position = _in_order(path, data_set, "position", _AXES)
    frames, persons, joints, _ = position.shape
    if position.shape[2:] != (len(names), len(space)) or frames > _MOST_FRAMES or persons > _MOST_INDIVIDUALS:
        raise ValueError(f"{path}: expected positions of {len(names)} keypoints, found the shape {position.shape}")
    others = []
    for name in ("confidence", "source"):
        values = None
        if name in data_set:
            values = _in_order(path, data_set, name, tuple(axis for axis in _AXES if axis != "space"))
            if values.shape != (frames, persons, joints):
                raise ValueError(f"{path}: expected {name} of shape {(frames, persons, joints)}, found {values.shape}")
        others.append(values)
    confidence = np.full((frames, persons, joints), np.nan) if others[0] is None else others[0]
    rate = data_set.attribute("fps")
    # Without a rate, time counts frames.
    fps = None if rate is None or isinstance(rate, str) else check_rate(f"{path}: fps", rate)
    return names, position, confidence, others[1], fps


def _in_order(path: Path, data_set: Hdf5, name: str, axes: tuple[str, ...]) -> np.ndarray:
    """Return an array with its axes in the order time, individuals, keypoints, space."""
    values, there = data_set.array(name), [_FROM_0_17.get(axis, axis) for axis in data_set.axes(name)]
    if sorted(there) != sorted(axes) or values.ndim != len(axes) or values.dtype.names:
        raise ValueError(f"{path}: expected {name} with the axes {', '.join(axes)}, found {', '.join(there)}")
    wanted = ("time", "individuals", "keypoints", "space")
    return values.astype(np.float64).transpose([there.index(axis) for axis in wanted if axis in axes])


def _stated_skeleton(path: Path, data_set: Hdf5) -> Skeleton | None:
    stated = data_set.attribute("skeleton")
    return read_skeleton_text(path, stated) if isinstance(stated, str) else None
