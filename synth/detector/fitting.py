"""Fit a detector's preset to a recording: simulate, measure both in the same way, correct, repeat.

Errors of a recording are measured against other views, and misses only for people that are detected at all, so no
parameter can be read off. Simulated clips are measured alike (`synth.detector.statistics.measure`), and each parameter
is corrected by the difference of its own statistic.
"""

import json
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, is_dataclass, replace
from typing import Any

import numpy as np
import yaml
from scipy.stats import spearmanr

from dmae.data.clip import Clip
from dmae.data.rng import Stream, generator
from dmae.numerics.statistics import mean_known
from dmae.progress import progress
from synth.detector.config import DetectorConfig, ErrorReference
from synth.detector.parts import PartConfig, PartsConfig
from synth.detector.simulated_detector import detect
from synth.detector.statistics import DetectorStatistics, measure_all


def preset_yaml(config: DetectorConfig, name: str, comments: list[str]) -> str:
    """Return a preset as YAML: the options that differ from the defaults, one group per line, after comment lines."""
    # The name of a recording may contain line breaks. Without this, the further lines would become options.
    lines = [*(f"# {' '.join(comment.split())}" for comment in comments), f"name: {json.dumps(name)}"]
    for group, options in _changed(config, DetectorConfig()).items():
        if group == "parts":
            lines += ["parts:", *(f"  {kind}: {_flow(part)}" for kind, part in options.items())]
        elif group != "name":
            lines.append(f"{group}: {_flow(options)}")
    return "\n".join(lines) + "\n"


def _changed(config, default) -> dict:
    """Return the fields of a dataclass that differ from its defaults, including nested fields."""
    values = {key: (value, vars(default)[key]) for key, value in vars(config).items()}
    return {
        key: _changed(value, usual) if is_dataclass(value) else value
        for key, (value, usual) in values.items()
        if value != usual
    }


def _flow(value) -> str:
    return yaml.safe_dump(value, default_flow_style=True, width=float("inf"), sort_keys=False).strip()


# Each parameter of the detector is corrected by one statistic, in which the recording and its simulation differ.

_STEP = 0.7
"""Exponent of each correction. It is below 1 because the parameters depend on each other."""
ENOUGH = 200
"""Fewest detected joints of a kind for its parameters to be fitted."""
_FAR_SIDE_EXCESS = 0.2
"""Difference of the miss rates on the body's far side and near side above which the body hides the far joints."""
_LOW_CONFIDENCE = 0.35
"""Confidence below which a detector mostly guesses."""


def corrected(
    config: DetectorConfig, real: DetectorStatistics, sim: DetectorStatistics, kept: Collection[str]
) -> DetectorConfig:
    """Return the detector with each parameter corrected by its statistic, except those in `kept`."""
    parts = {}
    for k, kind in enumerate(real.kinds):
        part = getattr(config.parts, kind)
        parts[kind] = part if f"parts.{kind}" in kept else _corrected_part(part, real, sim, k)
    noise, misses, ghosts = config.noise, config.misses, config.ghosts
    limb, neighbours = ("elbow|wrist", "knee|ankle"), ("wrist|elbow", "ankle|knee")
    corrections: dict[str, Callable[[], object]] = {
        "times.bursts": lambda: _burst_times(config.times.bursts, real.miss_seconds, sim.miss_seconds),
        "noise.hidden": lambda: _towards(noise.hidden, _unsure(real), _unsure(sim), 1, 8),
        "scores.error_correlation": lambda: _shifted(
            config.scores.error_correlation, _rank_correlation(real), _rank_correlation(sim), 0.95
        ),
        "misses.limb_correlation": lambda: _shifted(
            misses.limb_correlation, _pairs(real, *limb), _pairs(sim, *limb), 0.99
        ),
        "misses.neighbour_correlation": lambda: _shifted(
            misses.neighbour_correlation, _pairs(real, *neighbours), _pairs(sim, *neighbours), 1
        ),
        "misses.person": lambda: _whole(misses.person, real, sim),
        "misses.hidden_person": lambda: _whole(misses.hidden_person, real, sim),
        "inversions.legs": lambda: _towards(config.inversions.legs, *_inverted(real, sim, "knee", "ankle"), 0, 0.2),
        "inversions.arms": lambda: _towards(config.inversions.arms, *_inverted(real, sim, "elbow", "wrist"), 0, 0.2),
        "splits.probability": lambda: _towards(
            config.splits.probability, mean_known(real.fragments), mean_known(sim.fragments), 0, 0.5
        ),
        "ghosts.count": lambda: _towards(ghosts.count, mean_known(real.ghosts), mean_known(sim.ghosts), 0, 5),
        "ghosts.joints": lambda: _towards(ghosts.joints, real.ghost_joints, sim.ghost_joints, 0.05, 0.95),
        "ghosts.score": lambda: _beta(ghosts.score, real.ghost_score - sim.ghost_score, 1.0),
    }
    return corrected_times(_applied(replace(config, parts=PartsConfig(**parts)), corrections, kept), real, sim, kept)


