"""Compare the motion of generated and recorded people by distributions of kinematic quantities."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import ks_2samp, wasserstein_distance

from dmae.progress import progress
from synth.datasets.motion_tracks import Track
from synth.motion.kinematics import QUANTITIES, Quantity, kinematics

MIN_SECONDS = 0.4
"""Shortest length of a track, s. Shorter tracks have no reliable accelerations."""
_SPLITS = 20
_QUANTILES = (0.05, 0.5, 0.95)


@dataclass(frozen=True)
class Sample:
    """The kinematics of a track.

    Attributes:
        name: Name of the track.
        seconds: Duration that is used, s.
        values: Values of each of `QUANTITIES`, evenly spaced over the track, in order of time.
    """

    name: str
    seconds: float
    values: dict[str, np.ndarray]


@dataclass(frozen=True)
class Difference:
    """One quantity of recorded and generated tracks.

    Attributes:
        quantity: The quantity.
        real, sim: Quantiles of 5, 50 and 95 %.
        wasserstein: Wasserstein-1 distance, in the quantity's unit.
        ks: Kolmogorov-Smirnov distance: the greatest difference of the distribution functions.
        halves_wasserstein, halves_ks: The same distances between two random halves of the recorded tracks, medians
            over many draws. NaN where almost no track has the quantity.
    """

    quantity: Quantity
    real: tuple[float, float, float]
    sim: tuple[float, float, float]
    wasserstein: float
    ks: float
    halves_wasserstein: float
    halves_ks: float

    @property
    def ratio(self) -> float:
        """The ratio of the distance to the distance between halves of the recordings."""
        return self.wasserstein / self.halves_wasserstein if self.halves_wasserstein else np.inf


def measure(tracks: Sequence[Track], longest: float) -> list[Sample]:
    """Measure the kinematics of every track that is long enough. At most `longest` s of each track are used.

    Raises:
        ValueError: no track is long enough.
    """
    samples = []
    for track in progress([track for track in tracks if track.seconds >= MIN_SECONDS], "measuring"):
        seconds, values = min(track.seconds, longest), {}
        for name, array in kinematics(track.xyz, track.fps).items():
            known = array[~np.isnan(array)]
            count = min(round(seconds * track.fps) * (array.size // len(array)), len(known))
            values[name] = known[np.linspace(0, len(known) - 1, count).round().astype(int)]
        samples.append(Sample(track.name, seconds, values))
    if not samples:
        lengths = ", ".join(f"{track.name} {track.seconds:.2f} s" for track in tracks) or "no tracks"
        raise ValueError(f"expected a track of {MIN_SECONDS} s or more, found {lengths}")
    return samples


def compare(real: Sequence[Sample], sim: Sequence[Sample], *, rng: np.random.Generator) -> list[Difference]:
    """Compare recorded and generated tracks in every quantity that both have.

    Args:
        real: Recorded tracks. The halves of a single track are the first and the second half of its time.
        sim: Generated tracks.
        rng: Draws halves of the recorded tracks.
    """
    pieces = max(1, 2 // len(real))
    orders = [rng.permutation(len(real) * pieces) for _ in range(_SPLITS)]
    differences = []
    for quantity in progress(QUANTITIES, "comparing"):
        parts = [part for each in real for part in np.array_split(each.values[quantity.name], pieces)]
        both = np.concatenate(parts), np.concatenate([each.values[quantity.name] for each in sim])
        if not min(map(len, both)):
            continue
        quantiles = (tuple(map(float, np.quantile(values, _QUANTILES))) for values in both)
        halves = [
            _distances(*(np.concatenate([parts[i] for i in half]) for half in np.array_split(order, 2)))
            for order in orders
        ]
        differences.append(Difference(quantity, *quantiles, *_distances(*both), *map(float, np.median(halves, axis=0))))
    return differences


def _distances(one: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """Return the Wasserstein and Kolmogorov-Smirnov distances; NaN if one sample is empty."""
    if not min(len(one), len(other)):
        return np.nan, np.nan
    return float(wasserstein_distance(one, other)), float(ks_2samp(one, other, method="asymp").statistic)
