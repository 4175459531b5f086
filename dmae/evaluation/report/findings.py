"""What a report finds in one clip: counts, errors by group, uncertainty, reprojection, moments, doubtful joints.

Joints are counted in groups that add up over clips. Reprojection compares them with the detections of each camera. A
ranking shows a reviewer which joints may be off.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.special import gammaincinv

from dmae.calibration.world import Floor, find_floor
from dmae.data.cameras import camera_label
from dmae.data.clip import Clip, Poses3D, Source, person_name
from dmae.data.conversion import convert, scale_of
from dmae.data.labels import Visibility
from dmae.data.skeleton import Skeleton
from dmae.evaluation.review import Decision, ReviewVerdict, checksum, decided
from dmae.files.mapped import in_steps
from dmae.formats.poses import SOURCE_WORDS, states_completed
from dmae.metrics.comparison import Comparison, gap_frames, match, take_matched
from dmae.metrics.position import GAPS, squared_deviations
from dmae.numerics.body import bone_lengths
from dmae.numerics.filling import are_stills
from dmae.numerics.paths import runs
from dmae.numerics.statistics import likely_error, mean_known, median_over_frames
from dmae.reporting.tables import Table, number_text

BINS = 2000
"""Errors are counted in bins of one unit, mm or px; the last holds all larger ones."""


@dataclass(frozen=True)
class JointGroup:
    """A group of joints."""

    joints: int  # Number of joints
    completed: int  # Number of completed joints
    missing: int  # Number of absent joints
    compared: int  # Number of joints with an error
    total: float  # Sum of the errors
    histogram: np.ndarray  # (BINS,) counts of errors by their whole number of units

    @classmethod
    def of(cls, error: np.ndarray, source: np.ndarray) -> "JointGroup":
        """Count joints by `source` (...) and their errors (...), mm or px; NaN where there is none."""
        known = error[np.isfinite(error)]
        return cls(
            source.size,
            int((source == Source.COMPLETED).sum()),
            int((source == Source.ABSENT).sum()),
            len(known),
            float(known.sum(dtype=np.float64)),
            np.bincount(np.minimum(known, BINS - 1).astype(int), minlength=BINS),
        )

    def __add__(self, other: "JointGroup") -> "JointGroup":
        return JointGroup(*(a + b for a, b in zip(vars(self).values(), vars(other).values(), strict=True)))

    @property
    def mean(self) -> float | None:
        """Mean error; None if no joint has an error."""
        return self.total / self.compared if self.compared else None

    def quantile(self, share: float) -> float | None:
        """Return the error that this share of joints does not exceed, within one unit; None without errors."""
        if not self.compared:
            return None
        counts = np.cumsum(self.histogram)
        bin = int(np.searchsorted(counts, share * self.compared))
        before = counts[bin - 1] if bin else 0
        return bin + (share * self.compared - before) / max(self.histogram[bin], 1)


Groups = dict[str, dict[str, JointGroup]]
"""Groups of joints by breakdown ("camera", "joint", ...) and name."""


def added(*parts: dict) -> dict:
    """Return groups of several clips or frames, nested or not, as one dictionary; what has the same name adds up."""
    total: dict = {}
    for part in parts:
        for name, each in part.items():
            if isinstance(each, dict):
                total[name] = added(total.get(name, {}), each)
            else:
                total[name] = total[name] + each if name in total else each
    return total


# Joints of the true people or, without truth, of the captured people


@dataclass(frozen=True, eq=False)
class Joints:
    """Joints of N people in F frames, on one skeleton."""

    skeleton: Skeleton  # Skeleton of J joints
    # (F, N, J) True for joints that count: true joints, or joints of captured people who are present
    counted: np.ndarray
    source: np.ndarray  # (F, N, J) `Source` of the captured or completed joint
    views: np.ndarray  # (F, N, J) number of cameras that measured the joint
    # (F, N, J) length of the gap around each joint that was not measured, in frames at 25/s; 0 where it was
    gap: np.ndarray
    person: np.ndarray  # (F, N) index of the captured person; -1 where a true person is missed
    comparison: Comparison | None = None  # Comparison with the truth; None without truth

    @property
    def error(self) -> np.ndarray:
        """(F, N, J) mm; NaN without truth, and where a joint is missing."""
        return np.full(self.source.shape, np.nan) if self.comparison is None else self.comparison.error


def joints_of(clip: Clip) -> Joints:
    """Return the joints of a captured clip. Poses are compared on their own skeleton if the truth has it."""
    poses = clip.poses
    assert poses is not None
    if clip.truth is None or not np.isfinite(clip.truth.xyz).any():
        gap = gap_frames(poses.measured, clip.fps)
        there = np.broadcast_to((poses.source != Source.ABSENT).any(-1, keepdims=True), poses.source.shape)
        person = np.broadcast_to(np.arange(poses.xyz.shape[1]), poses.xyz.shape[:2])
        return Joints(poses.skeleton, there, poses.source, poses.views, gap, person)
    parts = clip.truth.skeleton.parts
    truth = convert(clip.truth, next((part for part in parts if part.name == poses.skeleton.name), parts[-1]))
    poses = convert(poses, truth.skeleton)
    captured = poses.without(poses.source == Source.COMPLETED)
    comparison = Comparison(poses, captured, truth, tuple(range(truth.xyz.shape[1])), fps=clip.fps)
    return Joints(
        truth.skeleton,
        comparison.known,
        comparison.source,
        take_matched(poses.views, comparison.matches, 0),
        comparison.gap_lengths,
        comparison.matches,
        comparison,
    )


# Distances between joints, projected into cameras, and their detections

GATE_M = 0.4
"""m, at the median depth of the people in a camera, for bodies of a person's size. A detection with a larger mean
distance shows another person."""
_CHUNK = 256


@dataclass(frozen=True)
class Reprojection:
    """Reprojection errors, px, of joints that were measured and of those that were completed."""

    measured: Groups  # By "camera", "person", "joint" and "all"
    completed: Groups  # The same for completed joints
    worst: np.ndarray  # (F, P) largest error of a measured joint of each person in any camera; NaN where there is none
    where: np.ndarray  # (F, P, 2) indices of its camera and joint
    detections: int  # Number of detections in all cameras
    unused: int  # Number of detections that fit no captured person

    def describe_unused(self) -> str:
        """Say how many detections fit no captured person."""
        return f"{self.unused:,} of {self.detections:,} detections fit no captured person"


def reprojection(clip: Clip) -> Reprojection:
    """Return the errors between poses and, in each frame and camera, the detections that fit them best."""
    assert clip.poses is not None
    poses = convert(clip.poses, clip.detections.skeleton)
    poses = poses.without(np.isinf(poses.xyz).any(-1))
    frames, persons, joints = poses.source.shape
    detections = unused = 0
    measured: Groups = {}
    completed: Groups = {}
    worst, where = np.full((frames, persons), np.nan), np.zeros((frames, persons, 2), int)
    cuts: dict[str, dict[str, Any]] = {
        "camera": {name: np.s_[:, view] for view, name in enumerate(clip.rig.names)},
        "person": {person_name(person): np.s_[:, :, person] for person in range(persons)},
        "joint": {name: np.s_[..., joint] for joint, name in enumerate(poses.skeleton.joints)},
        "all": {"all": np.s_[:]},
    }

    def groups(error: np.ndarray, source: np.ndarray) -> Groups:
        return {
            name: {group: JointGroup.of(error[cut], source[cut]) for group, cut in parts.items()}
            for name, parts in cuts.items()
        }

    for start in in_steps(range(0, frames if persons else 0, _CHUNK)):
        part = slice(start, start + _CHUNK)
        error, used = reprojection_errors(clip.select(frames=part), poses.select(part))
        there = np.isfinite(clip.detections.score[part]).any(-1)
        detections, unused = detections + int(there.sum()), unused + int((there & ~used).sum())
        source = np.broadcast_to(poses.source[part][:, None], error.shape)
        is_completed = source == Source.COMPLETED
        measured = added(measured, groups(np.where(is_completed, np.nan, error), source))
        completed = added(completed, groups(np.where(is_completed, error, np.nan), source))
        flat = np.where(is_completed, np.nan, error).transpose(0, 2, 1, 3).reshape(len(error), persons, -1)
        largest = np.where(np.isnan(flat), -1, flat).argmax(-1)
        worst[part] = np.take_along_axis(flat, largest[..., None], -1)[..., 0]
        where[part] = np.stack(np.divmod(largest, joints), -1)
    return Reprojection(measured, completed, worst, where, detections, unused)


def reprojection_errors(clip: Clip, poses: Poses3D) -> tuple[np.ndarray, np.ndarray]:
    """Return the distances (F, V, P, J) between reprojected joints and the matched detection, px; and (F, V, D) True
    for matched detections."""
    pixels, depth = clip.rig.project(poses.xyz)
    errors, scale = np.full(pixels.shape[:-1], np.nan), scale_of(poses)
    used = np.zeros(clip.detections.score.shape[:-1], bool)
    for view in range(len(clip.rig)):
        known = np.isfinite(pixels[:, view]).all(-1)
        if not known.any():
            continue
        gate = scale * GATE_M * clip.rig.K[view, 0, 0] / np.median(depth[:, view][known])
        found = clip.detections.xy[:, view]
        matches = match(found, pixels[:, view], gate)
        errors[:, view] = np.linalg.norm(take_matched(found, matches) - pixels[:, view], axis=-1)
        frame, person = np.nonzero(matches >= 0)
        used[frame, view, matches[frame, person]] = True
    return errors, used


def residual_tables(measured: Groups, completed: Groups, names: Sequence[str]) -> list[Table]:
    """Return a table per breakdown: how far joints reproject from detections, px; completed joints if any."""
    some_completed = any(each.compared for groups in completed.values() for each in groups.values())
    tables = []
    for name in (name for name in names if name in measured):
        rows = []
        for group, each in measured[name].items():
            other = completed[name][group]  # the same cameras, persons and joints
            if each.compared or other.compared:
                figures = (each.mean, each.quantile(0.5), each.quantile(0.9))
                row = (group, f"{each.compared:,}", *(number_text(figure) for figure in figures))
                more = (f"{other.compared:,}", number_text(other.mean))
                rows.append(row + more if some_completed else row)
        header: tuple[str, ...] = (name, "measured", "mean px", "median px", "90 % under")
        if some_completed:
            header += ("completed", "completed mean px")
        if rows:
            tables.append(Table(f"By {name}", header, rows, bars=(2, 6) if some_completed else (2,)))
    return tables


# Signs that a joint is off, distances in metres; none needs the truth

_UNKNOWN = 0.2  # m; the error that is assumed for people if none is stated
_FRAMES = 200  # Frames that are compared at a time, so that memory stays flat
_REACH = 0.04  # s before and after a frame, between which a joint is interpolated

STATED, UNSTATED, BONE, JUMP, RESIDUAL = "stated error", "no stated error", "bone length", "jump", "reprojection"


def signs(clip: Clip) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return the signs of each joint by name, (F, P, J) m, 0 where a sign does not apply; and the number of cameras
    that detect the joint (F, P, J).

    - stated error: the square root of the trace of its covariance.
    - no stated error: 0.2 m for people if the covariance is not known; less for smaller bodies.
    - bone length: the largest deviation of its bones from their median length over the clip.
    - jump: its distance from the middle of its positions just before and just after, the largest in that time.
    - reprojection: the median distance from its detections, at its depth.
    """
    assert clip.poses is not None
    # Files cannot hold infinite coordinates, but users can.
    poses = clip.poses.without(np.isinf(clip.poses.xyz).any(-1))
    clip = replace(clip, poses=poses)
    stated = np.sqrt(np.trace(poses.cov.astype(np.float64), axis1=-2, axis2=-1))
    # Person 0 of one still is not person 0 of the next.
    nothing = np.zeros(poses.source.shape) if are_stills(clip.fps) else None
    residual, detected = _residual(clip)
    found = {
        STATED: np.nan_to_num(stated),
        UNSTATED: np.where(np.isnan(stated), _UNKNOWN * scale_of(poses), 0),
        BONE: _bone_deviation(poses) if nothing is None else nothing,
        JUMP: _jump(poses, clip.fps) if nothing is None else nothing,
        RESIDUAL: residual,
    }
    return found, detected


