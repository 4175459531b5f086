"""Joints and people that a detector misses."""

import numpy as np

from dmae.clip import Visibility
from dmae.skeleton import BODY25
from synth.chance import in_bursts, unrest
from synth.mistakes.config import DetectorConfig
from synth.mistakes.parts import Effect, Luck, by_joint, joints_of, kind_of

_MISSED_TOGETHER = np.array(
    list(
        joints_of(
            {"elbow": "arm", "wrist": "arm", "knee": "leg", "ankle": "leg", "heel": "leg", "big_toe": "foot",
             "small_toe": "foot", "nose": "face", "eye": "face", "ear": "face"},
            "trunk",
            sided=("arm", "leg", "foot"),
        ).values()
    )
)  # fmt: skip
"""(limbs, 25) True for the joints of each."""
_LIMB = _MISSED_TOGETHER.argmax(0)
_OF_FACE = np.array([kind_of(joint) in ("nose", "eye", "ear") for joint in BODY25.joints])
_HANGING = tuple(
    (joints, inner)
    for side in ("l_", "r_")
    for joints, inner in (
        ([side + "wrist"], [side + "elbow"]),
        ([side + "ankle"], [side + "knee"]),
        ([side + "big_toe", side + "small_toe", side + "heel"], [side + "ankle"]),
        ([side + "eye"], ["nose"]),
        # OpenPose joins ears to shoulders as well, so that they are found from behind.
        ([side + "ear"], [side + "eye", side + "shoulder"]),
    )
)
"""Which joints hang on which, from the inside outwards."""


def misses(visibility: np.ndarray, fps: float, config: DetectorConfig, luck: Luck) -> np.ndarray:
    """(F, P, 25) True for joints that are missed: alone, with their limb, with the whole person."""
    missed = _alone_and_in_limbs(visibility, fps, config, rng=luck(Effect.MISS))
    if config.hanging:
        level = unrest((*visibility.shape[:2], len(_HANGING)), fps, config.bursts, rng=luck(Effect.HANGING))
        torn = in_bursts(config.hanging, level)
        for i, (joints, inner) in enumerate(_HANGING):
            lost = missed[..., BODY25.index(*inner)].all(-1) & torn[..., i]
            missed[..., BODY25.index(*joints)] |= lost[..., None]
    if config.person_miss or config.person_miss_hidden:
        hidden = (visibility != Visibility.VISIBLE).mean(-1)
        growth = config.person_miss_hidden - config.person_miss
        level = unrest(visibility.shape[:2], fps, config.bursts, rng=luck(Effect.PERSON_MISS))
        missed |= in_bursts(config.person_miss + growth * hidden**3, level)[..., None]
    return missed


def _alone_and_in_limbs(visibility, fps, config, *, rng) -> np.ndarray:
    frames, persons, joints = visibility.shape
    limbs = unrest((frames, persons, len(_MISSED_TOGETHER)), fps, config.bursts, rng=rng)[..., _LIMB]
    alone = unrest(visibility.shape, fps, config.bursts, rng=rng)
    level = np.sqrt(config.together) * limbs + np.sqrt(1 - config.together) * alone
    outside = visibility > Visibility.HIDDEN_BY_OBJECT
    share = by_joint(config)["miss"][np.arange(joints), np.where(outside, Visibility.VISIBLE, visibility)]
    # What hides half a limb makes the other half hard to tell; half a face is told as well as a whole one.
    of_limb = np.stack([share[..., limb].mean(-1) for limb in _MISSED_TOGETHER], -1)[..., _LIMB]
    apart = (share == 0) | (share == 1) | _OF_FACE
    return outside | in_bursts(np.where(apart, share, (share + of_limb) / 2), level)
