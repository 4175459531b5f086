"""Clips: a section of a multi-view recording with its cameras, detections and, if known, its truth."""

import sys
from dataclasses import dataclass, field, replace
from enum import IntEnum

import numpy as np

from dmae.data.array_fields import UNSET, same_fields, set_array, short_repr
from dmae.data.cameras import CameraRig
from dmae.data.images import Images
from dmae.data.labels import DetectionLabels, OcclusionLabels
from dmae.data.skeleton import Skeleton
from dmae.data.typed import decode, type_hints
from dmae.files.checks import MOST_METRES, MOST_PIXELS, MOST_SCORE, MOST_VARIANCE, check_numbers, check_rate
from dmae.files.mapped import by_frames, frame_blocks


class Source(IntEnum):
    """Source of a 3D joint. A joint on which fewer than two cameras agree is never `MEASURED`."""

    ABSENT = 0
    MEASURED = 1
    DENOISED = 2
    """Measured, then moved by a model or a filter."""
    COMPLETED = 3
    """Interpolated, or predicted by a model: fewer than two cameras agree, or what they measured was rejected."""


def person_name(person: int) -> str:
    """Return the name of a person, P1 for index 0: in files, tables, figures and messages alike."""
    return f"P{person + 1}"


def person_names(clip: "Clip", persons: int) -> list[str]:
    """Return the names that exported files give to the persons of a clip: chosen ones, or P1, P2, ..."""
    given = clip.provenance.get("people")  # A clip from elsewhere can hold anything under this name
    if isinstance(given, list) and len(given) == persons and all(isinstance(name, str) for name in given):
        return given
    return [person_name(person) for person in range(persons)]


NOT_KNOWN = {"xyz": np.nan, "source": Source.ABSENT, "cov": np.nan, "views": 0, "rays": np.nan}
"""Value of each array of `Poses3D` where a joint is absent."""


@dataclass(frozen=True)
class Detections2D:
    """The output of a 2D detector in V views. The order of the D detections within a view has no meaning.

    Attributes:
        skeleton: J joints.
        xy: (F, V, D, J, 2) px, NaN where a joint, or a whole detection, is absent.
        score: (F, V, D, J) confidence, NaN exactly where `xy` is; by default 1 where `xy` is known.
    """

    skeleton: Skeleton
    xy: np.ndarray
    score: np.ndarray = UNSET

    __repr__, __eq__ = short_repr, same_fields

    def __post_init__(self):
        decode(Skeleton, self.skeleton, "Detections2D.skeleton")
        set_array(self, "xy", np.float32, ("F", "V", "D", len(self.skeleton), 2))
        if self.score is None:
            object.__setattr__(self, "score", np.where(np.isnan(self.xy).any(-1), np.nan, 1))
        set_array(self, "score", np.float32, self.xy.shape[:-1])
        for part in frame_blocks(self.xy, self.score):
            unknown = np.isnan(self.xy[part])
            # `any` along an axis of two takes thirty times as long.
            if not np.array_equal(unknown[..., 0] | unknown[..., 1], np.isnan(self.score[part])):
                raise ValueError(
                    "Detections2D: score must be NaN exactly where xy is, as "
                    "np.where(np.isnan(xy).any(-1), np.nan, score); without scores, leave it out"
                )

    @property
    def observed(self) -> np.ndarray:
        """(F, V, D, J) True where a joint was detected."""
        return ~np.isnan(self.score)

    def select(self, frames=slice(None), views=slice(None)) -> "Detections2D":
        """Return the detections of some frames and views (a slice or a list of indices each)."""
        return Detections2D(self.skeleton, self.xy[frames][:, views], self.score[frames][:, views])