def _bone_deviation(poses: Poses3D) -> np.ndarray:
    bones, found = poses.skeleton.bones, np.zeros(poses.source.shape)
    lengths = bone_lengths(poses.xyz, bones)
    deviations = np.nan_to_num(np.abs(lengths - median_over_frames(lengths)))
    for number, bone in enumerate(bones):
        for end in bone:
            found[..., end] = np.maximum(found[..., end], deviations[..., number])
    return found


def _jump(poses: Poses3D, fps: float) -> np.ndarray:
    step = max(1, round(_REACH * fps))
    xyz = poses.xyz.astype(np.float64)
    found = np.zeros(poses.source.shape)
    if len(xyz) > 2 * step:
        middle = (xyz[2 * step :] + xyz[: -2 * step]) / 2
        found[step:-step] = np.nan_to_num(np.linalg.norm(xyz[step:-step] - middle, axis=-1))
    return maximum_filter1d(found, 4 * step + 1, axis=0, mode="constant")


def _residual(clip: Clip) -> tuple[np.ndarray, np.ndarray]:
    """Return the distance of joints from their detections (F, P, J), m, and the number of cameras with a detection."""
    assert clip.poses is not None
    skeleton = clip.detections.skeleton
    poses = convert(clip.poses, skeleton)
    found, detected = np.zeros(clip.poses.source.shape), np.zeros(clip.poses.source.shape, int)
    for start in range(0, len(clip), _FRAMES):
        part = slice(start, start + _FRAMES)
        some = poses.select(part)
        _, depth = clip.rig.project(some.xyz)
        metres = reprojection_errors(clip.select(frames=part), some)[0] * depth / clip.rig.K[:, 0, 0, None, None]
        cameras = np.isfinite(metres).sum(1)
        # Joints without any detection have residual 0.
        median = np.nan_to_num(median_over_frames(np.moveaxis(metres, 1, 0)))
        for index, joint in enumerate(clip.poses.skeleton.joints):
            if joint in skeleton.joints:
                found[part, :, index] = median[..., skeleton.joints.index(joint)]
                detected[part, :, index] = cameras[..., skeleton.joints.index(joint)]
    # Cameras that measured a joint detected it, though it may have been smoothed away from there since.
    return found, np.maximum(detected, clip.poses.views)


