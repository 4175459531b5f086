"""The one noun: a stretch of multi-view capture, what was detected in it, and what is true where that is known."""

from dataclasses import dataclass, field, fields, replace
from enum import IntEnum

import numpy as np

from dmae.cameras import CameraRig
from dmae.images import Images
from dmae.skeleton import Skeleton


class Source(IntEnum):
    """Where a 3D joint comes from. A joint no camera measured is never `MEASURED`."""

    ABSENT = 0
    MEASURED = 1
    DENOISED = 2
    """Measured, then moved by a model or a filter."""
    COMPLETED = 3
    """Invented: interpolated, or predicted by a model."""


class Visibility(IntEnum):
    """What a camera sees of a joint, and why not."""

    VISIBLE = 0
    HIDDEN_BY_SELF = 1
    HIDDEN_BY_PERSON = 2
    HIDDEN_BY_OBJECT = 3
    OUTSIDE_IMAGE = 4
    BEHIND_CAMERA = 5
    ABSENT = 6
    """The person is not in the scene."""


class JointError(IntEnum):
    """What is wrong with a detected joint: the kinds of Ronchi and Perona (ICCV 2017), and those of whole detections.

    Sizes are keypoint similarities to the true joint of the person that the detection is of, as COCO has them:
    exp(-d^2 / (2 s^2 k^2)) of a joint d px off, s^2 the person's area in the image, k the joint's spread.
    """

    ABSENT = 0
    """No joint was detected."""
    GOOD = 1
    """Similarity of 0.85 or more."""
    JITTER = 2
    """From 0.5 to 0.85: near, but off."""
    FAR = 3
    """Below 0.5, and not one of the others."""
    INVERTED = 4
    """On the joint of the other side."""
    SWAPPED = 5
    """On the same joint of another person."""
    MERGED = 6
    """A joint of another person, in a detection made of two people."""
    GHOST = 7
    """Of a person whom there is not."""


def _as_array(owner, name: str, dtype, shape: tuple, default=None):
    """Set a field of a frozen dataclass to an array of a checked shape; -1 in `shape` takes any length."""
    value = getattr(owner, name)
    array = np.full(shape, default, dtype) if value is None else np.asarray(value, dtype)
    if array.ndim != len(shape) or any(want not in (-1, found) for want, found in zip(shape, array.shape, strict=True)):
        want = tuple("any" if n == -1 else n for n in shape)
        raise ValueError(f"{type(owner).__name__}.{name}: expected shape {want}, found {array.shape}")
    object.__setattr__(owner, name, array)


@dataclass(frozen=True)
class Detections2D:
    """What a 2D detector says of every view. Order within a view carries no identity.

    Attributes:
        skeleton: J joints.
        xy: (F, V, D, J, 2) px, NaN where a joint, or a whole detection, is absent.
        score: (F, V, D, J) confidence, NaN exactly where `xy` is.
    """

    skeleton: Skeleton
    xy: np.ndarray
    score: np.ndarray

    def __post_init__(self):
        _as_array(self, "xy", np.float32, (-1, -1, -1, len(self.skeleton), 2))
        _as_array(self, "score", np.float32, self.xy.shape[:-1])
        if not np.array_equal(np.isnan(self.xy).any(-1), np.isnan(self.score)):
            raise ValueError("Detections2D: score must be NaN exactly where xy is")

    @property
    def observed(self) -> np.ndarray:
        """(F, V, D, J) True where a joint was detected."""
        return ~np.isnan(self.score)


