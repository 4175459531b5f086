"""Findings of the report in one clip."""

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from dmae.calibration.world.floor import Floor, find_floor
from dmae.data.clip import Clip, Source
from dmae.evaluation.report.breakdown import breakdowns
from dmae.evaluation.report.joint_groups import JointGroup, tally
from dmae.evaluation.report.joints import joints_of
from dmae.evaluation.report.moments import WorstMoment, worst_moments
from dmae.evaluation.report.reprojection import reprojection
from dmae.evaluation.report.stated_uncertainty import counts_in_regions
from dmae.evaluation.review.decisions import checksum
from dmae.evaluation.review.ranking import Doubt, rank_doubts
from dmae.numerics.statistics import mean_known

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