# The ranking of joints that may be off

_SECONDS = 0.2  # s; length of an entry


@dataclass(frozen=True)
class Doubt:
    """A joint of one person in a stretch of frames."""

    person: int  # Index of the captured person
    joint: str  # Name of the joint
    first: int  # Index of the first frame
    last: int  # Index of the last frame
    worst: int  # Index of the frame to look at
    # Root of the sum of the squared signs, averaged over the frames, m. It is a rank value, not an error bar.
    doubt: float
    reason: str  # The largest sign in the worst frame, with its size
    source: Source  # `Source` of the joint in the worst frame
    detected: int  # Number of cameras that detect it there
    views: int  # Number of cameras that agreed, from which the joint was measured

    def decision(self, verdict: ReviewVerdict | str) -> Decision:
        """Return a decision on this joint in these frames."""
        return Decision(self.person, self.joint, self.first, self.last, ReviewVerdict(verdict))


def rank_doubts(clip: Clip, decisions: Sequence[Decision] = ()) -> list[Doubt]:
    """Return entries of one joint over 0.2 s, the most doubtful first; joints with a decision are left out.

    Together the entries cover the captured or completed poses. Truth is not used. Raises ValueError without poses.
    """
    if clip.poses is None:
        raise ValueError(f"clip {clip.id!r} has no poses to review; run dmae capture on it first")
    poses, (found, detected) = clip.poses, signs(clip)
    total = np.sqrt(sum(sign**2 for sign in found.values()))
    open_ = (poses.source != Source.ABSENT) & ~decided(poses, decisions, *ReviewVerdict)
    length = max(1, round(_SECONDS * clip.fps))
    doubts = []
    for start in range(0, len(clip), length):
        part = slice(start, start + length)
        there = open_[part]
        for person, joint in np.argwhere(there.any(0)):
            frames = np.flatnonzero(there[:, person, joint])
            sizes = total[part][frames, person, joint]
            worst = start + int(frames[sizes.argmax()])
            reason = max(found, key=lambda name: found[name][worst, person, joint])
            doubts.append(
                Doubt(
                    person=int(person),
                    joint=poses.skeleton.joints[joint],
                    first=start + int(frames[0]),
                    last=start + int(frames[-1]),
                    worst=worst,
                    doubt=float(sizes.mean()),
                    reason=f"{reason} {1000 * found[reason][worst, person, joint]:.0f} mm",
                    source=Source(poses.source[worst, person, joint]),
                    detected=int(detected[worst, person, joint]),
                    views=int(poses.views[worst, person, joint]),
                )
            )
    return sorted(doubts, key=lambda doubt: -doubt.doubt)


