"""Do generated people move as recorded ones do? Distributions of what is measured of both, and their distances."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import ks_2samp, wasserstein_distance

from dmae.progress import progress
from synth.kinematics import QUANTITIES, Quantity, kinematics
from synth.tracks import Track

LEAST = 0.4
"""What is shorter tells nothing of accelerations, s."""
_SPLITS = 20
_SHARES = (0.05, 0.5, 0.95)


@dataclass(frozen=True)
class Sample:
    """What was measured of a track.

    Attributes:
        name: Of the track.
        seconds: For how many it counts.
        values: Of each of `QUANTITIES`, spread evenly over the track, in order of time.
    """

    name: str
    seconds: float
    values: dict[str, np.ndarray]


@dataclass(frozen=True)
class Difference:
    """One quantity of both.

    Attributes:
        quantity: What was measured.
        real, sim: Quantiles of 5, 50 and 95 %.
        wasserstein: Wasserstein-1 distance, in the quantity's unit.
        ks: Kolmogorov-Smirnov distance: by how much the shares below some value differ at most.
        halves_wasserstein, halves_ks: The same of one half of the recorded tracks from the other, medians over random
            halves: how far apart like and like are. NaN where hardly a track tells of it.
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
        """How many times as far apart as halves of the recordings."""
        return self.wasserstein / self.halves_wasserstein if self.halves_wasserstein else np.inf


def measure(tracks: Sequence[Track], longest: float) -> list[Sample]:
    """What every track tells that is long enough to tell anything.

    Raises:
        ValueError: none is.
    """
    samples = []
    for track in progress([track for track in tracks if track.seconds >= LEAST], "measuring"):
        seconds, values = min(track.seconds, longest), {}
        for name, array in kinematics(track.xyz, track.fps).items():
            known = array[~np.isnan(array)]
            count = min(round(seconds * track.fps) * (array.size // len(array)), len(known))
            values[name] = known[np.linspace(0, len(known) - 1, count).round().astype(int)]
        samples.append(Sample(track.name, seconds, values))
    if not samples:
        lengths = ", ".join(f"{track.name} {track.seconds:.2f} s" for track in tracks) or "nobody at all"
        raise ValueError(f"expected somebody to be seen for {LEAST} s or more, found {lengths}")
    return samples


def compare(real: Sequence[Sample], sim: Sequence[Sample], *, rng: np.random.Generator) -> list[Difference]:
    """How far apart both are in every quantity that both tell of.

    Args:
        real: Of recorded tracks; of a single one, the first half of the time stands against the second.
        sim: Of simulated ones.
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
        quantiles = (tuple(map(float, np.quantile(values, _SHARES))) for values in both)
        halves = [
            _distances(*(np.concatenate([parts[i] for i in half]) for half in np.array_split(order, 2)))
            for order in orders
        ]
        differences.append(Difference(quantity, *quantiles, *_distances(*both), *map(float, np.median(halves, axis=0))))
    return differences


def _distances(one: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """Wasserstein's and Kolmogorov-Smirnov's; NaN where one is empty."""
    if not min(len(one), len(other)):
        return np.nan, np.nan
    return float(wasserstein_distance(one, other)), float(ks_2samp(one, other, method="asymp").statistic)
