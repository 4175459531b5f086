"""Merges: two persons that become one detection."""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from dmae.data.labels import JointError
from dmae.numerics.statistics import bursts, multiscale_noise
from synth.detector.parts import LEG_KINDS, joint_groups
from synth.detector.ranges import check_probabilities
from synth.detector.view import ErrorStream, View, box

_GROUPS = joint_groups(
    dict.fromkeys(LEG_KINDS, "leg") | {"elbow": "arm", "wrist": "arm", "nose": "head", "eye": "head", "ear": "head"},
    "trunk",
    sided=("leg", "arm"),
)  # fmt: skip
_LIMBS = np.array([joints for name, joints in _GROUPS.items() if name != "trunk"])
"""(limbs, 25) True for the joints of each limb that a merged detection can have from either person."""


@dataclass(frozen=True)
class Merges:
    """Two persons of overlapping boxes that become one detection. Some limbs are those of the other person."""

    probability: float = 0.0
    """Probability of a merge where the box of one person in the image lies within the other's; less where they overlap
    less."""
    remainder: float = 0.5
    """Probability that the other person's remaining joints are reported as well."""

    def __post_init__(self):
        check_probabilities("merges", self, ("probability", "remainder"))

    def apply(self, view: View) -> View:
        frames, persons = view.score.shape[:2]
        pairs = list(combinations(range(persons), 2))
        if not self.probability or not pairs:
            return view
        rng, times = view.random(ErrorStream.MERGE), view.times.bursts
        event, side, rest = np.moveaxis(multiscale_noise((frames, len(pairs), 3), view.fps, times, rng=rng), -1, 0)
        limbs = multiscale_noise((frames, len(pairs), len(_LIMBS)), view.fps, times, rng=rng) < 0
        low, high = box(view.xy)
        free = view.observed.any(-1)
        arrays = {name: getattr(view, name).copy() for name in ("xy", "score", "owner", "kind")}
        for i, (a, b) in enumerate(pairs):
            both = np.clip(np.minimum(high[:, a], high[:, b]) - np.maximum(low[:, a], low[:, b]), 0, None).prod(-1)
            smaller = np.minimum((high[:, a] - low[:, a]).prod(-1), (high[:, b] - low[:, b]).prod(-1))
            overlap = both / np.maximum(smaller, 1e-9)
            frame = np.flatnonzero(bursts(self.probability * overlap, event[:, i]) & free[:, a] & free[:, b])
            free[frame, a] = free[frame, b] = False
            host = np.where(side[frame, i] < 0, a, b)
            keep_rest = bursts(self.remainder, rest[frame, i])
            _merge(arrays, frame, host, a + b - host, limbs[frame, i], keep_rest)
        return replace(view, **arrays)


def _merge(arrays: dict[str, np.ndarray], frame, host, guest, limbs, keep_rest) -> None:
    """Move limbs of the guest to the host, in place.

    Args:
        arrays: `xy`, `score`, `owner` and `kind` of the view.
        frame, host, guest: (n,) frames, and the persons merged in them.
        limbs: (n, limbs) True for the limbs that the host gets from the guest.
        keep_rest: (n,) True where the rest of the guest is reported as well.
    """
    given = (limbs[..., None] & _LIMBS).any(1) & np.isfinite(arrays["score"][frame, guest])
    n, joint = np.nonzero(given)
    for array in arrays.values():
        array[frame[n], host[n], joint] = array[frame[n], guest[n], joint]
    # A joint of the host that was swapped onto the guest returns to the host.
    another = arrays["owner"][frame[n], host[n], joint] != host[n]
    arrays["kind"][frame[n], host[n], joint] = np.where(another, JointError.MERGED, JointError.GOOD)
    n, joint = np.nonzero(given | ~keep_rest[:, None])
    arrays["xy"][frame[n], guest[n], joint], arrays["score"][frame[n], guest[n], joint] = np.nan, np.nan
