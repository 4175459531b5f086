"""Labels of simulated clips: the occluder of each joint, and the error of each detected joint."""

from dataclasses import dataclass, fields, replace
from enum import IntEnum

import numpy as np

from dmae.data.array_fields import same_fields, set_array, short_repr
from dmae.files.checks import MOST_METRES, MOST_PIXELS, check_numbers

KINDS = ("rgb", "depth", "ids", "parts", "normals", "flow", "amodal")
"""Kinds of images of a clip."""


class Visibility(IntEnum):
    """Visibility of a joint in a view, and the kind of occluder if it is hidden."""

    VISIBLE = 0
    HIDDEN_BY_SELF = 1
    HIDDEN_BY_PERSON = 2
    HIDDEN_BY_OBJECT = 3
    OUTSIDE_IMAGE = 4
    BEHIND_CAMERA = 5
    ABSENT = 6
    """The person is not in the scene."""


class JointError(IntEnum):
    """The error of a detected joint, following Ronchi and Perona (ICCV 2017), extended by the errors of whole
    detections.

    Errors of position are classed by COCO's keypoint similarity to the true joint of the detected person:
    exp(-d^2 / (2 s^2 k^2)) for a joint with an error of d px, where s^2 is the person's area in the image and k the
    joint's spread.
    """

    ABSENT = 0
    """No joint was detected."""
    GOOD = 1
    """Similarity of 0.85 or more."""
    JITTER = 2
    """Similarity from 0.5 to 0.85: near the true joint."""
    FAR = 3
    """Similarity below 0.5, and none of the other errors."""
    INVERTED = 4
    """On the joint of the other side."""
    SWAPPED = 5
    """On the same joint of another person."""
    MERGED = 6
    """A joint of another person, in a detection made of two people."""
    GHOST = 7
    """A joint of a person that does not exist."""


@dataclass(frozen=True)
class OcclusionLabels:
    """Visibility of the J joints of P true persons in V views and F frames.

    Attributes:
        visibility: (F, V, P, J) uint8 `Visibility`.
        occluder: (F, V, P, J) int16 index of the occluder: a person, or one of `objects`; -1 for none.
        depth_margin: (F, V, P, J) float32 distance from the occluder to the joint along the camera's ray, m; NaN
            where the joint is not hidden.
        visible_pixels: (F, V, P) int32 number of pixels that show each person. Known if images of ids were rendered.
        amodal_pixels: (F, V, P) int32 number of pixels that would show each person if nothing else were there.
        objects: Names of the objects that can hide a joint.
    """

    visibility: np.ndarray
    occluder: np.ndarray | None = None
    depth_margin: np.ndarray | None = None
    visible_pixels: np.ndarray | None = None
    amodal_pixels: np.ndarray | None = None
    objects: tuple[str, ...] = ()

    __repr__, __eq__ = short_repr, same_fields

    def __post_init__(self):
        set_array(self, "visibility", np.uint8, ("F", "V", "P", "J"))
        joints = self.visibility.shape
        _set_known(self, {"occluder": (np.int16, joints), "depth_margin": (np.float32, joints)})
        _set_known(self, dict.fromkeys(("visible_pixels", "amodal_pixels"), (np.int32, joints[:3])))
        object.__setattr__(self, "objects", tuple(self.objects))

    @property
    def visible_views(self) -> np.ndarray:
        """(F, P, J) number of views in which each joint is visible."""
        return (self.visibility == Visibility.VISIBLE).sum(1)

    @property
    def visible_fraction(self) -> np.ndarray | None:
        """(F, V, P) fraction of each person's pixels not hidden; NaN outside the image; None if not counted."""
        if self.amodal_pixels is None:
            return None
        in_image = self.amodal_pixels > 0
        return np.where(in_image, self.visible_pixels / np.where(in_image, self.amodal_pixels, 1), np.nan)

    def check_numbers(self, size: np.ndarray) -> None:
        """Raise ValueError, which names the field, if a label is impossible in images of the sizes (V, 2) px."""
        check_numbers("occlusion.visibility", self.visibility, max(Visibility), 0)
        last = self.visibility.shape[2] + len(self.objects) - 1
        _check_known(self, {"occluder": (last, -1), "depth_margin": (MOST_METRES, -MOST_METRES)})
        pixels = size.prod(-1)[:, None]
        _check_known(self, {"visible_pixels": (pixels, 0), "amodal_pixels": (pixels, 0)})

    def select(self, frames=slice(None), views=slice(None)) -> "OcclusionLabels":
        """Return the labels of some frames and views (a slice or a list of indices each)."""
        return _select(self, frames, views)


NOT_DETECTED = {"person": -1, "joint_person": -1, "error": JointError.ABSENT, "offset_px": np.nan}
"""Value of each array of `DetectionLabels` where nothing is detected."""


@dataclass(frozen=True)
class DetectionLabels:
    """The truth of simulated detections. Capture never reads it.

    Attributes:
        person: (F, V, D) int16 index of the true person of each detection; -1 for a ghost or none.
        joint_person: (F, V, D, J) int16 index of the person on which each detected joint is. It differs from
            `person` where joints are swapped or people merged; -1 for a ghost or none.
        error: (F, V, D, J) uint8 `JointError`.
        offset_px: (F, V, D, J) float32 distance to the true joint of `person` at the time of the frame, px; NaN for a
            ghost or none, and where the true joint is behind the camera.
    """

    person: np.ndarray
    joint_person: np.ndarray | None = None
    error: np.ndarray | None = None
    offset_px: np.ndarray | None = None

    __repr__, __eq__ = short_repr, same_fields

    def __post_init__(self):
        set_array(self, "person", np.int16, ("F", "V", "D"))
        joints = (*self.person.shape, "J")
        _set_known(self, {"joint_person": (np.int16, joints), "error": (np.uint8, joints)})
        _set_known(self, {"offset_px": (np.float32, joints)})

    def check_numbers(self, persons: int | None) -> None:
        """Raise ValueError, which names the field, if a label is impossible for this number of true persons."""
        last = np.iinfo(np.int16).max if persons is None else persons - 1
        known = {"person": (last, -1), "joint_person": (last, -1), "error": (max(JointError), 0)}
        _check_known(self, known | {"offset_px": (MOST_PIXELS, 0)})

    def select(self, frames=slice(None), views=slice(None)) -> "DetectionLabels":
        """Return the labels of some frames and views (a slice or a list of indices each)."""
        return _select(self, frames, views)


def _set_known(labels, types: dict[str, tuple[type, tuple[int, ...]]]) -> None:
    for name, (dtype, shape) in types.items():
        if getattr(labels, name) is not None:
            set_array(labels, name, dtype, shape)


def _check_known(labels, limits: dict[str, tuple]) -> None:
    part = "occlusion" if isinstance(labels, OcclusionLabels) else "detection_labels"
    for name, (most, least) in limits.items():
        if (array := getattr(labels, name)) is not None:
            check_numbers(f"{part}.{name}", array, most, least)


def _select(labels, frames, views):
    arrays = {f.name: getattr(labels, f.name) for f in fields(labels)}
    cut = {name: array[frames][:, views] for name, array in arrays.items() if isinstance(array, np.ndarray)}
    return replace(labels, **cut)
