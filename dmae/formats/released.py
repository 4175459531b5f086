"""The `.npy` dictionaries of the paper's released code: cameras, detections and truth of Shelf.

They are pickles, which run whatever code they like when they are loaded as NumPy and pickle load them. Here they are
read by an unpickler that makes arrays, dictionaries, lists, texts and numbers and calls nothing else.
"""

import pickle
from pathlib import Path

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from dmae.data.skeleton import BODY21, BODY25, SHELF14
from dmae.formats.calibrations.entries import CameraTable, ParsedCamera, make_rig
from dmae.formats.recordings.camera_matching import frame_number, natural
from dmae.formats.recordings.numbered_detections import NumberedDetections, to_clip
from dmae.formats.registry import reader

CAMERAS, DETECTIONS, TRUTH = "camera_params.npy", "*2d_detection_dict.npy", "*3d_eval*.npy"
FPS = 25.0
_ARRAYS = ("numpy.core.multiarray", "numpy._core.multiarray")


def load_released(path: Path):
    """Return what a `.npy` file holds: an array, or the one object that it pickles.

    Raises:
        FileNotFoundError: no such file.
        ValueError: it is no such file, or refers to anything but arrays and Python's own containers; the
            message names that, and none of it has been run.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    with path.open("rb") as file:
        try:
            version = np.lib.format.read_magic(file)
            header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            if not header(file)[2].hasobject:
                return np.load(path, allow_pickle=False)
            array = _Unpickler(file).load()
        except (pickle.UnpicklingError, EOFError, ValueError, TypeError, LookupError, AttributeError) as error:
            raise ValueError(f"{path}: expected a dictionary of arrays, {error}") from None
    return array.tolist() if isinstance(array, np.ndarray) else array


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str):
        if (module, name) == ("numpy", "dtype"):
            return np.dtype
        if (module, name) == ("numpy", "ndarray"):
            return "ndarray"  # Only ever handed to `_empty`.
        if module in _ARRAYS and name in ("_reconstruct", "scalar"):
            return _empty if name == "_reconstruct" else _scalar
        if (module, name) == ("_codecs", "encode"):
            return _latin1
        raise pickle.UnpicklingError(f"it asks for {module}.{name}, which is not loaded")


def _empty(*_) -> np.ndarray:
    """Return an array that pickle then fills with shape, type and values."""
    return np.ndarray((0,), "b")


def _scalar(dtype: np.dtype, data: bytes):
    if not isinstance(dtype, np.dtype) or dtype.hasobject or not isinstance(data, bytes):
        raise pickle.UnpicklingError("it holds a scalar that is no number")
    return np.frombuffer(data, dtype)[0]


def _latin1(text: str, *_) -> bytes:
    """Return the bytes in pickles that Python 2 can read."""
    return text.encode("latin1")


@reader("released", signs=[["camera_params.npy"]])
def read_released(path: Path, *, fps: float | None = None) -> Clip:
    """The dictionaries of the paper's code: camera_params.npy, *2d_detection_dict.npy, maybe *3d_eval*.npy.

    Detections are of BODY_25, or of the paper's 21 joints where they were cut to those. Truth is of SHELF14, NaN where
    an actor is not annotated.

    Args:
        path: Folder of the files.
        fps: Frames per second; by default those of the Shelf recording.

    Raises:
        FileNotFoundError: cameras or detections are missing.
        ValueError: a file is malformed, or asks for code.
    """
    rig = read_cameras(path / CAMERAS)
    file = _one(path, DETECTIONS)
    if file is None:
        raise FileNotFoundError(f"{path}: expected {DETECTIONS}, found none")
    found, truth = _detections(file, rig), _one(path, TRUTH)
    annotated = None if truth is None else _truth(truth, sorted(next(iter(found.views.values()))))
    return to_clip(found, rig, fps or FPS, path, annotated, SHELF14)


def _one(folder: Path, pattern: str) -> Path | None:
    found = sorted(folder.glob(pattern))
    if len(found) > 1:
        raise ValueError(f"{folder}: expected one {pattern}, found {', '.join(file.name for file in found)}")
    return found[0] if found else None


def read_cameras(path: Path) -> CameraRig:
    """Return the cameras of `camera_params.npy`: world to camera, m; errors as in `load_released`."""
    cameras = load_released(path)
    if not isinstance(cameras, list):
        raise ValueError(f"{path}: expected a list of cameras, found {cameras!r:.60}")
    return make_rig(path, (_camera(CameraTable(path, str(n), values)) for n, values in enumerate(cameras)), None)


def _camera(entry: CameraTable) -> ParsedCamera:
    name = str(entry.values.get("id", entry.camera))
    return ParsedCamera(
        name,
        entry.numbers("K", 9).reshape(3, 3),
        np.zeros(5),
        entry.numbers("R", 9).reshape(3, 3),
        entry.numbers("T", 3),
        entry.size("res"),
    )


def _detections(path: Path, rig: CameraRig) -> NumberedDetections:
    content = load_released(path)
    if not isinstance(content, dict) or not all(isinstance(view, dict) for view in content.values()):
        raise ValueError(f"{path}: expected detections by view and frame, found {content!r:.60}")
    # They are fractions of the image, all cameras' of the same size in the code that reads them.
    scale = np.array([*(rig.size[0] - 1), 1.0])
    views, joints = {}, None
    for name in sorted(content, key=natural):
        views[name] = {}
        for frame, people in content[name].items():
            found = [_person(f"{path}: {name}, {frame}", person) for person in people]
            joints = joints or next(map(len, found), None)
            if any(len(person) != joints for person in found):
                raise ValueError(f"{path}: {name}, {frame}: expected people of {joints} joints, found others")
            values = np.array(found).reshape(-1, joints or len(BODY25), 3) * scale
            values[~(values[..., 2] > 0)] = np.nan
            views[name][frame_number(path, str(frame))] = values
    return NumberedDetections(BODY21 if joints == len(BODY21) else BODY25, views)


def _person(place: str, person) -> np.ndarray:
    values = person if isinstance(person, dict) else {}
    joints = np.asarray(values.get("meta", values.get("filtered_skel")))
    if joints.shape not in ((len(BODY25), 3), (len(BODY21), 3)) or joints.dtype.kind != "f":
        raise ValueError(f"{place}: expected `meta` or `filtered_skel` of 25 or 21 x 3 numbers, found {person!r:.60}")
    return joints.astype(np.float64)


def _truth(path: Path, numbers: list[int]) -> dict[int, np.ndarray]:
    content = load_released(path)
    frames = list(content) if isinstance(content, list | np.ndarray) else []
    if len(frames) != len(numbers):
        raise ValueError(f"{path}: expected {len(numbers)} frames as in the detections, found {len(frames)}")
    truth = {}
    for number, actors in zip(numbers, frames, strict=True):
        truth[number] = np.full((len(actors), len(SHELF14), 3), np.nan)
        for actor, joints in enumerate(actors):
            if len(joints):
                # The 15th joint is the mean of the hips.
                truth[number][actor] = np.asarray(joints, np.float64)[: len(SHELF14)]
    return truth