# How well the ranking finds the wrong joints, where the truth is known

OFF = 100.0
"""mm; a joint is off if it is farther than this from the truth."""
FIRST = 0.1
"""Share of the entries that a reviewer looks at."""


@dataclass(frozen=True)
class RankingCheck:
    """Counts of the joints that are off, in the first entries of a ranking and in all."""

    off: int  # Number of joints that are off, counted in each frame
    found: int  # Number of these that are in the first entries
    first: int  # Number of the first entries
    entries: int  # Number of entries with joints that the truth has


def check_ranking(clip: Clip, ranking: Sequence[Doubt]) -> RankingCheck | None:
    """Return the number of joints that are off, in the first tenth of the entries and in all; None without truth.

    Joints that are not in the ranking, because there is a decision on them, do not count.

    The first tenth is one entry or more. Only joints with the same name in the skeletons of truth and poses count.
    """
    if clip.truth is None or not np.isfinite(clip.truth.xyz).any():
        return None
    poses, joints = clip.poses, joints_of(clip)
    assert poses is not None
    judged, off = np.zeros((2, *poses.source.shape), bool)
    for index, name in enumerate(joints.skeleton.joints):
        if name not in poses.skeleton.joints:
            continue
        counts = joints.counted[..., index] & (joints.person >= 0) & ~np.isnan(joints.error[..., index])
        frame, number = np.nonzero(counts)
        at = frame, joints.person[frame, number], poses.skeleton.joints.index(name)
        judged[at], off[at] = True, joints.error[frame, number, index] > OFF
    places = [(slice(d.first, d.last + 1), d.person, poses.skeleton.joints.index(d.joint)) for d in ranking]
    places = [place for place in places if judged[place].any()]
    first = places[: max(int(FIRST * len(places)), 1)]
    total, found = (int(sum(off[place].sum() for place in part)) for part in (places, first))
    return RankingCheck(total, found, len(first), len(places))


