"""Review of captured poses: signs of errors, a ranking of doubtful joints, and decisions of a reviewer on them."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.conversion import convert, scale_of
from dmae.data.json_values import decode
from dmae.files.contents import write_atomic
from dmae.files.structured import read_json

DECISIONS = "decisions.json"
FORMAT = 1


class ReviewVerdict(StrEnum):
    """The decision on a joint in some frames."""

    accept = "accept"
    """The joint is not changed."""
    blank = "blank"
    """The joint is left out of exports and of completed poses."""
    hand_back = "hand_back"
    """`dmae complete` completes it, as if no camera had measured it; until then exports leave it out."""


@dataclass(frozen=True)
class Decision:
    """A verdict on one joint of one person."""

    person: int  # Index of the captured person
    joint: str  # Name of the joint
    first: int  # Index of the first frame
    last: int  # Index of the last frame
    verdict: ReviewVerdict  # What to do with the joint in these frames


def save_decisions(folder: Path, poses: Poses3D, decisions: Sequence[Decision]) -> None:
    """Write decisions on the poses of a clip into its folder, over earlier ones.

    Raises ValueError if a decision names a person, joint or frame that the poses do not have.
    """
    for decision in decisions:
        _index(poses, decision)
    content = {"format": FORMAT, "poses": checksum(poses), "decisions": [asdict(each) for each in decisions]}
    write_atomic(Path(folder) / DECISIONS, json.dumps(content, indent=1) + "\n")


def load_decisions(folder: Path, poses: Poses3D | None) -> tuple[Decision, ...]:
    """Return the decisions on the poses of a clip in its folder, if any.

    Raises ValueError if the file is malformed, or its decisions were made on other poses than these.
    """
    path = Path(folder) / DECISIONS
    if not path.is_file():
        return ()
    content = read_json(path)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ValueError(f"{path}: expected decisions of format {FORMAT}, which dmae review writes")
    try:
        decisions = decode(tuple[Decision, ...], content.get("decisions"), "decisions")
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    if poses is None or content.get("poses") != checksum(poses):
        raise ValueError(
            f"{path}: its decisions were made on other poses than those of this clip; remove the file and review again"
        )
    for decision in decisions:
        try:
            _index(poses, decision)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
    return decisions


def decided(poses: Poses3D, decisions: Sequence[Decision], *verdicts: ReviewVerdict) -> np.ndarray:
    """Return (F, P, J) True where a decision has one of these verdicts. Later decisions override earlier ones."""
    found = np.zeros(poses.source.shape, bool)
    for decision in decisions:
        found[_index(poses, decision)] = decision.verdict in verdicts
    return found


def with_decisions(clip: Clip, folder: Path) -> Clip:
    """Return a clip without the joints that the decisions in its folder blank or hand back; see `load_decisions`."""
    decisions = load_decisions(folder, clip.poses)
    if not decisions:
        return clip
    return replace(
        clip, poses=clip.poses.without(decided(clip.poses, decisions, ReviewVerdict.blank, ReviewVerdict.hand_back))
    )


def checksum(poses: Poses3D) -> str:
    """Return a checksum of the positions and sources of the joints. Decisions refer to poses by this checksum."""
    digest = hashlib.sha256()
    for array in (poses.xyz, poses.source):
        digest.update(np.ascontiguousarray(array))
    return digest.hexdigest()


def _index(poses: Poses3D, decision: Decision) -> tuple[slice, int, int]:
    frames, persons, _ = poses.source.shape
    if decision.joint not in poses.skeleton.joints:
        raise ValueError(f"decision on joint {decision.joint!r}: {poses.skeleton.name} has no such joint")
    if not 0 <= decision.person < persons:
        raise ValueError(f"decision on person {decision.person}: expected 0 to {persons - 1}")
    if not 0 <= decision.first <= decision.last < frames:
        raise ValueError(
            f"decision on frames {decision.first} to {decision.last}: expected an order, and frames 0 to {frames - 1}"
        )
    return slice(decision.first, decision.last + 1), decision.person, poses.skeleton.joints.index(decision.joint)


# Signs that a joint is off, distances in metres; none needs the truth

_UNKNOWN = 0.2  # m; the error that is assumed for people if none is stated
_FRAMES = 200  # Frames that are compared at a time, so that memory stays flat
_REACH = 0.04  # s before and after a frame, between which a joint is interpolated

STATED, UNSTATED, BONE, JUMP, RESIDUAL = "stated error", "no stated error", "bone length", "jump", "reprojection"


def signs(clip: Clip) -> dict[str, np.ndarray]:
    """Return the signs of each joint by name, (F, P, J) m; 0 where a sign does not apply.

    - stated error: the square root of the trace of its covariance.
    - no stated error: 0.2 m for people if the covariance is not known; less for smaller bodies.
    - bone length: the largest deviation of its bones from their median length over the clip.
    - jump: its distance from the middle of its positions just before and just after, the largest in that time.
    - reprojection: the median distance from its detections, at its depth.
    """
    # Files cannot hold infinite coordinates, but users can.
    poses = clip.poses.without(np.isinf(clip.poses.xyz).any(-1))
    clip = replace(clip, poses=poses)
    stated = np.sqrt(np.trace(poses.cov.astype(np.float64), axis1=-2, axis2=-1))
    return {
        STATED: np.nan_to_num(stated),
        UNSTATED: np.where(np.isnan(stated), _UNKNOWN * scale_of(poses), 0),
        BONE: _bone_deviation(poses),
        JUMP: _jump(poses, clip.fps),
        RESIDUAL: _residual(clip),
    }


def _bone_deviation(poses: Poses3D) -> np.ndarray:
    parents = np.asarray(poses.skeleton.parents)
    children = np.flatnonzero(parents >= 0)
    xyz = poses.xyz.astype(np.float64)
    found = np.zeros(poses.source.shape)
    for child in children:
        length = np.linalg.norm(xyz[..., child, :] - xyz[..., parents[child], :], axis=-1)
        for person in range(length.shape[1]):
            if np.isfinite(length[:, person]).any():
                length[:, person] -= np.nanmedian(length[:, person])
        deviation = np.nan_to_num(np.abs(length))
        for end in (child, parents[child]):
            found[..., end] = np.maximum(found[..., end], deviation)
    return found


def _jump(poses: Poses3D, fps: float) -> np.ndarray:
    from scipy.ndimage import maximum_filter1d  # exports read decisions without it

    step = max(1, round(_REACH * fps))
    xyz = poses.xyz.astype(np.float64)
    found = np.zeros(poses.source.shape)
    if len(xyz) > 2 * step:
        middle = (xyz[2 * step :] + xyz[: -2 * step]) / 2
        found[step:-step] = np.nan_to_num(np.linalg.norm(xyz[step:-step] - middle, axis=-1))
    return maximum_filter1d(found, 4 * step + 1, axis=0, mode="constant")


def _residual(clip: Clip) -> np.ndarray:
    from dmae.evaluation.report.joints import reprojection_errors  # loads Numba; exports read decisions without it

    skeleton = clip.detections.skeleton
    poses = convert(clip.poses, skeleton)
    found = np.zeros(clip.poses.source.shape)
    for start in range(0, len(clip), _FRAMES):
        part = slice(start, start + _FRAMES)
        some = poses.select(part)
        _, depth = clip.rig.project(some.xyz)
        metres = reprojection_errors(clip.select(frames=part), some) * depth / clip.rig.K[:, 0, 0, None, None]
        # Joints without any detection have residual 0; `nanmedian` would warn of them.
        metres = np.where(np.isnan(metres).all(1, keepdims=True), 0, metres)
        median = np.nanmedian(metres, axis=1)
        for index, joint in enumerate(clip.poses.skeleton.joints):
            if joint in skeleton.joints:
                found[part, :, index] = median[..., skeleton.joints.index(joint)]
    return found


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
    views: int  # Number of cameras that measured it there

    def decision(self, verdict: ReviewVerdict | str) -> Decision:
        """Return a decision on this joint in these frames."""
        return Decision(self.person, self.joint, self.first, self.last, ReviewVerdict(verdict))


def rank_doubts(clip: Clip, decisions: Sequence[Decision] = ()) -> list[Doubt]:
    """Return entries of one joint over 0.2 s, the most doubtful first; joints with a decision are left out.

    Together the entries cover the captured or completed poses. Truth is not used. Raises ValueError without poses.
    """
    if clip.poses is None:
        raise ValueError(f"clip {clip.id!r} has no poses to review; run dmae capture on it first")
    poses, found = clip.poses, signs(clip)
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
    entries: int  # Number of entries with joints that the truth has


def check_ranking(clip: Clip, ranking: Sequence[Doubt]) -> RankingCheck | None:
    """Return the number of joints that are off, in the first tenth of the entries and in all; None without truth.

    Only joints with the same name in the skeletons of truth and poses count.
    """
    if clip.truth is None or not np.isfinite(clip.truth.xyz).any():
        return None
    from dmae.evaluation.report.joints import joints_of

    poses, joints = clip.poses, joints_of(clip)
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
    first = places[: int(FIRST * len(places))]
    return RankingCheck(int(off.sum()), int(sum(off[place].sum() for place in first)), len(places))
