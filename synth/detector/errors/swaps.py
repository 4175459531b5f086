"""Swaps: joints that are detected on the same joint of another person."""

from dataclasses import dataclass, replace

import numpy as np

from dmae.data.labels import JointError, Visibility
from dmae.numerics.statistics import bursts, multiscale_noise
from synth.detector.ranges import check_probabilities
from synth.detector.view import ErrorStream, View, height

_NEAR = 0.06
"""Fraction of a person's height in the image. The same joint of another person within this distance can be confused."""


@dataclass(frozen=True)
class Swaps:
    """Joints that are detected on the same joint of another person."""

    probability: float = 0.0
    """Probability of a swap, for a joint that is hidden by another person or has that person's near by."""

    def __post_init__(self):
        check_probabilities("swaps", self, ("probability",))

    def apply(self, view: View) -> View:
        persons = view.true_xy.shape[1]
        if not self.probability or persons < 2:
            return view
        xy, own = view.true_xy, view.owner
        # (F, P, P, 25): distance to the same joint of each other person.
        distance = np.linalg.norm(xy[:, :, None] - xy[:, None], axis=-1)
        distance = np.where(np.eye(persons, dtype=bool)[..., None] | np.isnan(distance), np.inf, distance)
        near = distance.min(2) < _NEAR * height(xy)[..., None]
        other = np.where(near, distance.argmin(2), own)
        other = np.where(view.visibility == Visibility.HIDDEN_BY_PERSON, view.occluder, other)
        noise = multiscale_noise(own.shape, view.fps, view.times.bursts, rng=view.random(ErrorStream.SWAP))
        owner = np.where(bursts(self.probability, noise), other, own)
        kind = np.where(owner == own, JointError.GOOD, JointError.SWAPPED).astype(np.uint8)
        swapped = np.take_along_axis(view.xy, owner[..., None].astype(int), 1)
        return replace(view, xy=swapped, owner=owner.astype(np.int16), kind=kind)