@dataclass(frozen=True)
class Poses3D:
    """Joints of P persons in the world, in F frames. A person has the same index in all frames of the clip.

    True, captured and completed poses are all of this type.

    Attributes:
        skeleton: J joints.
        xyz: (F, P, J, 3) m, world; NaN where absent.
        source: (F, P, J) `Source`; by default measured where `xyz` is known.
        cov: (F, P, J, 3, 3) covariance, m^2; NaN where unknown.
        views: (F, P, J) number of views that measured the joint; 0 where none or unknown. A completed joint has views
            where what they measured was rejected.
        rays: (F, P, J, 2, 3) the ray on which one camera saw the joint: the centre of the camera, m, world, and a unit
            direction. If several cameras saw the joint, it is the camera with the largest confidence. NaN where no
            camera saw the joint, or where this is unknown. A joint that only one camera saw is absent, but is on that
            ray.
    """

    skeleton: Skeleton
    xyz: np.ndarray
    source: np.ndarray = UNSET
    cov: np.ndarray = UNSET
    views: np.ndarray = UNSET
    rays: np.ndarray = UNSET

    __repr__, __eq__ = short_repr, same_fields

    def __post_init__(self):
        decode(Skeleton, self.skeleton, "Poses3D.skeleton")
        set_array(self, "xyz", np.float32, ("F", "P", len(self.skeleton), 3))
        joints = self.xyz.shape[:-1]
        absent = by_frames(lambda xyz: np.isnan(xyz).any(-1), self.xyz)
        if self.source is None:
            object.__setattr__(self, "source", np.where(absent, Source.ABSENT, Source.MEASURED))
        set_array(self, "source", np.uint8, joints)
        set_array(self, "cov", np.float32, (*joints, 3, 3), np.nan)
        set_array(self, "views", np.uint8, joints, 0)
        set_array(self, "rays", np.float32, (*joints, 2, 3), np.nan)
        if not np.array_equal(absent, self.source == Source.ABSENT):
            raise ValueError(
                "Poses3D: source must be ABSENT exactly where xyz is NaN; joints that were filled are Source.COMPLETED"
            )

    def check_numbers(self, name: str = "poses") -> None:
        """Raise ValueError if coordinates or covariances are invalid, infinite for example; the message names them."""
        check_numbers(f"{name}.xyz, m", self.xyz, MOST_METRES)
        check_numbers(f"{name}.rays, m", self.rays, MOST_METRES)
        check_numbers(f"{name}.cov, m^2", self.cov, MOST_VARIANCE)
        if self.source.max(initial=0) > max(Source):
            raise ValueError(f"{name}.source: expected {', '.join(f'{s:d} {s.name.lower()}' for s in Source)}")

    @property
    def measured(self) -> np.ndarray:
        """(F, P, J) True where cameras measured the joint, denoised or not."""
        return (self.source == Source.MEASURED) | (self.source == Source.DENOISED)

    @property
    def rejected(self) -> np.ndarray:
        """(F, P, J) True where a joint is completed although cameras measured it: the measurement was rejected."""
        return (self.source == Source.COMPLETED) & (self.views > 0)

    @property
    def captured(self) -> np.ndarray:
        """(F, P) True where cameras measured a joint of the person, though it may have been rejected since."""
        return (self.measured | self.rejected).any(-1)

    @property
    def only_completed(self) -> np.ndarray:
        """(F, P) True where joints of the person are completed and cameras measured none."""
        return (self.source == Source.COMPLETED).any(-1) & ~self.captured

    def without(self, dropped: np.ndarray) -> "Poses3D":
        """Return the poses with all joints made absent for which `dropped` (F, P, J) is True."""
        if not dropped.any():
            return self
        dropped = np.broadcast_to(dropped, self.source.shape)

        def cut(name: str) -> np.ndarray:
            values = getattr(self, name)
            absent = values.dtype.type(NOT_KNOWN[name])
            here = dropped.reshape(*dropped.shape, *(1,) * (values.ndim - 3))
            return by_frames(lambda here, values: np.where(here, absent, values), here, values)

        return replace(self, xyz=cut("xyz"), source=cut("source"), cov=cut("cov"), views=cut("views"))

    def taking(self, where: np.ndarray, other: "Poses3D") -> "Poses3D":
        """Return these poses with the joints of others of the same skeleton where True, (F, P, J)."""
        joints = {}
        for name, new in other.arrays.items():
            joints[name] = np.where(where.reshape(*where.shape, *(1,) * (new.ndim - 3)), new, self.arrays[name])
        return Poses3D(self.skeleton, **joints)

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """The arrays of all joints, (F, P, J, ...), by name: every field but the skeleton."""
        return {name: getattr(self, name) for name in NOT_KNOWN}

    def select(self, frames=slice(None), persons=slice(None)) -> "Poses3D":
        """Return the poses of some frames and persons (a slice or a list of indices each)."""
        frames, persons = (list(each) if isinstance(each, tuple) else each for each in (frames, persons))
        return Poses3D(self.skeleton, **{name: array[frames][:, persons] for name, array in self.arrays.items()})


_OF_THE_WHOLE = ("quality", "occlusion", "calibration_error")
"""Keys of a manifest line that were measured on all frames and views of a clip."""


