"""Limbs: the limb to which each joint of a skeleton belongs."""

import numpy as np

from dmae.data.skeleton import Skeleton

_LIMBS = {
    "arm": ("elbow", "wrist", "hand", "thumb"),
    "leg": ("knee", "ankle", "toe", "heel", "foot"),
    "head": ("nose", "eye", "ear", "head"),
}


def limb_of_joint(skeleton: Skeleton) -> np.ndarray:
    """Return the number (J,) of the limb of each joint: an arm, a leg, the head, or the trunk, counted from 0."""
    limbs = [_limb(joint.rpartition(".")[2]) for joint in skeleton.joints]
    return np.unique(limbs, return_inverse=True)[1]


def _limb(joint: str) -> str:
    for limb, parts in _LIMBS.items():
        if any(part in joint for part in parts):
            return limb if limb == "head" else joint[:2] + limb
    return "trunk"
