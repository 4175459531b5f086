"""ONNX models of users: from the image of a person to heat maps or SimCC, the outputs of ViTPose and RTMPose."""

from pathlib import Path

import numpy as np

from dmae.data.skeleton import Skeleton, option_skeleton
from dmae.detection.detectors.blazepose import PeopleDetector
from dmae.detection.detectors.landmarks import Region, pyramid_of
from dmae.detection.registry import PoseDetectorConfig, pose_detector
from dmae.files.contents import check_file
from dmae.formats.skeletons import default_skeleton

_MEAN, _DEVIATION = np.array((123.675, 116.28, 103.53), np.float32), np.array((58.395, 57.12, 57.375), np.float32)
"""Mean and standard deviation of the colours in ImageNet, with which these models are trained."""
_BOX_MARGIN = 1.25  # Height of the box around a person, relative to the circle around the body


@pose_detector("onnx")
def onnx(config: PoseDetectorConfig) -> "OnnxDetector":
    """A model of your own, detector.path=<file.onnx>, for the people that BlazePose finds; needs onnxruntime."""
    if config.path is None:
        raise ValueError("detector=onnx: expected detector.path=<file.onnx>")
    try:
        import onnxruntime
    except ImportError:
        raise ValueError("detector=onnx needs onnxruntime: pip install 'dmae-synth[onnx]'") from None
    path = Path(config.path)
    check_file(path)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.log_severity_level = 4
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:
        raise ValueError(f"{path}: expected an ONNX model, {str(error).splitlines()[0]}") from None
    return OnnxDetector(session, config)


class OnnxDetector:
    """An `ImageDetector` of two steps: BlazePose's regions of people, and the joints in each by the model.

    The model takes (1, 3, H, W) RGB, normalised as in ImageNet. It returns heat maps (1, J, h, w), or SimCC: the places
    across (1, J, n W) and down (1, J, n H).
    """

    def __init__(self, session, config: PoseDetectorConfig):
        (given,) = session.get_inputs()
        if len(given.shape) != 4 or given.shape[1] != 3 or not all(isinstance(side, int) for side in given.shape[2:]):
            raise ValueError(
                f"{config.path}: expected an input of shape (1, 3, H, W), found {given.shape}; "
                "export it of a fixed size"
            )
        self._path = config.path
        self._session, self._input, (self._height, self._width) = session, given.name, given.shape[2:]
        self._people = PeopleDetector(config)
        joints = len(self._joints(np.zeros((self._height, self._width, 3), np.uint8))[0])
        self.skeleton = _skeleton(config, joints)

    def __call__(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        regions = [person.region for person in self._people(image) if person.region is not None]
        return self.in_boxes(image, np.array([[*each.centre, 2 * each.radius] for each in regions]).reshape(-1, 3))

    def in_boxes(self, image: np.ndarray, boxes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return xy (D, J, 2), px, and score (D, J) of the people in known boxes, which no other network searches.

        Args:
            image: (H, W, 3) uint8 RGB.
            boxes: (D, 3) centre from the corner of the image and side of a square just around each body, px.
        """
        pyramid, size = pyramid_of(np.ascontiguousarray(image)), max(self._height, self._width)
        top, left = (size - self._height) // 2, (size - self._width) // 2
        joints = len(self.skeleton)
        xy, score = np.empty((len(boxes), joints, 2)), np.empty((len(boxes), joints))
        for number, (x, y, side) in enumerate(boxes):
            box = Region(np.array([x, y]), side * _BOX_MARGIN, np.array([0.0, -1.0]))
            square = box.cut(pyramid, size)
            places, score[number] = self._joints(square[top : top + self._height, left : left + self._width])
            xy[number] = box.to_image((places + (left, top)) / size) - 0.5
        return xy, np.clip(score, 0, 1)

    def _joints(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return places (J, 2), px from the corner, and scores (J,) of the person in an image (H, W, 3) uint8."""
        pixels = ((image.astype(np.float32) - _MEAN) / _DEVIATION).transpose(2, 0, 1)
        try:
            outputs = [each[0] for each in self._session.run(None, {self._input: pixels[None]})]
        # onnxruntime raises its own kinds of errors, and an output may not be an array.
        except Exception as error:
            first, _, _ = str(error).partition("\n")
            raise ValueError(f"{self._path}: this model cannot be run, {first}") from None
        if not all(np.isfinite(each).all() for each in outputs):
            raise ValueError(f"{self._path}: expected heat maps or SimCC of finite numbers, found NaN or infinite ones")
        size = (self._width, self._height)
        if len(outputs) >= 2 and outputs[0].ndim == outputs[1].ndim == 2:
            values = [(each.argmax(-1) + 0.5) / each.shape[-1] for each in outputs[:2]]
            return np.stack(values, -1) * size, np.minimum(outputs[0].max(-1), outputs[1].max(-1))
        if outputs[0].ndim == 3:
            return _peaks(outputs[0]) * size, outputs[0].max((1, 2))
        raise ValueError(
            "detector=onnx: expected heat maps (1, J, h, w), or two outputs (1, J, n) of SimCC, found "
            + ", ".join(str((1, *each.shape)) for each in outputs)
        )


def _peaks(maps: np.ndarray) -> np.ndarray:
    """Return the places (J, 2), from 0 to 1, of the peaks of heat maps (J, h, w), to a quarter of a cell."""
    _, height, width = maps.shape
    flat = maps.reshape(len(maps), -1).argmax(-1)
    y, x = flat // width, flat % width
    joint = np.arange(len(maps))
    # The peak is shifted towards the higher neighbour, as these models are trained.
    right = maps[joint, y, np.minimum(x + 1, width - 1)] - maps[joint, y, np.maximum(x - 1, 0)]
    down = maps[joint, np.minimum(y + 1, height - 1), x] - maps[joint, np.maximum(y - 1, 0), x]
    return np.stack([(x + 0.5 + 0.25 * np.sign(right)) / width, (y + 0.5 + 0.25 * np.sign(down)) / height], -1)


def _skeleton(config: PoseDetectorConfig, joints: int) -> Skeleton:
    if config.skeleton is not None:
        found = option_skeleton("detector.skeleton", config.skeleton)
        if len(found) != joints:
            raise ValueError(f"{config.path}: finds {joints} joints, {found.name} has {len(found)}")
        return found
    try:
        return default_skeleton(str(config.path), joints)
    except ValueError as error:
        raise ValueError(f"{error}; name it by detector.skeleton=...") from None