@dataclass(frozen=True)
class Poses3D:
    """Joints in the world. A person keeps its index through the clip.

    Truth, triangulated and completed poses are all of this type.

    Attributes:
        skeleton: J joints.
        xyz: (F, P, J, 3) m, world; NaN where absent.
        source: (F, P, J) `Source`; by default measured where `xyz` is known.
        cov: (F, P, J, 3, 3) covariance, m^2; NaN where unknown.
        views: (F, P, J) how many views were used; 0 where none or unknown.
        rays: (F, P, J, 2, 3) where a camera stands, m, world, and the unit direction in which it saw the joint; of
            those that saw it the surest. NaN where none did, or that is unknown. A joint that one camera saw is absent,
            and yet it is on that ray.
    """

    skeleton: Skeleton
    xyz: np.ndarray
    source: np.ndarray = None
    cov: np.ndarray = None
    views: np.ndarray = None
    rays: np.ndarray = None

    def __post_init__(self):
        _as_array(self, "xyz", np.float32, (-1, -1, len(self.skeleton), 3))
        joints = self.xyz.shape[:-1]
        absent = np.isnan(self.xyz).any(-1)
        if self.source is None:
            object.__setattr__(self, "source", np.where(absent, Source.ABSENT, Source.MEASURED))
        _as_array(self, "source", np.uint8, joints)
        _as_array(self, "cov", np.float32, (*joints, 3, 3), np.nan)
        _as_array(self, "views", np.uint8, joints, 0)
        _as_array(self, "rays", np.float32, (*joints, 2, 3), np.nan)
        if not np.array_equal(absent, self.source == Source.ABSENT):
            raise ValueError("Poses3D: source must be ABSENT exactly where xyz is NaN")

    @property
    def measured(self) -> np.ndarray:
        """(F, P, J) True where cameras measured the joint, whether or not it was denoised since."""
        return (self.source == Source.MEASURED) | (self.source == Source.DENOISED)

    def without(self, dropped: np.ndarray) -> "Poses3D":
        """The poses less the joints where `dropped` (F, P, J) is True, which become absent."""
        if not dropped.any():
            return self
        return replace(
            self,
            xyz=np.where(dropped[..., None], np.nan, self.xyz),
            source=np.where(dropped, Source.ABSENT, self.source),
            cov=np.where(dropped[..., None, None], np.nan, self.cov),
            views=np.where(dropped, 0, self.views),
        )

    def select(self, frames) -> "Poses3D":
        """The poses of some frames (a slice or a list of indices)."""
        arrays = {f.name: getattr(self, f.name)[frames] for f in fields(self) if f.name != "skeleton"}
        return Poses3D(self.skeleton, **arrays)


OF_TRUE_PERSONS = {
    "visibility": (np.uint8, 4),
    "hidden_by": (np.int16, 4),
    "depth_margin": (np.float32, 4),
    "visible_pixels": (np.int32, 3),
    "amodal_pixels": (np.int32, 3),
}
"""What views show of the true persons, arrays of a clip that are (F, V, P) or (F, V, P, K): their types, and how many
axes they have."""

OF_DETECTIONS = {
    "detected_person": (np.int16, 3, -1),
    "detected_joint_person": (np.int16, 4, -1),
    "detected_error": (np.uint8, 4, JointError.ABSENT),
    "detected_off": (np.float32, 4, np.nan),
}
"""The truth of detections, arrays of a clip that are (F, V, D) or (F, V, D, J): their types, how many axes they have,
and what they hold where nothing is detected."""


