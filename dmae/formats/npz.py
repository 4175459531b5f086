"""Poses as a NumPy archive, for whoever reads nothing else."""

import io
from collections.abc import Sequence
from pathlib import Path

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
    needed = ("joints", "source", "views", "names", "skeleton", "fps")
    arrays = read_arrays(path, "an .npz archive of poses", needed)
    skeleton = _skeleton(path, str(arrays["skeleton"]), tuple(str(name) for name in arrays["names"]))
    try:
        return Poses3D(skeleton, arrays["joints"], arrays["source"], views=arrays["views"]), float(arrays["fps"])
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: {error}") from None


def read_arrays(path: Path, what: str, needed: Sequence[str], also: Sequence[str] = ()) -> dict[str, np.ndarray]:
    """Some arrays of an .npz archive; nothing in it is run, and nothing else in it is read.

    Args:
        what: What the archive is expected to be, for messages.
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
    # Opened here: what the system says of a file is no fault of the archive. NumPy would leave it open, too.
    with path.open("rb") as file:
        try:
            with np.load(file, allow_pickle=False) as archive:
                names = list(archive.files)
                arrays = {name: archive[name] for name in names if name in (*needed, *also)}
        # Of what they raise for damaged archives, from NotImplementedError to SyntaxError and, for lying headers,
        # MemoryError, zipfile and NumPy make no list. Nothing but their reading stands in here.
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
