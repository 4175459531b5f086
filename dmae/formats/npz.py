"""Poses as a NumPy archive, for whoever reads nothing else."""

import io
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from dmae.clip import Poses3D
from dmae.skeleton import Skeleton, get_skeleton
from dmae.store import write_atomic


def export_npz(poses: Poses3D, fps: float, path: Path) -> None:
    """Write poses; `numpy.load` reads them without pickle.

    The arrays are `joints` (F, P, J, 3) float32, m, world z up, NaN where absent; `source` (F, P, J) uint8,
    0 absent, 1 measured, 2 denoised, 3 completed; `views` (F, P, J) uint8, how many cameras were used;
    `names` (J,) of the joints; `skeleton`, its name; `fps`.
    """
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        joints=poses.xyz,
        source=poses.source,
        views=poses.views,
        names=np.array(poses.skeleton.joints),
        skeleton=np.array(poses.skeleton.name),
        fps=np.float64(fps),
    )
    write_atomic(Path(path), buffer.getvalue())


def read_npz(path: Path) -> tuple[Poses3D, float]:
    """Poses and frames per second from what `export_npz` wrote; covariances are unknown.

    Raises:
        FileNotFoundError: no such file.
        ValueError: it is no such archive; the message says what it lacks.
    """
    path = Path(path)
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = dict(archive)
    except FileNotFoundError:
        raise FileNotFoundError(f"{path}: no such file") from None
    except (BadZipFile, ValueError, TypeError, EOFError) as error:
        raise ValueError(f"{path}: expected an .npz archive of poses, {error}") from None
    lacking = {"joints", "source", "views", "names", "skeleton", "fps"} - set(arrays)
    if lacking:
        raise ValueError(f"{path}: expected an .npz archive of poses, it lacks {sorted(lacking)}")
    skeleton = _skeleton(path, str(arrays["skeleton"]), tuple(str(name) for name in arrays["names"]))
    try:
        return Poses3D(skeleton, arrays["joints"], arrays["source"], views=arrays["views"]), float(arrays["fps"])
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: {error}") from None


def _skeleton(path: Path, name: str, joints: tuple[str, ...]) -> Skeleton:
    try:
        skeleton = get_skeleton(name)
    except KeyError as error:
        raise ValueError(f"{path}: {error.args[0]}") from None
    if skeleton.joints != joints:
        raise ValueError(f"{path}: expected the joints of {name}, {list(skeleton.joints)}, found {list(joints)}")
    return skeleton