@dataclass(frozen=True)
class Clip:
    """A section of a multi-view recording with F frames and V views.

    Attributes:
        id: Name of the clip in its data set.
        fps: Frames per second.
        rig: The V cameras.
        detections: Output of a 2D detector, (F, V, D, J, ...).
        truth: True poses of P persons, if known. Frames without annotation are all NaN.
        poses: Poses that capture or completion computed from the detections. Their persons are tracks; their order is
            independent of `truth`.
        occlusion: Visibility of the joints of `truth` in each view. Simulated clips only.
        detection_labels: The truth of `detections`. Simulated clips only; capture never reads it.
        images: Images on disk, if any.
        true_rig: The true cameras, where `rig` is a calibration with errors. Simulated clips only; capture never reads
            it.
        provenance: JSON-able record of the clip's origin.

    Raises:
        ValueError: the fields do not fit together; the message names the field and the expected shape.
    """

    id: str
    fps: float
    rig: CameraRig
    detections: Detections2D
    truth: Poses3D | None = None
    poses: Poses3D | None = None
    occlusion: OcclusionLabels | None = None
    detection_labels: DetectionLabels | None = None
    images: Images | None = None
    true_rig: CameraRig | None = None
    provenance: dict = field(default_factory=dict)

    __repr__, __eq__ = short_repr, same_fields

    def __post_init__(self):
        for name in type_hints(Clip).keys() - {"fps"}:  # `check_rate` says what rates there are
            decode(type_hints(Clip)[name], getattr(self, name), f"Clip.{name}")
        frames, views = self.detections.xy.shape[:2]
        if views != len(self.rig):
            raise ValueError(f"clip {self.id!r}: {len(self.rig)} cameras but detections in {views} views")
        check_rate(f"clip {self.id!r}: fps", self.fps)
        for name in ("truth", "poses"):
            poses = getattr(self, name)
            if poses is not None and len(poses.xyz) != frames:
                raise ValueError(f"clip {self.id!r}: {frames} frames of detections but {len(poses.xyz)} of {name}")
        if self.true_rig is not None and self.true_rig.names != self.rig.names:
            raise ValueError(f"clip {self.id!r}: expected true_rig of {self.rig.names}, found {self.true_rig.names}")
        self._check_labels()

    def check_numbers(self) -> None:
        """Raise ValueError, which names the field, for an invalid number read from files, infinite for example."""
        check_numbers("detections.xy, px", self.detections.xy, MOST_PIXELS)
        check_numbers("detections.score", self.detections.score, MOST_SCORE)
        for name in ("truth", "poses"):
            if (poses := getattr(self, name)) is not None:
                poses.check_numbers(name)
        if self.occlusion is not None:
            self.occlusion.check_numbers(self.rig.size)
        if self.detection_labels is not None:
            self.detection_labels.check_numbers(None if self.truth is None else self.truth.xyz.shape[1])

    def _check_labels(self) -> None:
        if self.occlusion is not None:
            if self.truth is None:
                raise ValueError(f"clip {self.id!r}: occlusion labels the joints of truth, but there is no truth")
            frames, *joints = self.truth.xyz.shape[:3]
            self._check_shape("occlusion.visibility", self.occlusion.visibility, (frames, len(self.rig), *joints))
        if self.detection_labels is not None:
            shape = self.detections.score.shape
            self._check_shape("detection_labels.person", self.detection_labels.person, shape[:3])
            for name in ("joint_person", "error", "offset_px"):
                array = getattr(self.detection_labels, name)
                if array is not None:
                    self._check_shape(f"detection_labels.{name}", array, shape)

    def _check_shape(self, name: str, array: np.ndarray, expected: tuple[int, ...]) -> None:
        if array.shape != expected:
            raise ValueError(f"clip {self.id!r}: {name}: expected shape {expected}, found {array.shape}")

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.detections.xy)

    @property
    def actual_rig(self) -> CameraRig:
        """The cameras that filmed: `true_rig` where `rig` is a calibration with errors, otherwise `rig`."""
        return self.true_rig or self.rig

    @property
    def has_images(self) -> bool:
        """Whether `images` has colour images."""
        return self.images is not None and "rgb" in self.images.kinds

    def without_lost_images(self) -> "Clip":
        """Return the clip without images if their folder is not there, as of a clip copied alone; stderr says so."""
        if self.images is None or self.images.folder.is_dir():
            return self
        folder = self.images.folder.resolve()
        print(f"clip {self.id!r}: no folder {folder} with its images; they are left out", file=sys.stderr)
        return replace(self, images=None)

    def select(self, frames=slice(None), views=slice(None)) -> "Clip":
        """Return the clip with only some frames and views (a slice or a list of indices each), in all fields.

        Views may also be a list of names of cameras. `poses` become None if views are left out, because the poses were
        computed from all views. The manifest line in `provenance` loses what was measured on the whole clip.
        """
        # NumPy takes a tuple for indices of several axes.
        frames, views = (list(each) if isinstance(each, tuple) else each for each in (frames, views))
        if isinstance(views, list):
            views = self.rig.indices(views)
        rig, detections = self.rig[views], self.detections.select(frames, views)
        provenance, line = self.provenance, self.provenance.get("manifest")
        part = rig.names != self.rig.names or len(detections.xy) != len(self)
        if isinstance(line, dict) and "frames" in line and part:
            kept = {key: value for key, value in line.items() if key not in _OF_THE_WHOLE}
            provenance = provenance | {"manifest": kept | {"frames": len(detections.xy)}}
        late = provenance.get("offsets")  # A clip from elsewhere can hold anything under this name
        if isinstance(late, list) and len(late) == len(self.rig):
            provenance = provenance | {"offsets": np.array(late)[views].tolist()}
        return replace(
            self,
            rig=rig,
            detections=detections,
            truth=self.truth and self.truth.select(frames),
            poses=self.poses and self.poses.select(frames) if len(rig) == len(self.rig) else None,
            occlusion=self.occlusion and self.occlusion.select(frames, views),
            detection_labels=self.detection_labels and self.detection_labels.select(frames, views),
            images=self.images and self.images.select(frames, rig.names),
            true_rig=None if self.true_rig is None else self.true_rig[views],
            provenance=provenance,
        )