# What a report finds in one clip

BY_GAP, BY_JOINT, BY_CAUSE = "length of the gap", "joint", "cause of occlusion"
BY_SEEING, BY_MEASURING = "cameras that see the joint", "cameras that measured the joint"
_CAUSES = {
    Visibility.HIDDEN_BY_PERSON: "hidden by another person",
    Visibility.HIDDEN_BY_OBJECT: "hidden by an object",
    Visibility.HIDDEN_BY_SELF: "hidden by the own body",
    Visibility.OUTSIDE_IMAGE: "outside the image",
    Visibility.BEHIND_CAMERA: "behind the camera",
}
PROBABILITIES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
"""Stated probabilities of the regions; scores name 0.9."""
_DOUBTS = 40  # Number of doubtful joints that the page lists for a clip
_OF_A_KIND = 6  # Greatest number of moments of each kind
_MOST_JOINTS = 0.3  # A frame is a moment if at least this share of a person's joints is not measured


class State(StrEnum):
    """Processing state of a clip."""

    empty = "no frames"
    not_captured = "not captured"
    no_person = "no person found"
    captured = "captured"
    completed = "completed"


@dataclass(frozen=True)
class WorstMoment:
    """A frame to look at."""

    frame: int  # Index of the frame
    person: int | None  # Index of the captured person; None where a true person is missed
    kind: str  # Kind of the problem, as a heading
    what: str  # The problem with its joint or camera, in words
    size: float  # Size of the problem
    amount: str  # The size with its unit, as text