def corrected_times(
    config: DetectorConfig, real: DetectorStatistics, sim: DetectorStatistics, kept: Collection[str]
) -> DetectorConfig:
    """Return the detector with the duration of its errors corrected, unless it is in `kept`."""
    corrections: dict[str, Callable[[], object]] = {
        "times.correlation": lambda: _correlation(config.times.correlation, real, sim),
        "noise.bias": lambda: _towards(config.noise.bias, real.constant, sim.constant, 0.01, 0.9),
    }
    return _applied(config, corrections, kept)


def _applied(
    config: DetectorConfig, corrections: dict[str, Callable[[], Any]], kept: Collection[str]
) -> DetectorConfig:
    """Return the detector with these parameters changed, `<error>.<parameter>` each, except those in `kept`."""
    for name, correction in corrections.items():
        if name in kept:
            continue
        value = correction()
        # If the clips contain no error of this kind, no correction can be computed.
        if np.isfinite(value).all():
            error, _, parameter = name.partition(".")
            config = replace(config, **{error: replace(getattr(config, error), **{parameter: _rounded(value)})})
    return config


def error_quantile(statistics: DetectorStatistics, kind: int, share: float) -> float:
    """Return a quantile of errors of a kind of joint, in heights; NaN if there are none."""
    some = statistics.error[statistics.kind == kind]
    return float(np.quantile(some, share)) if len(some) else float("nan")


def _towards(value: float, real: float, sim: float, low: float, high: float) -> float:
    """Return a corrected parameter. Its statistic is proportional to it."""
    if not (real > 0 and sim > 0):
        return value
    return float(np.clip(value * (real / sim) ** _STEP, low, high))


def _shifted(value: float, real: float, sim: float, high: float) -> float:
    """Return a corrected parameter, 0 or more. Its statistic grows one to one with it."""
    return float(np.clip(value + _STEP * (real - sim), 0, high))


def _odds(probability: float) -> float:
    probability = float(np.clip(probability, 1e-4, 1 - 1e-4))
    return probability / (1 - probability)


def _scaled_odds(probability: float, factor: float) -> float:
    """Return the probability with its odds multiplied by a factor. 0 and 1 do not change."""
    if probability in (0, 1):
        return probability
    odds = _odds(probability) * factor
    return round(float(np.clip(odds / (1 + odds), 1e-4, 0.999)), 4)


def _rounded(value):
    return [round(float(v), 4) for v in value] if isinstance(value, list) else round(float(value), 5)


def _corrected_part(part: PartConfig, real: DetectorStatistics, sim: DetectorStatistics, kind: int) -> PartConfig:
    """Correct noise by the median error, its tail by larger errors, misses by their odds, scores by mean and spread.

    If the far side of the body is missed more often, misses of visible joints are fitted to the camera's side, and
    misses of hidden joints to the rest: a person that turns away from one camera faces another.
    """
    if not (sim.kind == kind).any():
        return part
    middle = [error_quantile(both, kind, 0.5) for both in (real, sim)]
    tails = [error_quantile(both, kind, 0.95) / error_quantile(both, kind, 0.5) for both in (real, sim)]
    mean = _odds(float(mean_known(real.missed[:, kind]))) / _odds(float(mean_known(sim.missed[:, kind])))
    sided = np.diff(real.missed_by_side[kind])[0] > _FAR_SIDE_EXCESS and np.isfinite(sim.missed_by_side[kind, 0])
    near = _odds(real.missed_by_side[kind, 0]) / _odds(sim.missed_by_side[kind, 0]) if sided else mean
    scores = [both.score[both.kind == kind] for both in (real, sim)]
    spread = float(scores[0].var() / max(scores[1].var(), 1e-6))
    return replace(
        part,
        noise=round(_towards(part.noise, middle[0], middle[1], 1e-4, 0.2), 5),
        tail=round(_towards(part.tail, tails[1], tails[0], 1.5, 30), 2),
        score=_rounded(_beta(part.score, float(scores[0].mean() - scores[1].mean()), spread)),
        miss=[
            _scaled_odds(miss, factor**_STEP) for miss, factor in zip(part.miss, (near, mean, mean, mean), strict=True)
        ],
    )


def _beta(shape: Sequence[float], shift: float, spread: float) -> list[float]:
    """Return (a, b) of a Beta distribution with shifted mean and scaled deviation. The constant 1 starts as (30, 1)."""
    a, b = shape if shape[1] > 0 else (30.0, 1.0)
    mean = float(np.clip(a / (a + b) + _STEP * shift, 0.02, 0.98))
    return [mean * (size := float(np.clip((a + b) / spread**_STEP, 2, 200))), (1 - mean) * size]


