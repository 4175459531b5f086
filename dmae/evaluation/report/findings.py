"""The worst moments of a clip: the largest errors, missed persons, and the fewest measured joints."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import reduce

import numpy as np
from scipy.stats import chi2

from dmae.calibration.world import Floor, find_floor
from dmae.data.clip import Clip, Source
from dmae.data.labels import Visibility
from dmae.evaluation.report.joints import JointGroup, Joints, Reprojection, added, joints_of, reprojection, tally
from dmae.evaluation.review import Doubt, checksum, rank_doubts
from dmae.metrics.position import GAPS
from dmae.numerics.statistics import mean_known

_OF_A_KIND = 6
"""Greatest number of moments of each kind."""
_MOST_JOINTS = 0.3
"""A frame is a moment if at least this share of a person's joints is not measured."""


@dataclass(frozen=True)
class WorstMoment:
    """A frame to look at.

    Attributes:
        frame: Index of the frame.
        person: Index of the captured person; None where a true person is missed.
        kind: Kind of the problem, as a heading.
        what: The problem with its joint or camera, in words.
        size: Size of the problem.
        amount: The size with its unit, as text.
    """

    frame: int
    person: int | None
    kind: str
    what: str
    size: float
    amount: str


def worst_moments(clip: Clip, joints: Joints, reprojected: Reprojection) -> list[WorstMoment]:
    """Return at most six moments of each kind, the worst first, at least a second apart for one person."""
    apart = max(1, round(clip.fps))
    found = []
    if joints.comparison is not None:
        found += _largest_errors(joints, apart)
        found += _missed_people(clip, joints)
    found += _least_measured(clip, apart)
    found += _largest_residuals(clip, reprojected, apart)
    return found


def _largest_errors(joints: Joints, apart: int) -> list[WorstMoment]:
    error = np.where(joints.counted, joints.error, np.nan)
    joint = np.where(np.isnan(error), -1, error).argmax(-1)
    largest = np.take_along_axis(error, joint[..., None], -1)[..., 0]
    moments = []
    for frame, number in peaks(largest, _OF_A_KIND, apart):
        at, size = joint[frame, number], float(largest[frame, number])
        what = f"{joints.skeleton.joints[at]}, {Source(joints.source[frame, number, at]).name.lower()}"
        moments.append(WorstMoment(frame, int(joints.person[frame, number]), "error", what, size, f"{size:.0f} mm"))
    return moments


def _missed_people(clip: Clip, joints: Joints) -> list[WorstMoment]:
    missed = joints.counted.any(-1) & (joints.person < 0)
    runs = sorted(((end - start, start, number) for number, start, end in runs_of(missed)), reverse=True)
    return [
        WorstMoment(start, None, "missed", f"true person {number}", length / clip.fps, f"{length / clip.fps:.2f} s")
        for length, start, number in runs[:_OF_A_KIND]
    ]


def _least_measured(clip: Clip, apart: int) -> list[WorstMoment]:
    there = (clip.poses.source != Source.ABSENT).any(-1)
    number = len(clip.poses.skeleton)
    lacking = np.where(there, number - clip.poses.measured.sum(-1), 0).astype(float)
    lacking[lacking < max(1, _MOST_JOINTS * number)] = np.nan
    moments = []
    for frame, person in peaks(lacking, _OF_A_KIND, apart):
        size = int(lacking[frame, person])
        completed = int((clip.poses.source[frame, person] == Source.COMPLETED).sum())
        counts = {"completed": completed, "missing": size - completed}
        what = ", ".join(f"{word} {count}" for word, count in counts.items() if count)
        moments.append(WorstMoment(frame, person, "not measured", what, size, f"{size} of {number} joints"))
    return moments


