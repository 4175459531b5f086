"""Configuration of capture: methods, thresholds of the paper, association, tracking, reassignment, noise.

To add a method, write a function of a clip and a configuration with the decorator `capture_method` in a file of
`dmae/reconstruction/systems`. Listing them imports none.
"""

from dataclasses import MISSING, dataclass, field, fields, replace
from enum import StrEnum

import numpy as np

from dmae.data.typed import Configuration
from dmae.registry import Entry, Registry

ADAPTIVE = "adaptive"
"""Name of the capture of this package."""


@dataclass(frozen=True)
class CaptureMethod(Entry):
    """A system: its function takes a clip of bodies as large as people, and a configuration, and returns poses."""

    paper: str = ""  # Authors and year, as in tables


capture_method = Registry("capture_method", CaptureMethod, "dmae.reconstruction.systems", option="capture.method")
"""Published systems besides the capture of this package (`capture.method`)."""


class DistanceUnit(StrEnum):
    """Unit of distances between detections and reprojections."""

    metres = "metres"
    """At the person's depth: px x depth / focal length."""
    diagonals = "diagonals"
    """Diagonals of the image, as in the paper."""


class ComparedJoints(StrEnum):
    """Joints by which detections of different views are compared."""

    all = "all"
    mid_hip = "mid_hip"
    """As in the paper; both hips if the skeleton has no middle one."""


@dataclass(frozen=True)
class NoiseModel(Configuration):
    """Expected error of detected joints, and when triangulation rejects a view or a point.

    Detectors err in proportion to the size of the person in the image. Sigma, the standard deviation along one axis,
    is therefore a length at the person's depth. It is linear in the confidence. The defaults fit the errors of
    OpenPose on adults, measured by leaving one view out (median by confidence). They are what is assumed before
    the noise is learned from the recording (`dmae.reconstruction.noise`).
    """

    learn: bool = True
    """Learn from the recording how far detections scatter, and what their confidences say."""
    sigma_unsure_m: float = 0.065
    """Sigma of a joint of confidence 0, m."""
    sigma_sure_m: float = 0.012
    """Sigma of a joint of confidence 1, m."""
    min_sigma_px: float = 1.0
    """Smallest sigma in the image, px."""
    gate_sigmas: float = 5.0
    """Largest standardised residual of a view, in sigmas and corrected for redundancy; views beyond it are not used."""
    max_error_m: float = 0.25
    """Largest standard error of a point along its worst direction, m; points beyond it are absent."""

    def sigma(self, confidence: np.ndarray) -> np.ndarray:
        """Return sigma at the person's depth, m, for confidences of any shape; NaN stays NaN."""
        return self.sigma_unsure_m + (self.sigma_sure_m - self.sigma_unsure_m) * np.clip(confidence, 0, 1)


@dataclass(frozen=True)
class AssociationConfig(Configuration):
    """Identity matching: which detections of different views show one person."""

    joints: ComparedJoints = ComparedJoints.all
    """Joints with rays that are compared between views."""
    ray_distance_m: float = 0.1
    """Distance between two rays at which their affinity is 1/2, m."""
    colour_weight: float = 0.3
    """Weight of clothes in the affinity of two detections, 0 to 1; only for clips with images, 0 does not read them."""
    min_affinity: float = 0.45
    """Smallest affinity of detections of one person, 0 to 1."""

    def __post_init__(self):
        super().__post_init__()
        if not self.ray_distance_m > 0:
            raise ValueError(f"association.ray_distance_m={self.ray_distance_m}: expected a positive number")


@dataclass(frozen=True)
class TrackingConfig(Configuration):
    """Tracking: birth, coasting and re-entry of persons, and how their motion is predicted."""

    birth_joints: int = 3
    """Number of joints on which two views or more must agree for a new track."""
    velocity_gain: float = 0.3
    """Share of each step that is added to the velocity for the next prediction; 0 predicts no motion."""
    coasting_s: float = 0.5
    """Longest time for which a track is predicted without being measured, s."""
    reentry_s: float = 2.0
    """Longest absence after which a person of the same build who re-enters nearby keeps the track, s."""
    min_duration_s: float = 0.3
    """Shortest time for which a person is measured with `birth_joints`, s; shorter tracks are false positives."""
    max_by_chance: float | None = 0.1
    """Largest expected number of people that ghosts alone would form: in a frame, with the support of a new person; and
    in the recording, with the support of a whole track. A track that exceeds it in frames for `coasting_s` ends. null
    accepts all."""

    def births(self, joints: int) -> int:
        """Return `birth_joints`; of skeletons with so few joints that this is nearly all, two thirds of them."""
        return min(self.birth_joints, fewer_of_few(joints))