def _correlation(time: float, real: DetectorStatistics, sim: DetectorStatistics) -> float:
    """Return the corrected correlation time, from the correlation of errors 0.2 s apart without their constant part."""
    times = [
        -0.2 / np.log(np.clip((both.autocorrelation[0.2] - both.constant) / (1 - both.constant), 0.02, 0.98))
        for both in (real, sim)
    ]
    return _towards(max(time, 0.01), times[0], times[1], 0.01, 5.0)


def _rank_correlation(statistics: DetectorStatistics) -> float:
    """Return the rank correlation of confidence and small error within kinds of joints, averaged over them."""
    found = []
    for kind in range(len(statistics.kinds)):
        of_kind = statistics.kind == kind
        if of_kind.sum() >= ENOUGH and np.ptp(statistics.score[of_kind]) > 0:
            found.append(-spearmanr(statistics.score[of_kind], statistics.error[of_kind]).statistic)
    return float(np.mean(found)) if found else 0.0


def _unsure(statistics: DetectorStatistics) -> float:
    """Return the median error of joints with low confidence; NaN if there are few such joints."""
    some = statistics.error[statistics.score < _LOW_CONFIDENCE]
    return float(np.median(some)) if len(some) >= ENOUGH else float("nan")


def _burst_times(times: Sequence[float], real: np.ndarray, sim: np.ndarray) -> list[float]:
    """Return burst times: the long one corrected by the share of time in long misses, the short one by the mean."""
    if not len(sim):
        return list(times)
    long, short = times
    held = [max(seconds[seconds >= 0.6].sum() / seconds.sum(), 0.01) for seconds in (real, sim)]
    return [_towards(long, held[0], held[1], 0.2, 20), _towards(short, real.mean(), sim.mean(), 0.02, 5)]


def _pairs(statistics: DetectorStatistics, *pairs: str) -> float:
    known = [share for share in (statistics.joint_misses[pair] for pair in pairs) if np.isfinite(share)]
    return float(np.mean(known)) if known else 0.0


def _whole(probability: float, real: DetectorStatistics, sim: DetectorStatistics) -> float:
    return _towards(probability, mean_known(real.person_missed), mean_known(sim.person_missed), 0, 0.9)


def _inverted(real: DetectorStatistics, sim: DetectorStatistics, *kinds: str) -> tuple[float, float]:
    """Return the fractions of inverted joints of some kinds. If there are none, half a joint counts as inverted."""
    shares = []
    for both in (real, sim):
        some = np.isin(both.kind, [both.kinds.index(kind) for kind in kinds])
        shares.append(max(both.inverted[some].sum(), 0.5) / max(some.sum(), 1))
    return shares[0], shares[1]


_FEW_MISSES = 50
"""Fewest uninterrupted misses for the burst times to be fitted."""


@dataclass(frozen=True)
class Fit:
    """A fitted preset."""

    config: DetectorConfig  # The detector
    # Parameters that are not changed, and the reason why the recording does not determine each
    undetermined: dict[str, str]
    statistics: DetectorStatistics  # Statistics of the clips that were simulated with this detector


def redetect(clip: Clip, config: DetectorConfig, seed: int) -> Clip:
    """Return the clip with new detections, from the simulated detector `config`."""
    assert clip.truth is not None and clip.occlusion is not None
    rng = generator(seed, int(clip.id), Stream.DETECTOR)
    rig = clip.actual_rig
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

    Raises ValueError if the clips have no visibility labels, or another skeleton than the recording.

    Args:
        real: Statistics of the recording.
        clips: Simulated clips with truth and visibility, of a scene similar to the recording's.
        start: Start of the fit. Parameters that the recording does not determine keep its values.
        rounds: Number of simulations. The detector has the same `seed` in all of them.
        reference: Reference for the detections of the clips, the same as for the recording.
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
    assert best is not None
    return best[1]


def distance(real: DetectorStatistics, sim: DetectorStatistics) -> float:
    """Return the distance between two recordings' statistics, in units of the limits in `synth.detector.comparison`."""
    missed = np.abs(mean_known(real.missed, 0) - mean_known(sim.missed, 0)) / 0.03
    by_side = np.abs(real.missed_by_side - sim.missed_by_side).ravel() / 0.1
    pairs = [abs(real.joint_misses[pair] - sim.joint_misses[pair]) / 0.1 for pair in real.joint_misses]
    error = [_log(error_quantile(real, k, 0.5), error_quantile(sim, k, 0.5)) / 0.1 for k in range(len(real.kinds))]
    known = len(real.miss_seconds) and len(sim.miss_seconds)
    seconds = [_log(real.miss_seconds.mean(), sim.miss_seconds.mean()) / 0.1] if known else []
    return float(np.sqrt(mean_known(np.square([*missed, *by_side, *pairs, *error, *seconds]))))


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