@dataclass(frozen=True)
class Findings:
    """Counts, errors and moments of one clip."""

    id: str  # Id of the clip
    state: State  # Processing state of the clip
    frames: int  # Number of frames
    fps: float  # Frames per second
    cameras: int  # Number of cameras
    people: int = 0  # Number of captured people
    # Number of joints of each `Source`, over the captured people in the frames in which a joint of theirs is known
    sources: dict[Source, int] = field(default_factory=dict)
    rejected: int = 0  # Number of completed joints that cameras measured, see `Poses3D.rejected`
    captured: Sequence[int] = ()  # (P,) numbers of frames in which cameras measured a joint of each person
    only_completed: Sequence[int] = ()  # (P,) numbers of frames in which they measured none, and some are completed
    detections: int = 0  # Number of detections in all cameras
    unused: int = 0  # Number of detections that fit no captured person
    has_truth: bool = False  # Whether the clip is compared with a truth
    skeleton: str = ""  # Skeleton on which joints are counted and compared
    has_images: bool = False  # Whether the clip refers to images
    # "all", "measured" and "completed" joints with their errors, mm
    against_truth: dict[str, JointGroup] = field(default_factory=dict)
    # Joints by gap, joint, cause and number of cameras, with their errors, mm, if there is a truth
    breakdowns: Groups = field(default_factory=dict)
    # Counts of joints in regions of stated probability, see `counts_in_regions`
    regions: dict[str, np.ndarray] = field(default_factory=dict)
    states_completed: bool = False  # Whether completed joints state a covariance
    truth_error: float | None = None  # Median error that the truth states of its joints, mm; None where it states none
    # Measured joints by camera, person and joint, with their reprojection errors, px
    residuals: Groups = field(default_factory=dict)
    residuals_completed: Groups = field(default_factory=dict)  # The same for completed joints
    moments: list[WorstMoment] = field(default_factory=list)  # The worst moments
    error: np.ndarray | None = None  # (F,) mean error of each frame, mm; None without truth
    # The joints that are most likely to be off, by signs that need no truth
    doubts: list[Doubt] = field(default_factory=list)
    poses_checksum: str = ""  # Checksum of the poses. Decisions on the poses refer to it.
    decisions: Sequence[Decision] = ()  # Earlier decisions on the poses
    # Height of the floor and direction of the vertical, estimated from the people; None without people
    floor: Floor | None = None

    def share(self, *sources: Source) -> float | None:
        """Return the share of joints that have one of these sources; None if there are no joints."""
        total = sum(self.sources.values())
        return sum(self.sources[source] for source in sources) / total if total else None


