"""Poses as a NumPy archive, which `numpy.load` reads without pickle.

For F frames, P persons and J joints it holds:

| Array | Shape and type | What it is |
|---|---|---|
| `joints` | (F, P, J, 3) float32 | places, m, world z up; NaN where absent |
| `source` | (F, P, J) uint8 | where each joint comes from: an index of `source_names` |
| `source_names` | (4,) text | `absent`, `measured`, `denoised` (measured, then moved), `completed` (not measured) |
| `cov` | (F, P, J, 3, 3) float32 | covariance of each joint, m^2; NaN where unknown |
| `views` | (F, P, J) uint8 | how many cameras measured the joint |
| `names` | (J,) text | names of the joints |
| `skeleton` | text | name of the skeleton |
| `fps` | float64 | frames per second |

Where all joints of a person are absent in a frame, the person is not there.
"""

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.skeleton import Skeleton, get_skeleton
from dmae.data.store import write_atomic
from dmae.formats.recordings.pose_files import PoseFile
from dmae.formats.registry import pose_reader, pose_writer


@pose_writer("npz", fused=True)
def write_npz(poses: Poses3D, clip: Clip, path: Path) -> None:
    """A NumPy archive with joints, their sources, covariances and names."""
    export_npz(poses, clip.fps, path)


@pose_reader("npz", file="*.npz")
def read_npz_poses(path: Path) -> PoseFile:
    """A NumPy archive that `write_npz` wrote."""
    return PoseFile(*read_npz(path))


def export_npz(poses: Poses3D, fps: float, path: Path) -> None:
    """Write poses, with the arrays that the module lists."""
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        joints=poses.xyz,
        source=poses.source,
        source_names=np.array([source.name.lower() for source in Source]),
        cov=poses.cov,
        views=poses.views,
        names=np.array(poses.skeleton.joints),
        skeleton=np.array(poses.skeleton.name),
        fps=np.float64(fps),
    )
    write_atomic(Path(path), buffer.getvalue())


def read_npz(path: Path) -> tuple[Poses3D, float]:
    """Return poses and frames per second from what `export_npz` wrote; files from before 0.2 hold no covariances.

    Raises:
        FileNotFoundError: no such file.
        ValueError: it is no such archive; the message says what it lacks.
    """
    path = Path(path)
    needed = ("joints", "source", "views", "names", "skeleton", "fps")
    arrays = read_arrays(path, "an .npz archive of poses", needed, ("cov",))
    skeleton = _skeleton(path, str(arrays["skeleton"]), tuple(str(name) for name in arrays["names"]))
    try:
        poses = Poses3D(skeleton, arrays["joints"], arrays["source"], arrays.get("cov"), arrays["views"])
        return poses, float(arrays["fps"])
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: {error}") from None


def read_arrays(path: Path, what: str, needed: Sequence[str], also: Sequence[str] = ()) -> dict[str, np.ndarray]:
    """Return some arrays of an .npz archive; nothing in it is run, and no other array is read.

    Args:
        what: The kind of archive expected, for messages.
        needed: Arrays that must be there.
        also: Arrays that may be.

    Raises:
        FileNotFoundError: no such file.
        OSError: the file may not be read.
        ValueError: it is no such archive, is damaged, holds pickled objects, or lacks arrays.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    # Opened here, as errors of the system are no fault of the archive; NumPy would leave the file open, too.
    with path.open("rb") as file:
        try:
            with np.load(file, allow_pickle=False) as archive:
                names = list(archive.files)
                arrays = {name: archive[name] for name in names if name in (*needed, *also)}
        # Damaged archives make zipfile and NumPy raise errors of many undocumented types, from NotImplementedError to
        # SyntaxError, and MemoryError for wrong headers. The block holds nothing but their reading.
        except Exception as error:
            reason = f"{type(error).__name__}: {error}"
            if "pickle" in reason.lower():
                reason = f"it holds pickled Python objects, which are not read as they could run anything ({error})"
            raise ValueError(f"{path}: expected {what}; {reason}") from error
    lacking = sorted(set(needed) - set(names))
    if lacking:
        raise ValueError(
            f"{path}: expected arrays {' and '.join(needed)}, found {', '.join(names)}; it lacks {lacking}"
        )
    return arrays


def _skeleton(path: Path, name: str, joints: tuple[str, ...]) -> Skeleton:
    try:
        skeleton = get_skeleton(name)
    except KeyError as error:
        raise ValueError(f"{path}: {error.args[0]}") from None
    if skeleton.joints != joints:
        raise ValueError(f"{path}: expected the joints of {name}, {list(skeleton.joints)}, found {list(joints)}")
    return skeleton