@dataclass(frozen=True)
class Clip:
    """A stretch of multi-view capture of F frames, V views.

    Attributes:
        id: Name within its data set.
        fps: Frames per second.
        rig: The V cameras.
        detections: What the 2D detector said, (F, V, D, J, ...).
        truth: True poses where known; P persons. Frames in which nobody is annotated are all NaN.
        poses: What capture or completion made of the detections. Its persons are tracks, in no relation
            to the order of `truth`.
        visibility: (F, V, P, K) `Visibility` of the joints of `truth`, simulated clips only.
        hidden_by: (F, V, P, K) person index, or index into `objects`, of what hides the joint; -1 for none.
        depth_margin: (F, V, P, K) how far before the joint, on the ray from the camera, what hides it begins, m; NaN
            where nothing does.
        visible_pixels: (F, V, P) how many pixels show each person; clips with images of ids only.
        amodal_pixels: (F, V, P) how many would if nothing else were there.
        detected_person: (F, V, D) person index of each detection, -1 for a ghost; simulated clips only.
            Capture reads neither this nor the next three.
        detected_joint_person: (F, V, D, J) index of the person whose joint it is that each detected joint lies on:
            another where joints are swapped or people merged; -1 in ghosts and where there is none.
        detected_error: (F, V, D, J) `JointError` of each.
        detected_off: (F, V, D, J) how far each is from the true joint, at that frame, of the person that the detection
            is of, px; NaN in ghosts, and where there is none or that joint is behind the camera.
        objects: Names of the things that can hide a joint.
        images: Images on disk, if any.
        true_rig: The cameras as they truly were, where `rig` is what a calibration in error says of them;
            simulated clips only. Capture never reads it.
        provenance: JSON-able record of where the clip comes from.
    """

    id: str
    fps: float
    rig: CameraRig
    detections: Detections2D
    truth: Poses3D | None = None
    poses: Poses3D | None = None
    visibility: np.ndarray | None = None
    hidden_by: np.ndarray | None = None
    depth_margin: np.ndarray | None = None
    visible_pixels: np.ndarray | None = None
    amodal_pixels: np.ndarray | None = None
    detected_person: np.ndarray | None = None
    detected_joint_person: np.ndarray | None = None
    detected_error: np.ndarray | None = None
    detected_off: np.ndarray | None = None
    objects: tuple[str, ...] = ()
    images: Images | None = None
    true_rig: CameraRig | None = None
    provenance: dict = field(default_factory=dict)

    def __post_init__(self):
        frames, views = self.detections.xy.shape[:2]
        if views != len(self.rig):
            raise ValueError(f"clip {self.id!r}: {len(self.rig)} cameras but detections in {views} views")
        if not self.fps > 0:
            raise ValueError(f"clip {self.id!r}: fps must be positive, found {self.fps}")
        for name in ("truth", "poses"):
            poses = getattr(self, name)
            if poses is not None and len(poses.xyz) != frames:
                raise ValueError(f"clip {self.id!r}: {frames} frames of detections but {len(poses.xyz)} of {name}")
        if self.true_rig is not None and self.true_rig.names != self.rig.names:
            raise ValueError(f"clip {self.id!r}: expected true_rig of {self.rig.names}, found {self.true_rig.names}")
        for name, (dtype, axes, _) in OF_DETECTIONS.items():
            if getattr(self, name) is not None:
                _as_array(self, name, dtype, self.detections.xy.shape[:axes])
        for name, (dtype, axes) in OF_TRUE_PERSONS.items():
            if getattr(self, name) is not None:
                if self.truth is None:
                    raise ValueError(f"clip {self.id!r}: {name} is that of the true persons, and there is no truth")
                _as_array(self, name, dtype, (frames, views, *self.truth.xyz.shape[1 : axes - 1]))
        object.__setattr__(self, "objects", tuple(self.objects))

    def __len__(self) -> int:
        """How many frames."""
        return len(self.detections.xy)

    @property
    def seen_by(self) -> np.ndarray | None:
        """(F, P, K) how many cameras see each true joint; None where `visibility` is."""
        return None if self.visibility is None else (self.visibility == Visibility.VISIBLE).sum(1)

    @property
    def visible_share(self) -> np.ndarray | None:
        """(F, V, P) share of each person's pixels that is not hidden; NaN where a person is not in the image at all."""
        if self.amodal_pixels is None:
            return None
        there = self.amodal_pixels > 0
        return np.where(there, self.visible_pixels / np.where(there, self.amodal_pixels, 1), np.nan)

    def select(self, frames=slice(None), views=slice(None)) -> "Clip":
        """The clip of some frames and views (a slice or a list of indices each), every field cut alike.

        `poses` are dropped when views are left out: they were made with those views.
        """
        rig = self.rig[views]
        images = self.images.select(frames, rig.names) if self.images else None

        def cut(array):
            return None if array is None else array[frames][:, views]

        return replace(
            self,
            rig=rig,
            detections=Detections2D(self.detections.skeleton, cut(self.detections.xy), cut(self.detections.score)),
            truth=self.truth and self.truth.select(frames),
            poses=self.poses and self.poses.select(frames) if len(rig) == len(self.rig) else None,
            **{name: cut(getattr(self, name)) for name in OF_TRUE_PERSONS},
            **{name: cut(getattr(self, name)) for name in OF_DETECTIONS},
            images=images,
            true_rig=None if self.true_rig is None else self.true_rig[views],
        )