def examine(clip: Clip, decisions: Sequence[Decision] = ()) -> Findings:
    """Return the findings of the report in a clip, captured or not. Joints with a decision are not doubtful."""
    state = state_of(clip)
    facts: dict[str, Any] = {
        "id": clip.id,
        "state": state,
        "frames": len(clip),
        "fps": clip.fps,
        "cameras": len(clip.rig),
        "has_truth": clip.truth is not None and bool(np.isfinite(clip.truth.xyz).any()),
        "has_images": clip.has_images,
    }
    if state in (State.empty, State.not_captured, State.no_person):
        return Findings(**facts)
    assert clip.poses is not None
    joints, reprojected = joints_of(clip), reprojection(clip)
    there = (clip.poses.source != Source.ABSENT).any(-1)
    error = np.where(joints.counted, joints.error, np.nan)
    against_truth, truth_error = {}, None
    if clip.truth is not None and facts["has_truth"]:
        stated = likely_error(clip.truth.cov[np.isfinite(clip.truth.cov).all((-1, -2))])
        truth_error = 1000 * float(np.median(stated)) if len(stated) else None
        completed = joints.source == Source.COMPLETED
        measured = (joints.source == Source.MEASURED) | (joints.source == Source.DENOISED)
        kinds = {"all": joints.counted, "measured": joints.counted & measured, "completed": joints.counted & completed}
        against_truth = {name: JointGroup.of(error[kind], joints.source[kind]) for name, kind in kinds.items()}
    return Findings(
        **facts,
        people=int(there.any(0).sum()),
        sources={kind: int((clip.poses.source[there] == kind).sum()) for kind in Source},
        rejected=int(clip.poses.rejected.sum()),
        captured=clip.poses.captured.sum(0).tolist(),
        only_completed=clip.poses.only_completed.sum(0).tolist(),
        detections=reprojected.detections,
        unused=reprojected.unused,
        skeleton=joints.skeleton.name,
        against_truth=against_truth,
        breakdowns=breakdowns(clip, joints),
        regions=counts_in_regions(joints),
        states_completed=states_completed(clip.poses),
        truth_error=truth_error,
        residuals=reprojected.measured,
        residuals_completed=reprojected.completed,
        moments=worst_moments(clip, joints, reprojected),
        error=mean_known(error, (1, 2)) if facts["has_truth"] else None,
        doubts=rank_doubts(clip, decisions)[:_DOUBTS],
        poses_checksum=checksum(clip.poses),
        decisions=decisions,
        floor=find_floor(clip.poses, clip.fps),
    )


def state_of(clip: Clip) -> State:
    """Return the processing state of a clip."""
    if not len(clip):
        return State.empty
    if clip.poses is None:
        return State.not_captured
    if not (clip.poses.source != Source.ABSENT).any():
        return State.no_person
    return State.completed if (clip.poses.source == Source.COMPLETED).any() else State.captured


# Errors by length of gap, joint, cause of occlusion and number of cameras


def breakdowns(clip: Clip, joints: Joints) -> Groups:
    """Return the joints that count, by breakdown and group; groups without joints are left out."""
    missed = joints.person[..., None] < 0
    gaps = {"measured": (joints.gap == 0) & ~missed}
    for low, high in GAPS:
        name = f"{low}–{high} frames" if high else f"over {low - 1} frames"
        gaps[name] = (joints.gap >= low) & (joints.gap <= (high or np.inf)) & ~missed
    gaps["whole person missed"] = np.broadcast_to(missed, joints.gap.shape)
    names = joints.skeleton.joints
    found = {BY_GAP: gaps, BY_JOINT: {name: np.arange(len(names)) == joint for joint, name in enumerate(names)}}
    if clip.occlusion is None or clip.truth is None or joints.comparison is None:
        found[BY_MEASURING] = _by_number(joints.views, int(joints.views.max(initial=0)))
    else:
        labelled = clip.truth.skeleton
        part = "" if joints.skeleton.name == labelled.name else f"{joints.skeleton.name}."
        visibility = clip.occlusion.visibility[..., labelled.index(*(part + name for name in names))]
        found[BY_SEEING] = _by_number((visibility == Visibility.VISIBLE).sum(1), len(clip.rig))
        # The cause is the most frequent reason why cameras do not see a joint; in a tie, the first of `_CAUSES`.
        counts = np.stack([(visibility == cause).sum(1) for cause in _CAUSES])
        main = np.where(counts.any(0), counts.argmax(0), -1)
        found[BY_CAUSE] = {"seen by every camera": main == -1}
        found[BY_CAUSE] |= {f"mostly {name}": main == i for i, name in enumerate(_CAUSES.values())}
    tallies: Groups = {}
    for breakdown, groups in found.items():
        chosen = {name: joints.counted & group for name, group in groups.items()}
        tallies[breakdown] = {
            name: JointGroup.of(joints.error[group], joints.source[group])
            for name, group in chosen.items()
            if group.any()
        }
    return tallies