def _largest_residuals(clip: Clip, reprojected: Reprojection, apart: int) -> list[WorstMoment]:
    moments = []
    for frame, person in peaks(reprojected.worst, _OF_A_KIND, apart):
        view, joint = reprojected.where[frame, person]
        what = f"{clip.detections.skeleton.joints[joint]}, camera {clip.rig.names[view]}"
        size = float(reprojected.worst[frame, person])
        moments.append(WorstMoment(frame, person, "reprojection", what, size, f"{size:.0f} px"))
    return moments


def peaks(values: np.ndarray, number: int, apart: int) -> list[tuple[int, int]]:
    """Return frame and column of the largest values (F, N), the largest first, `apart` frames apart in a column."""
    left = np.where(np.isfinite(values), values, -np.inf)
    found = []
    while len(found) < number and left.size and left.max() > -np.inf:
        frame, column = (int(i) for i in np.unravel_index(left.argmax(), left.shape))
        found.append((frame, column))
        left[max(0, frame - apart) : frame + apart + 1, column] = -np.inf
    return found


def runs_of(flags: np.ndarray) -> list[tuple[int, int, int]]:
    """Return column, first frame and the frame after the last of each run of True in (F, N)."""
    edges = np.diff(np.pad(flags.astype(np.int8), ((1, 1), (0, 0))), axis=0)
    columns, starts = np.nonzero(edges.T == 1)
    _, ends = np.nonzero(edges.T == -1)
    return list(zip(columns.tolist(), starts.tolist(), ends.tolist(), strict=True))


# Errors by length of gap, joint, cause of occlusion, and number of cameras that see the joint.

BY_SOURCE, BY_GAP, BY_JOINT, BY_CAUSE = "source", "length of the gap", "joint", "cause of occlusion"
BY_SEEING, BY_MEASURING = "cameras that see the joint", "cameras that measured the joint"

_CAUSES = {
    Visibility.HIDDEN_BY_PERSON: "hidden by another person",
    Visibility.HIDDEN_BY_OBJECT: "hidden by an object",
    Visibility.HIDDEN_BY_SELF: "hidden by the own body",
    Visibility.OUTSIDE_IMAGE: "outside the image",
    Visibility.BEHIND_CAMERA: "behind the camera",
}


def breakdowns(clip: Clip, joints: Joints) -> dict[str, dict[str, JointGroup]]:
    """Return the tally of each group of each breakdown; groups without joints are left out."""
    names = joints.skeleton.joints
    groups = {
        BY_GAP: _by_gap(joints),
        BY_JOINT: {name: np.arange(len(names)) == joint for joint, name in enumerate(names)},
    }
    visibility = _visibility(clip, joints)
    if visibility is None:
        groups[BY_MEASURING] = {_cameras(n): joints.views == n for n in range(int(joints.views.max(initial=0)) + 1)}
    else:
        seeing = (visibility == Visibility.VISIBLE).sum(1)
        groups[BY_SEEING] = {_cameras(n): seeing == n for n in range(len(clip.rig) + 1)}
        groups[BY_CAUSE] = _by_cause(visibility)
    found = {}
    for breakdown, parts in groups.items():
        tallies = {name: tally(joints.error[chosen], joints.source[chosen]) for name, chosen in _counted(joints, parts)}
        found[breakdown] = {name: each for name, each in tallies.items() if each.joints}
    return found


def _counted(joints: Joints, parts: dict[str, np.ndarray]):
    return ((name, joints.counted & chosen) for name, chosen in parts.items())


def _cameras(number: int) -> str:
    return "none" if number == 0 else str(number)


def _by_gap(joints: Joints) -> dict[str, np.ndarray]:
    missed = joints.person[..., None] < 0
    parts = {"measured": (joints.gap == 0) & ~missed}
    for low, high in GAPS:
        name = f"{low}–{high} frames" if high else f"over {low - 1} frames"
        parts[name] = (joints.gap >= low) & (joints.gap <= (high or np.inf)) & ~missed
    return parts | {"whole person missed": np.broadcast_to(missed, joints.gap.shape)}


