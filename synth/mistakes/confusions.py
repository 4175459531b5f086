"""Joints and people taken for others: sides, neighbours, two for one and one for two."""

from itertools import combinations

import numpy as np

from dmae.clip import JointError, Visibility
from dmae.skeleton import BODY25
from synth.chance import in_bursts, unrest
from synth.mistakes.config import DetectorConfig
from synth.mistakes.errors import height
from synth.mistakes.parts import Effect, Luck, Seen, extent, joints_of, kind_of

_LEG_KINDS = ("knee", "ankle", "big_toe", "small_toe", "heel")
_LEGS = [i for i, joint in enumerate(BODY25.joints) if kind_of(joint) in _LEG_KINDS]
_ARMS = BODY25.index("l_elbow", "l_wrist", "r_elbow", "r_wrist")
_TORN = joints_of(
    dict.fromkeys(_LEG_KINDS, "leg") | {"elbow": "arm", "wrist": "arm", "nose": "head", "eye": "head", "ear": "head"},
    "trunk",
    sided=("leg", "arm"),
)  # fmt: skip
"""What two people that become one may have from either."""
_LIMBS = np.array([joints for name, joints in _TORN.items() if name != "trunk"])
_LOWER = np.array([kind_of(joint) in (*_LEG_KINDS, "hip", "mid_hip") for joint in BODY25.joints])
_LEFT = np.array([joint.startswith("l_") for joint in BODY25.joints])
_NEAR = 0.06
"""Of a person's height in the image: another's joint so near may be taken for one's own."""


def swapped(
    xy: np.ndarray, visibility: np.ndarray, hidden_by: np.ndarray, fps: float, config: DetectorConfig, luck: Luck
) -> np.ndarray:
    """(F, P, 25) index of the person on whose joint each joint of a person is found."""
    own = np.broadcast_to(np.arange(xy.shape[1])[:, None], visibility.shape)
    if not config.swap or xy.shape[1] < 2:
        return own.copy()
    # (F, P, P, 25): how far each is from the same joint of each other person.
    apart = np.linalg.norm(xy[:, :, None] - xy[:, None], axis=-1)
    apart = np.where(np.eye(xy.shape[1], dtype=bool)[..., None] | np.isnan(apart), np.inf, apart)
    near = apart.min(2) < _NEAR * height(xy)[..., None]
    other = np.where(near, apart.argmin(2), own)
    other = np.where(visibility == Visibility.HIDDEN_BY_PERSON, hidden_by, other)
    return np.where(
        in_bursts(config.swap, unrest(visibility.shape, fps, config.bursts, rng=luck(Effect.SWAP))), other, own
    )


def invert(seen: Seen, fps: float, config: DetectorConfig, luck: Luck) -> None:
    """Exchange left and right limbs, in place."""
    for share, limb, effect in (
        (config.leg_inversion, _LEGS, Effect.LEG_INVERSION),
        (config.arm_inversion, _ARMS, Effect.ARM_INVERSION),
    ):
        if not share:
            continue
        inverted = in_bursts(share, unrest(seen.score.shape[:2], fps, config.bursts, rng=luck(effect)))
        frame, person = (index[:, None] for index in np.nonzero(inverted))
        mirror = np.array(BODY25.mirror)[limb]
        for array in seen:
            array[frame, person, limb] = array[frame, person, mirror]
        seen.kind[frame, person, limb] = JointError.INVERTED


def merge(seen: Seen, fps: float, config: DetectorConfig, luck: Luck) -> None:
    """Make one of two people whose boxes in the image overlap, in place.

    Some limbs of the one take the place of those of the other; the rest is lost or is left as a detection.
    """
    frames, persons = seen.score.shape[:2]
    pairs = list(combinations(range(persons), 2))
    if not config.merge or not pairs:
        return
    rng = luck(Effect.MERGE)
    event, side, rest = np.moveaxis(unrest((frames, len(pairs), 3), fps, config.bursts, rng=rng), -1, 0)
    limbs = unrest((frames, len(pairs), len(_LIMBS)), fps, config.bursts, rng=rng) < 0
    low, high = extent(seen.xy)
    free = np.isfinite(seen.score).any(-1)
    for i, (a, b) in enumerate(pairs):
        both = np.clip(np.minimum(high[:, a], high[:, b]) - np.maximum(low[:, a], low[:, b]), 0, None).prod(-1)
        smaller = np.minimum((high[:, a] - low[:, a]).prod(-1), (high[:, b] - low[:, b]).prod(-1))
        overlap = both / np.maximum(smaller, 1e-9)
        frame = np.flatnonzero(in_bursts(config.merge * overlap, event[:, i]) & free[:, a] & free[:, b])
        free[frame, a] = free[frame, b] = False
        host = np.where(side[frame, i] < 0, a, b)
        guest = a + b - host
        given = (limbs[frame, i, :, None] & _LIMBS).any(1) & np.isfinite(seen.score[frame, guest])
        n, joint = np.nonzero(given)
        for array in seen:
            array[frame[n], host[n], joint] = array[frame[n], guest[n], joint]
        # A joint that the guest had from the host has come home.
        another = seen.owner[frame[n], host[n], joint] != host[n]
        seen.kind[frame[n], host[n], joint] = np.where(another, JointError.MERGED, JointError.GOOD)
        lost = given | ~in_bursts(config.merge_rest, rest[frame, i])[:, None]
        n, joint = np.nonzero(lost)
        seen.xy[frame[n], guest[n], joint], seen.score[frame[n], guest[n], joint] = np.nan, np.nan


def split(seen: Seen, fps: float, config: DetectorConfig, luck: Luck) -> Seen:
    """Take the lower or left part off people who fall in two pieces, in place, and return those parts (F, P, ...)."""
    level = unrest((*seen.score.shape[:2], 2), fps, config.bursts, rng=luck(Effect.SPLIT))
    event = in_bursts(config.split, level[..., 0])
    off = event[..., None] & np.where(level[..., 1, None] < 0, _LOWER, _LEFT)
    pieces = seen._replace(
        xy=np.where(off[..., None], seen.xy, np.nan),
        score=np.where(off, seen.score, np.nan),
        owner=seen.owner.copy(),
        kind=seen.kind.copy(),
    )
    seen.xy[off], seen.score[off] = np.nan, np.nan
    return pieces
