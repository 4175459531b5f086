"""Fit a detector's preset to detections with truth and visibility labels.

First, all parameters are fitted as to a recording (`synth.detector.fitting.fit`), with the truth as reference. Then
errors and confidences are corrected for each kind of joint, separately for visible joints, for joints hidden by the own
body, and for joints hidden by others. Misses of whole people are fitted by the share of their joints that is hidden.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain, product

import numpy as np
import pandas as pd
from scipy.stats import spearmanr

from dmae.data.clip import Clip
from dmae.data.conversion import convert_detections
from dmae.data.labels import Visibility
from dmae.data.skeleton import BODY25
from dmae.parallel import in_parallel
from dmae.progress import progress
from synth.detector.comparison import Row, compare
from synth.detector.config import DetectorConfig, ErrorReference, Limits
from synth.detector.errors_of_joints import Misses
from synth.detector.fitting import Fit, corrected_times, fit, redetect
from synth.detector.parts import KINDS, PartConfig, PartsConfig
from synth.detector.statistics import DetectorStatistics, measure_all
from synth.recognition.detector_errors import DetectorObservations, observe, pooled

LIMITS = Limits(miss=0.02, joint_miss=0.03, distance=0.08, confidence=0.06)
"""Greatest allowed distances for a preset that is fitted to truth."""
_ENOUGH = 60
"""Fewest joints of a kind, visible or hidden, for their parameters to be fitted."""
_STEP = 0.8
_EXCHANGED = {"legs": ("knee", "ankle"), "arms": ("elbow", "wrist"), "body": ("shoulder",)}
"""Kinds of joints that show the inversions of `Inversions`. Shoulders are exchanged only with the whole body."""
_GROUPS = {
    "": (Visibility.VISIBLE,),
    "hidden_": (Visibility.HIDDEN_BY_SELF,),
    "covered_": (Visibility.HIDDEN_BY_PERSON, Visibility.HIDDEN_BY_OBJECT),
}
"""Prefix of the options of `PartConfig` that describe joints of some visibility."""


def fit_to_truth(
    recordings: Sequence[Clip], start: DetectorConfig, *, rounds: int = 8, seed: int = 0, workers: int = 1
) -> Fit:
    """Fit a detector to detections of clips with truth and visibility labels, by simulating it on the same clips.

    Each of the two parts of the fit takes `rounds` simulations, all with the same seed. Parameters that the clips do
    not determine keep the values of `start`.

    Raises ValueError if a clip has no truth or labels, or the clips have different numbers of cameras.
    """
    clips = [on_body25(clip) for clip in recordings]
    real = _observed(clips, workers)
    statistics = _measured(clips, workers)
    first = fit(statistics, clips, start, rounds=rounds, seed=seed, workers=workers, reference=ErrorReference.annotated)
    config = replace(
        first.config,
        misses=_person_misses(first.config, real),
        # The first part of the fit takes large errors of hidden joints for exchanged sides.
        inversions=replace(first.config.inversions, legs=0.0, arms=0.0, body=0.0),
        splits=first.config.splits if real.duplicates else replace(first.config.splits, probability=0.0),
        ghosts=first.config.ghosts if real.ghosts else replace(first.config.ghosts, count=0.0),
    )
    best = None
    for _ in progress(range(rounds), "fitting hidden joints"):
        simulated = _redetected(clips, config, seed)
        sim = _observed(simulated, workers)
        off = _distance(real.joints, sim.joints)
        if best is None or off < best[0]:
            best = off, config
        times = _measured(simulated, workers)
        config = corrected_times(_corrected(config, real.joints, sim.joints), statistics, times, first.undetermined)
    sim = _observed(_redetected(clips, config, seed), workers)
    config = best[1] if best and best[0] <= _distance(real.joints, sim.joints) else config
    kept = {name: why for name, why in first.undetermined.items() if name != "parts.small_toe"}
    return Fit(config, kept, _measured(_redetected(clips, config, seed), workers))


def distances(recordings: Sequence[Clip], config: DetectorConfig, seed: int = 0, workers: int = 1) -> list[Row]:
    """Compare the detections of clips with what a simulated detector finds on the same clips, by `LIMITS`."""
    clips = [on_body25(clip) for clip in recordings]
    real = _measured(clips, workers)
    sim = _measured(_redetected(clips, config, seed), workers)
    return compare(real, sim, LIMITS)


def real_distances(recordings: Sequence[Clip], others: Sequence[Clip], workers: int = 1) -> list[Row]:
    """Compare what a detector found on some clips with what it found on other clips.

    A simulated detector cannot be expected to be nearer to the real one than the real one is to itself.
    """
    one, other = (_measured([on_body25(clip) for clip in clips], workers) for clips in (recordings, others))
    return compare(one, other, LIMITS)


def on_body25(clip: Clip) -> Clip:
    """Return a clip with its detections on BODY25. Raises ValueError if it has no truth, or no visibility labels."""
    if clip.truth is None or clip.occlusion is None:
        raise ValueError(
            f"clip {clip.id!r}: truth=annotated fits to clips with truth and labels of visibility, which "
            "synth generate makes and dmae detect clip=... keeps"
        )
    return replace(clip, detections=convert_detections(clip.detections, BODY25), detection_labels=None)


def _measured(clips: Sequence[Clip], workers: int) -> DetectorStatistics:
    return measure_all(clips, len(clips), workers, ErrorReference.annotated)


def _redetected(clips: Sequence[Clip], config: DetectorConfig, seed: int) -> list[Clip]:
    # Clips of different data sets can have equal ids, and would then get equal random errors.
    return [redetect(replace(clip, id=str(number)), config, seed) for number, clip in enumerate(clips)]


def _observed(clips: Sequence[Clip], workers: int) -> DetectorObservations:
    return pooled(list(in_parallel(observe, ((clip,) for clip in clips), workers)))


def _distance(real: pd.DataFrame, sim: pd.DataFrame) -> float:
    """Return the distance between errors and confidences of two detectors, over kinds, visible and hidden joints."""
    off = []
    for kind, group in product(dict.fromkeys(KINDS), _GROUPS):
        a, b = (_detected(both, kind, group) for both in (real, sim))
        if min(len(a.error), len(b.error)) >= _ENOUGH:
            off += [np.log(np.quantile(a.error, q) / max(np.quantile(b.error, q), 1e-6)) for q in (0.25, 0.5, 0.9)]
            off.append(4 * (a.score.mean() - b.score.mean()))
    return float(np.sqrt(np.mean(np.square(off)))) if off else 0.0


def _detected(joints: pd.DataFrame, kind: str, group: str) -> pd.DataFrame:
    return joints[(joints.kind == kind) & joints.cause.isin(_GROUPS[group]) & ~joints.missed]


def _corrected(config: DetectorConfig, real: pd.DataFrame, sim: pd.DataFrame) -> DetectorConfig:
    parts = {}
    for kind in dict.fromkeys(KINDS):
        part = _corrected_misses(getattr(config.parts, kind), real, sim, kind)
        for group in _GROUPS:
            a, b = (_detected(both, kind, group) for both in (real, sim))
            if min(len(a.error), len(b.error)) >= _ENOUGH:
                part = _corrected_part(part, a, b, group, config)
        parts[kind] = part
    exchanged = {name: _exchanged(getattr(config.inversions, name), real, sim, _EXCHANGED[name]) for name in _EXCHANGED}
    inversions = replace(config.inversions, **exchanged)
    return _correlated(replace(config, parts=PartsConfig(**parts), inversions=inversions), real, sim)


def _correlated(config: DetectorConfig, real: pd.DataFrame, sim: pd.DataFrame) -> DetectorConfig:
    """Return the detector with the correlation of confidences and small errors corrected, for each kind of joint."""
    common = config.scores.error_correlation
    wanted = {kind: common * getattr(config.parts, kind).score_correlation for kind in dict.fromkeys(KINDS)}
    for kind in wanted:
        change = [_rank_correlation(both, kind) for both in (real, sim)]
        if np.isfinite(change).all():
            wanted[kind] = float(np.clip(wanted[kind] + _STEP * (change[0] - change[1]), 0, 0.95))
    most = round(max(wanted.values()), 4)
    parts = {
        kind: replace(getattr(config.parts, kind), score_correlation=round(each / most, 3) if most else 1.0)
        for kind, each in wanted.items()
    }
    return replace(config, parts=PartsConfig(**parts), scores=replace(config.scores, error_correlation=most))


def _rank_correlation(joints: pd.DataFrame, kind: str) -> float:
    """Return the rank correlation of confidence and small error of a kind, averaged over visible and hidden joints."""
    found = []
    for group in _GROUPS:
        some = _detected(joints, kind, group)
        if len(some.error) >= _ENOUGH and some.score.nunique() > 1:
            found.append((-spearmanr(some.score, some.error).statistic, len(some.error)))
    if not found:
        return float("nan")
    correlations, counts = zip(*found, strict=True)
    return float(np.average(correlations, weights=counts))


def _corrected_part(
    part: PartConfig, real: pd.DataFrame, sim: pd.DataFrame, group: str, config: DetectorConfig
) -> PartConfig:
    """Return a part with noise corrected by the median error, its tail by large errors, scores by mean and spread."""
    noise, tail, score = part.noise, part.tail, part.score
    if group:
        noise = part.hidden_noise or max(part.noise, 1e-3) * config.noise.hidden
        tail = part.hidden_tail or part.tail
        score = part.hidden_score if any(part.hidden_score) else config.scores.hidden
    if group == "covered_":
        noise, tail = part.covered_noise or noise, part.covered_tail or tail
        score = part.covered_score if any(part.covered_score) else score
    middle, large = ([np.quantile(both.error, q) for both in (real, sim)] for q in (0.5, 0.9))
    noise = float(np.clip(noise * (middle[0] / max(middle[1], 1e-6)) ** _STEP, 1e-4, 0.3))
    ratios = [large[i] / max(middle[i], 1e-6) for i in (0, 1)]
    tail = float(np.clip(tail * (ratios[1] / ratios[0]) ** (2 * _STEP), 1.0, 30))
    shape = [round(each, 4) for each in _beta(score, real.score.to_numpy(), sim.score.to_numpy())]
    values: dict = {"noise": round(noise, 5), "tail": round(tail, 2), "score": shape}
    return replace(part, **{group + name: value for name, value in values.items()})


def _beta(shape: Sequence[float], real: np.ndarray, sim: np.ndarray) -> tuple[float, float]:
    """Return (a, b) of the Beta distribution with mean and spread corrected towards the real values."""
    a, b = shape if shape[1] > 0 else (30.0, 1.0)
    mean = float(np.clip(a / (a + b) + _STEP * (real.mean() - sim.mean()), 0.02, 0.98))
    size = float(np.clip((a + b) * (sim.var() / max(real.var(), 1e-6)) ** _STEP, 0.3, 500))
    return mean * size, (1 - mean) * size


def _corrected_misses(part: PartConfig, real: pd.DataFrame, sim: pd.DataFrame, kind: str) -> PartConfig:
    """Return a part with corrected probabilities of misses by cause. A kind that is never detected is always missed."""
    miss = list(part.miss)
    of_kind = [both[both.kind == kind] for both in (real, sim)]
    if not len(of_kind[0]):
        return replace(part, miss=[1.0] * len(miss))
    for place, cause in enumerate(chain(*_GROUPS.values())):
        missed = [both.missed[both.cause == cause] for both in of_kind]
        if min(map(len, missed)) >= _ENOUGH:
            change = float(missed[0].mean() - missed[1].mean())
            miss[place] = (
                0.0 if not missed[0].any() else round(float(np.clip(miss[place] + _STEP * change, 0, 0.999)), 4)
            )
    return replace(part, miss=miss)


def _exchanged(probability: float, real: pd.DataFrame, sim: pd.DataFrame, kinds: tuple[str, ...]) -> float:
    """Return the corrected probability of an inversion, from visible joints; both have large errors."""
    some = [both[both.kind.isin(kinds) & (both.cause == Visibility.VISIBLE) & ~both.missed] for both in (real, sim)]
    if min(map(len, some)) < _ENOUGH:
        return probability
    change = float(some[0].inverted.mean() - some[1].inverted.mean())
    return round(float(np.clip(probability + _STEP * change, 0, 0.3)), 5)


def _person_misses(config: DetectorConfig, real: DetectorObservations) -> Misses:
    """Return misses with the maximum-likelihood probability that a person is not detected, by the joints hidden."""
    names = ("person", "hidden_person", "lost_from", "steepness", "trunk_weight")
    grid = product((0.002, 0.005, 0.01, 0.02, 0.05, 0.1), (0.7, 0.85, 0.95, 0.99), (0.4, 0.5, 0.6, 0.7, 0.8, 1.0),
                   (1.0, 2.0, 3.0, 5.0, 8.0), (1.0, 2.0, 3.0, 5.0))  # fmt: skip

    def likelihood(misses: Misses) -> float:
        missed = np.clip(misses.person_probability(real.hidden), 1e-4, 1 - 1e-4)
        return float(np.log(np.where(real.people.found, 1 - missed, missed)).sum())

    return max((replace(config.misses, **dict(zip(names, values, strict=True))) for values in grid), key=likelihood)