def _visibility(clip: Clip, joints: Joints) -> np.ndarray | None:
    """Return the visibility (F, V, N, J) of the joints that are compared; None where it is not labelled."""
    if clip.occlusion is None or joints.comparison is None:
        return None
    names, skeleton = clip.truth.skeleton.joints, joints.skeleton
    if skeleton.name != clip.truth.skeleton.name:
        names = [name.removeprefix(f"{skeleton.name}.") for name in names]
    index = [names.index(name) for name in skeleton.joints]
    return clip.occlusion.visibility[..., index]


def _by_cause(visibility: np.ndarray) -> dict[str, np.ndarray]:
    """Group joints by the most frequent reason why cameras do not see them. In a tie, use the first of `_CAUSES`."""
    counts = np.stack([(visibility == cause).sum(1) for cause in _CAUSES])
    main = np.where(counts.any(0), counts.argmax(0), -1)
    parts = {"seen by every camera": main == -1}
    return parts | {f"mostly {name}": main == i for i, name in enumerate(_CAUSES.values())}


# Calibration of uncertainty: how often the truth is in regions of a stated probability.

PROBABILITIES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
"""Of the regions; that of 0.9 is the one that scores name."""


def counts_in_regions(joints: Joints) -> dict[str, np.ndarray]:
    """Return the number of joints in each region, for measured and for completed joints with covariance and truth.

    Returns:
        Counts (1 + number of `PROBABILITIES`,) by name; the first is the number of joints. Empty without truth.
    """
    if joints.comparison is None:
        return {}
    error = (joints.comparison.matched - joints.comparison.truth.xyz).astype(np.float64)
    cov = joints.comparison.cov
    known = np.isfinite(error).all(-1) & np.isfinite(cov).all((-1, -2)) & joints.counted
    known[known] = np.linalg.det(cov[known].astype(np.float64)) > 0
    e = error[known]
    squared = (e * np.linalg.solve(cov[known].astype(np.float64), e[..., None])[..., 0]).sum(-1)
    limits = chi2.ppf(PROBABILITIES, 3)
    completed = joints.source[known] == Source.COMPLETED
    return {
        name: np.array([len(part), *(int((part <= limit).sum()) for limit in limits)])
        for name, part in (("measured joints", squared[~completed]), ("completed joints", squared[completed]))
        if len(part)
    }


# Findings of the report in one clip.

_DOUBTS = 40
"""Number of doubtful joints that the page lists for a clip."""


class State(StrEnum):
    """Processing state of a clip."""

    empty = "no frames"
    not_captured = "not captured"
    no_person = "no person found"
    captured = "captured"
    completed = "completed"


@dataclass(frozen=True)
class Findings:
    """Counts, errors and moments of one clip.

    Attributes:
        id: Id of the clip.
        state: Processing state of the clip.
        frames: Number of frames.
        fps: Frames per second.
        cameras: Number of cameras.
        people: Number of captured people.
        sources: Number of joints of each `Source`, over the captured people in the frames in which they are present.
        has_truth: Whether the clip is compared with a truth.
        has_images: Whether the clip refers to images.
        against_truth: Tallies of the errors, mm, of "all", "measured" and "completed" joints.
        breakdowns: Tallies by breakdown and group: of errors in mm with truth, only of counts without truth.
        regions: Counts of joints in confidence regions of stated probability.
        residuals: Tallies of reprojection errors of measured joints, px, by breakdown and group.
        residuals_completed: The same for completed joints.
        moments: The worst moments.
        error: (F,) mean error of each frame, mm; None without truth.
        doubts: The joints that are most likely to be off, by signs that need no truth.
        poses_checksum: Checksum of the poses. Decisions on the poses refer to it.
        floor: Height of the floor and direction of the vertical, estimated from the people; None without people.
    """

    id: str
    state: State
    frames: int
    fps: float
    cameras: int
    people: int = 0
    sources: dict[Source, int] = field(default_factory=dict)
    has_truth: bool = False
    has_images: bool = False
    against_truth: dict[str, JointGroup] = field(default_factory=dict)
    breakdowns: dict[str, dict[str, JointGroup]] = field(default_factory=dict)
    regions: dict[str, np.ndarray] = field(default_factory=dict)
    residuals: dict[str, dict[str, JointGroup]] = field(default_factory=dict)
    residuals_completed: dict[str, dict[str, JointGroup]] = field(default_factory=dict)
    moments: list[WorstMoment] = field(default_factory=list)
    error: np.ndarray | None = None
    doubts: list[Doubt] = field(default_factory=list)
    poses_checksum: str = ""
    floor: Floor | None = None

    def share(self, *sources: Source) -> float | None:
        """Return the share of joints that have one of these sources; None if there are no joints."""
        total = sum(self.sources.values())
        return sum(self.sources[source] for source in sources) / total if total else None


