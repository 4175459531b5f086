"""Errors by length of gap, joint, cause of occlusion, and number of cameras that see the joint."""

import numpy as np

from dmae.data.clip import Clip
from dmae.data.labels import Visibility
from dmae.evaluation.report.joint_groups import JointGroup, tally
from dmae.evaluation.report.joints import Joints
from dmae.metrics.position import GAPS

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
