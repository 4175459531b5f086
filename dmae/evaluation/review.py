"""Decisions of a reviewer on captured poses. What is doubtful in them, `dmae.evaluation.report.findings` ranks."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip, Poses3D
from dmae.data.typed import decode
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
    """`dmae complete` completes it, as if it had not been measured; until then exports leave it out."""


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
    write_atomic(Path(folder) / DECISIONS, json.dumps(decisions_content(checksum(poses), decisions), indent=1) + "\n")


def decisions_content(poses: str, decisions: Sequence[Decision]) -> dict:
    """Return the content of the file of decisions on poses with this checksum."""
    return {"format": FORMAT, "poses": poses, "decisions": [asdict(each) for each in decisions]}


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
            f"{path}: its decisions were made on other poses than this clip has; remove the file and review again"
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
        index = _index(poses, decision)
        found[index] = decision.verdict in verdicts
    return found


def with_decisions(clip: Clip, folder: Path) -> Clip:
    """Return a clip without the joints that the decisions in its folder blank or hand back; see `load_decisions`."""
    decisions = load_decisions(folder, clip.poses)
    return without_decided(clip, decisions) if decisions else clip


def without_decided(clip: Clip, decisions: Sequence[Decision]) -> Clip:
    """Return a clip without the joints that decisions blank or hand back."""
    assert clip.poses is not None
    left_out = decided(clip.poses, decisions, ReviewVerdict.blank, ReviewVerdict.hand_back)
    return replace(clip, poses=clip.poses.without(left_out))


def checksum(poses: Poses3D) -> str:
    """Return a checksum of the positions and sources of the joints. Decisions refer to poses by this checksum."""
    digest = hashlib.sha256()
    for array in (poses.xyz, poses.source):
        digest.update(np.ascontiguousarray(array).data)
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