def examine(clip: Clip) -> Findings:
    """Return the findings of the report in a clip, captured or not."""
    state = state_of(clip)
    facts = {
        "id": clip.id,
        "state": state,
        "frames": len(clip),
        "fps": clip.fps,
        "cameras": len(clip.rig),
        "has_truth": clip.truth is not None and bool(np.isfinite(clip.truth.xyz).any()),
        "has_images": clip.images is not None and "rgb" in clip.images.kinds,
    }
    if state in (State.empty, State.not_captured, State.no_person):
        return Findings(**facts)
    joints = joints_of(clip)
    reprojected = reprojection(clip)
    there = (clip.poses.source != Source.ABSENT).any(-1)
    error = np.where(joints.counted, joints.error, np.nan)
    return Findings(
        **facts,
        people=int(there.any(0).sum()),
        sources={kind: int((clip.poses.source[there] == kind).sum()) for kind in Source},
        against_truth=_against_truth(error, joints.source, joints.counted) if facts["has_truth"] else {},
        breakdowns=breakdowns(clip, joints),
        regions=counts_in_regions(joints),
        residuals=reprojected.measured,
        residuals_completed=reprojected.completed,
        moments=worst_moments(clip, joints, reprojected),
        error=mean_known(error, (1, 2)) if facts["has_truth"] else None,
        doubts=rank_doubts(clip)[:_DOUBTS],
        poses_checksum=checksum(clip.poses),
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


def _against_truth(error: np.ndarray, source: np.ndarray, counted: np.ndarray) -> dict[str, JointGroup]:
    completed = source == Source.COMPLETED
    measured = (source == Source.MEASURED) | (source == Source.DENOISED)
    chosen = {"all": counted, "measured": counted & measured, "completed": counted & completed}
    return {name: tally(error[part], source[part]) for name, part in chosen.items()}


# Pool the findings of several clips: counts are added, moments and people stay with their clips.

Groups = dict[str, dict[str, JointGroup]]
"""Tallies by breakdown and group."""


def pooled_groups(findings: Sequence[Findings], name: str) -> Groups:
    """Return the tallies of a field of `Findings` ("breakdowns", "residuals", ...), added up over clips."""
    return reduce(added_groups, (getattr(each, name) for each in findings), {})


def pooled_truth(findings: Sequence[Findings]) -> dict[str, JointGroup]:
    """Return the tallies against the truth, added up over the clips that have one."""
    return reduce(added, (each.against_truth for each in findings), {})


def pooled_regions(findings: Sequence[Findings]) -> dict[str, np.ndarray]:
    """Return the counts in regions of stated probability, added up over clips."""
    total: dict[str, np.ndarray] = {}
    for each in findings:
        for name, counts in each.regions.items():
            total[name] = total.get(name, 0) + counts
    return total


def added_groups(first: Groups, second: Groups) -> Groups:
    """Return the tallies of two sets of clips as one."""
    return {name: added(first.get(name, {}), second.get(name, {})) for name in {**first, **second}}