@dataclass(frozen=True)
class ReassignmentConfig(Configuration):
    """Second pass: each joint takes the detection nearest to its own path, known from past and future."""

    distance_m: float = 0.2
    """Largest distance of a detection from the path, m; 0 turns the second pass off."""
    th_p: float = 0.1
    """Smallest confidence of a 2D joint in the second pass; lower than `capture.th_p`, as its place is known."""


@dataclass(frozen=True)
class SubjectConfig(Configuration):
    """The one person that is wanted, or what the wanted people have in common; everyone else is left out."""

    at: list[float] | None = None
    """[frame, x, y]: the subject is the person there in that frame; x, y on the floor in m, or in `camera` in px."""
    camera: str | None = None
    """Name of the camera that `at` is a pixel of; by default `at` is on the floor."""
    leg_m: list[float] | None = None
    """[least, most] length from hip to knee to ankle, m: adults have 0.7 to 1.0, children less."""

    def __post_init__(self):
        super().__post_init__()
        if self.at is not None and len(self.at) != 3:
            raise ValueError(f"subject.at={self.at}: expected [frame, x, y]")
        if self.camera is not None and self.at is None:
            raise ValueError(f"subject.camera={self.camera}: expected subject.at=[frame,x,y] too, a pixel of it")
        if self.leg_m is not None and not (len(self.leg_m) == 2 and 0 <= self.leg_m[0] < self.leg_m[1]):
            raise ValueError(f"subject.leg_m={self.leg_m}: expected [least, most] in m")


@dataclass(frozen=True)
class CaptureConfig(Configuration):
    """How people are reconstructed. Lengths are on the person, durations in seconds: nothing depends on the rig."""

    method: str = field(default=ADAPTIVE, metadata={"choices": (ADAPTIVE, *capture_method)})
    """The capture of this package, adaptive, or a published system for comparison, which takes no other option than
    `th_p`, or module:function of a clip, or of a clip and this configuration."""
    th_p: float = 0.2
    """Smallest confidence of a 2D joint that is used (joint-level filtering)."""
    th_v: int = 2
    """Number of views that must agree on a 3D joint."""
    th_d: float = 0.25
    """Largest distance of a joint from the reprojection of its person (identity propagation), in `th_d_unit`."""
    th_d_unit: DistanceUnit = DistanceUnit.metres
    """Unit of `th_d`."""
    association: AssociationConfig = field(default_factory=AssociationConfig)
    tracking: TrackingConfig = field(default_factory=TrackingConfig)
    reassignment: ReassignmentConfig = field(default_factory=ReassignmentConfig)
    noise: NoiseModel = field(default_factory=NoiseModel)
    prune: bool = True
    """Drop joints that break bones, or that jump away and return."""
    persons: int | None = None
    """Largest number of people, those measured most in the whole recording; by default all."""
    volume: list[float] | None = None
    """m; box in which people are captured, x, y, z of one corner and of the opposite one; by default everywhere."""
    subject: SubjectConfig = field(default_factory=SubjectConfig)

    def __post_init__(self):
        super().__post_init__()
        capture_method.check(self.method, ADAPTIVE)
        if self.method in capture_method:
            others = [each for each in fields(self) if each.name not in ("method", "th_p")]
            made = {each.name: each.default_factory() for each in others if each.default_factory is not MISSING}
            usual = {each.name: each.default for each in others} | made
            if changed := [name for name, value in usual.items() if getattr(self, name) != value]:
                raise ValueError(f"method={self.method} takes th_p and no other option; leave out {', '.join(changed)}")
        if self.persons is not None and self.persons < 1:
            raise ValueError(f"persons={self.persons}: expected 1 or more; leave it out for all people")
        if self.persons is not None and self.persons > 1 and self.subject.at is not None:
            raise ValueError(f"persons={self.persons}: subject.at names one person; leave one of them out")
        if self.volume is not None and (
            len(self.volume) != 6 or not all(a != b for a, b in zip(self.volume[:3], self.volume[3:], strict=True))
        ):
            raise ValueError(
                f"volume={self.volume}: expected six numbers, x, y, z of one corner and of the opposite one, m"
            )
        if self.th_v < 2:
            raise ValueError(f"th_v={self.th_v}: expected 2 or more, as a point needs at least 2 views")
        if not self.th_d > 0:
            raise ValueError(f"th_d={self.th_d}: expected a positive number")

    def widened(self, factor: float) -> "CaptureConfig":
        """Return the configuration for detections that scatter by `factor` more than usual."""
        if factor == 1:
            return self
        return replace(
            self,
            th_d=factor * self.th_d,
            association=replace(self.association, ray_distance_m=factor * self.association.ray_distance_m),
            reassignment=replace(self.reassignment, distance_m=factor * self.reassignment.distance_m),
        )


def fewer_of_few(joints: int) -> int:
    """Return two thirds of the joints of a skeleton, at least one: detectors miss some in most frames."""
    return max(1, round(2 * joints / 3))
