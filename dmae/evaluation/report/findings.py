"""What a report finds in one clip: counts, errors by group, uncertainty, reprojection, moments, doubtful joints."""

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from scipy.stats import chi2

from dmae.calibration.world import Floor, find_floor
from dmae.data.clip import Clip, Source, person_name
from dmae.data.labels import Visibility
from dmae.evaluation.report.joints import Groups, JointGroup, Joints, Reprojection, joints_of, reprojection, tally
from dmae.evaluation.review import Doubt, checksum, rank_doubts
from dmae.formats.poses import SOURCE_WORDS
from dmae.metrics.position import GAPS
from dmae.numerics.paths import runs
from dmae.numerics.statistics import likely_error, mean_known

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
"""Stated probabilities of the confidence regions; scores name 0.9."""
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
    # Number of joints of each `Source`, over the captured people in the frames in which they are present
    sources: dict[Source, int] = field(default_factory=dict)
    has_truth: bool = False  # Whether the clip is compared with a truth
    has_images: bool = False  # Whether the clip refers to images
    # "all", "measured" and "completed" joints with their errors, mm
    against_truth: dict[str, JointGroup] = field(default_factory=dict)
    # Joints by gap, joint, cause and number of cameras, with their errors, mm, if there is a truth
    breakdowns: Groups = field(default_factory=dict)
    # Counts of joints in confidence regions of stated probability, see `counts_in_regions`
    regions: dict[str, np.ndarray] = field(default_factory=dict)
    truth_error: float | None = None  # Median error that the truth states of its joints, mm; None where it states none
    # Measured joints by camera, person and joint, with their reprojection errors, px
    residuals: Groups = field(default_factory=dict)
    residuals_completed: Groups = field(default_factory=dict)  # The same for completed joints
    moments: list[WorstMoment] = field(default_factory=list)  # The worst moments
    error: np.ndarray | None = None  # (F,) mean error of each frame, mm; None without truth
    # The joints that are most likely to be off, by signs that need no truth
    doubts: list[Doubt] = field(default_factory=list)
    poses_checksum: str = ""  # Checksum of the poses. Decisions on the poses refer to it.
    # Height of the floor and direction of the vertical, estimated from the people; None without people
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
        "has_images": clip.has_pictures,
    }
    if state in (State.empty, State.not_captured, State.no_person):
        return Findings(**facts)
    joints, reprojected = joints_of(clip), reprojection(clip)
    there = (clip.poses.source != Source.ABSENT).any(-1)
    error = np.where(joints.counted, joints.error, np.nan)
    against_truth, truth_error = {}, None
    if facts["has_truth"]:
        stated = likely_error(clip.truth.cov[np.isfinite(clip.truth.cov).all((-1, -2))])
        truth_error = 1000 * float(np.median(stated)) if len(stated) else None
        completed = joints.source == Source.COMPLETED
        measured = (joints.source == Source.MEASURED) | (joints.source == Source.DENOISED)
        kinds = {"all": joints.counted, "measured": joints.counted & measured, "completed": joints.counted & completed}
        against_truth = {name: tally(error[kind], joints.source[kind]) for name, kind in kinds.items()}
    return Findings(
        **facts,
        people=int(there.any(0).sum()),
        sources={kind: int((clip.poses.source[there] == kind).sum()) for kind in Source},
        against_truth=against_truth,
        breakdowns=breakdowns(clip, joints),
        regions=counts_in_regions(joints),
        truth_error=truth_error,
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
    if clip.occlusion is None or joints.comparison is None:
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
            name: tally(joints.error[group], joints.source[group]) for name, group in chosen.items() if group.any()
        }
    return tallies


def _by_number(cameras: np.ndarray, most: int) -> dict[str, np.ndarray]:
    return {str(number or "none"): cameras == number for number in range(most + 1)}


def counts_in_regions(joints: Joints) -> dict[str, np.ndarray]:
    """Return by name, for measured and completed joints with covariance and truth, their number and in each region."""
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


# Worst moments


def worst_moments(clip: Clip, joints: Joints, reprojected: Reprojection) -> list[WorstMoment]:
    """Return at most six moments of each kind, the worst first, at least a second apart for one person."""
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
        what = f"{clip.detections.skeleton.joints[at]}, camera {clip.rig.names[view]}"
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
