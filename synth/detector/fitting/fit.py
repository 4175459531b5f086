"""Fit a detector's preset to a recording: simulate, measure both in the same way, correct, repeat.

The measurement of a recording is biased: errors are measured against other views, and misses only for people that are
detected at all. So no parameter can be read off directly. Instead, the detector is run on simulated clips, both are
measured by `synth.detector.statistics.measure`, and each parameter is corrected by the difference of its own statistic.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dmae.data.clip import Clip
from dmae.data.rng import Stream, generator
from dmae.progress import progress
from synth.detector.config import DetectorConfig
from synth.detector.fitting.corrections import ENOUGH, corrected, error_quantile
from synth.detector.pooling import measure_all
from synth.detector.simulated_detector import detect
from synth.detector.statistics import DetectorStatistics, ErrorReference

_FEW_MISSES = 50
"""Fewest uninterrupted misses for the burst times to be fitted."""


@dataclass(frozen=True)
class Fit:
    """A fitted preset.

    Attributes:
        config: The detector.
        undetermined: Parameters that are not changed, and the reason why the recording does not determine each.
        statistics: Statistics of the clips that were simulated with this detector.
    """

    config: DetectorConfig
    undetermined: dict[str, str]
    statistics: DetectorStatistics


def redetect(clip: Clip, config: DetectorConfig, seed: int) -> Clip:
    """Return the clip with new detections, from the simulated detector `config`."""
    rng = generator(seed, int(clip.id), Stream.DETECTOR)
    rig = clip.true_rig or clip.rig
    detected = detect(clip.truth, clip.occlusion, rig, clip.fps, config, rng=rng)
    return replace(clip, detections=detected.detections, detection_labels=detected.labels)


def fit(
    real: DetectorStatistics,
    clips: Sequence[Clip],
    start: DetectorConfig,
    *,
    rounds: int = 8,
    seed: int = 0,
    workers: int = 1,
    reference: ErrorReference = ErrorReference.others,
) -> Fit:
    """Fit a detector to the measured statistics of a recording.

    Args:
        real: Statistics of the recording.
        clips: Simulated clips with truth and visibility, of a scene similar to the recording's.
        start: Start of the fit. Parameters that the recording does not determine keep its values.
        rounds: Number of simulations; each takes as long as measuring the clips.
        seed: Seed of the detector, the same in all rounds.
        workers: Processes; -1 for one per core.
        reference: Reference for the detections of the clips, the same as for the recording.

    Raises:
        ValueError: the clips have no visibility labels, or another skeleton than the recording.
    """
    for clip in clips:
        if clip.occlusion is None:
            raise ValueError(f"clip {clip.id!r}: a detector is fitted on simulated clips; it has no visibility")
    undetermined = _undetermined(real)
    config, best = start, None
    for _ in progress(range(rounds), "fitting the detector"):
        sim = measure_all((redetect(clip, config, seed) for clip in clips), len(clips), workers, reference)
        if sim.kinds != real.kinds:
            raise ValueError(f"the recording has joints {list(real.kinds)}, the simulation {list(sim.kinds)}")
        off = distance(real, sim)
        if best is None or off < best[0]:
            best = off, Fit(config, undetermined, sim)
        config = corrected(config, real, sim, undetermined)
    return best[1]


def distance(real: DetectorStatistics, sim: DetectorStatistics) -> float:
    """Return the distance between two recordings' statistics, in units of the limits in `synth.detector.comparison`."""
    missed = np.abs(np.nanmean(real.missed, 0) - np.nanmean(sim.missed, 0)) / 0.03
    by_side = np.abs(real.missed_by_side - sim.missed_by_side).ravel() / 0.1
    pairs = [abs(real.joint_misses[pair] - sim.joint_misses[pair]) / 0.1 for pair in real.joint_misses]
    error = [_log(error_quantile(real, k, 0.5), error_quantile(sim, k, 0.5)) / 0.1 for k in range(len(real.kinds))]
    known = len(real.miss_seconds) and len(sim.miss_seconds)
    seconds = [_log(real.miss_seconds.mean(), sim.miss_seconds.mean()) / 0.1] if known else []
    return float(np.sqrt(np.nanmean(np.square([*missed, *by_side, *pairs, *error, *seconds]))))


def _log(a: float, b: float) -> float:
    return abs(np.log(a / b)) if a > 0 and b > 0 else np.nan


def _undetermined(real: DetectorStatistics) -> dict[str, str]:
    """Return the names of the parameters that are not changed, with the reasons."""
    counts = np.bincount(real.kind, minlength=len(real.kinds))
    found = {
        f"parts.{kind}": f"{count} joints could be checked, {ENOUGH} are needed"
        for kind, count in zip(real.kinds, counts, strict=True)
        if count < ENOUGH
    }
    if len(real.miss_seconds) < _FEW_MISSES:
        found["times.bursts"] = f"{len(real.miss_seconds)} uninterrupted misses, {_FEW_MISSES} are needed"
    if not np.isfinite(real.autocorrelation[0.2]):
        found["times.correlation"] = "no joint is followed for 0.2 s"
    if not np.isfinite(real.constant) or real.constant <= 0:
        found["noise.bias"] = "no joint is followed for a second"
    if not np.nansum(real.ghosts) > 0:
        found["ghosts.joints"] = found["ghosts.score"] = "there is no ghost"
    return found