def _by_number(cameras: np.ndarray, most: int) -> dict[str, np.ndarray]:
    return {str(number or "none"): cameras == number for number in range(most + 1)}


def counts_in_regions(joints: Joints) -> dict[str, np.ndarray]:
    """Return by name, for measured and completed joints with covariance and truth, their number and in each region."""
    if joints.comparison is None:
        return {}
    error = (joints.comparison.matched - joints.comparison.truth.xyz).astype(np.float64)
    squared = squared_deviations(error, joints.comparison.cov)
    known = np.isfinite(squared) & joints.counted
    squared = squared[known]
    limits = 2 * gammaincinv(3 / 2, PROBABILITIES)  # quantiles of chi-squared with three degrees of freedom
    completed = joints.source[known] == Source.COMPLETED
    return {
        name: np.array([len(part), *(int((part <= limit).sum()) for limit in limits)])
        for name, part in (("measured joints", squared[~completed]), ("completed joints", squared[completed]))
        if len(part)
    }


# Worst moments


def worst_moments(clip: Clip, joints: Joints, reprojected: Reprojection) -> list[WorstMoment]:
    """Return at most six moments of each kind, the worst first, at least a second apart for one person."""
    assert clip.poses is not None
    apart = max(1, round(clip.fps))
    found = []
    if joints.comparison is not None:
        error = np.where(joints.counted, joints.error, np.nan)
        joint = np.where(np.isnan(error), -1, error).argmax(-1)
        largest = np.take_along_axis(error, joint[..., None], -1)[..., 0]
        for frame, number in peaks(largest, _OF_A_KIND, apart):
            at, size = joint[frame, number], float(largest[frame, number])
            what = f"{joints.skeleton.joints[at]}, {SOURCE_WORDS[Source(joints.source[frame, number, at])]}"
            found.append(WorstMoment(frame, int(joints.person[frame, number]), "error", what, size, f"{size:.0f} mm"))
        missed = joints.counted.any(-1) & (joints.person < 0)
        people = range(missed.shape[1])
        gaps = [(end - start, start, number) for number in people for start, end in runs(missed[:, number])]
        for length, start, number in sorted(gaps, reverse=True)[:_OF_A_KIND]:
            seconds = length / clip.fps
            found.append(WorstMoment(start, None, "missed", f"true {person_name(number)}", seconds, f"{seconds:.2f} s"))
    there = (clip.poses.source != Source.ABSENT).any(-1)
    count = len(clip.poses.skeleton)
    lacking = np.where(there, count - clip.poses.measured.sum(-1), 0).astype(float)
    lacking[lacking < max(1, _MOST_JOINTS * count)] = np.nan
    for frame, person in peaks(lacking, _OF_A_KIND, apart):
        size = int(lacking[frame, person])
        completed = int((clip.poses.source[frame, person] == Source.COMPLETED).sum())
        counts = {"completed": completed, "missing": size - completed}
        what = ", ".join(f"{word} {number}" for word, number in counts.items() if number)
        found.append(WorstMoment(frame, person, "not measured", what, size, f"{size} of {count} joints"))
    for frame, person in peaks(reprojected.worst, _OF_A_KIND, apart):
        view, at = reprojected.where[frame, person]
        size = float(reprojected.worst[frame, person])
        what = f"{clip.detections.skeleton.joints[at]}, {camera_label(clip.rig.names[view])}"
        found.append(WorstMoment(frame, person, "reprojection", what, size, f"{size:.0f} px"))
    return found


def peaks(values: np.ndarray, number: int, apart: int) -> list[tuple[int, int]]:
    """Return frame and column of the largest values (F, N), the largest first, `apart` frames apart in a column."""
    left = np.where(np.isfinite(values), values, -np.inf)
    found = []
    while len(found) < number and left.size and left.max() > -np.inf:
        frame, column = (int(i) for i in np.unravel_index(left.argmax(), left.shape))
        found.append((frame, column))
        left[max(0, frame - apart) : frame + apart + 1, column] = -np.inf
    return found
