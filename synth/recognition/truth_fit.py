"""Fit a detector's preset to detections with truth and visibility labels.

First, all parameters are fitted as to a recording (`synth.detector.fitting`), with the truth as reference. Then errors
and confidences are corrected for each kind of joint, separately for visible and hidden joints. Misses of whole people
are fitted by the share of their joints that is hidden.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

from dmae.data.clip import Clip
from dmae.data.labels import Visibility
from dmae.data.skeleton import BODY25
from dmae.data.skeleton_conversion import convert_detections
from dmae.parallel import in_parallel
from dmae.progress import progress
from synth.detector.comparison import Limits, Row, compare
from synth.detector.config import DetectorConfig
from synth.detector.fitting import Fit, fit, redetect
from synth.detector.parts import PartConfig, PartsConfig, kind_of
from synth.detector.pooling import measure_all
from synth.detector.statistics import ErrorReference
from synth.recognition.observations import DetectorObservations, JointsSeen, PeopleSeen, observe, pooled

LIMITS = Limits(miss=0.02, joint_miss=0.03, distance=0.08, confidence=0.06)
"""Greatest allowed distances for a preset that is fitted to truth."""
_ENOUGH = 150
"""Fewest joints of a kind, visible or hidden, for their parameters to be fitted."""
_STEP = 0.8
_LOW, _HIGH, _UNSURE_STEP = 0.5, 0.8, 0.5
"""Limits of low and of high confidence, and the step of a correction. The errors at low and high confidence determine
the correlation of errors and confidences."""
_KINDS = np.array([kind_of(joint) for joint in BODY25.joints])
_INVERTING = BODY25.index("l_shoulder", "r_shoulder")
"""Joints that show an exchange of the sides of the whole body: only then are shoulders exchanged."""
_CAUSES = (Visibility.VISIBLE, Visibility.HIDDEN_BY_SELF, Visibility.HIDDEN_BY_PERSON, Visibility.HIDDEN_BY_OBJECT)


def fit_to_truth(
    recordings: Sequence[Clip], start: DetectorConfig, *, rounds: int = 8, seed: int = 0, workers: int = 1
) -> Fit:
    """Fit a detector to detections of clips with truth and visibility labels, by simulating it on the same clips.

    Args:
        recordings: Clips with equal numbers of cameras.
        start: Start of the fit. Parameters that the clips do not determine keep its values.
        rounds: Number of simulations in each of the two parts of the fit.
        seed: Seed of the detector, the same in all rounds.
        workers: Processes; -1 for one per core.

    Raises:
        ValueError: a clip has no truth or labels, or the clips have different numbers of cameras.
    """
    clips = [on_body25(clip) for clip in recordings]
    real = pooled(list(in_parallel(observe, ((clip,) for clip in clips), workers)))
    statistics = measure_all(clips, len(clips), workers, ErrorReference.annotated)
    first = fit(statistics, clips, start, rounds=rounds, seed=seed, workers=workers, reference=ErrorReference.annotated)
    config = replace(
        first.config,
        misses=_person_misses(first.config, real.people),
        splits=first.config.splits if real.duplicates else replace(first.config.splits, probability=0.0),
        ghosts=first.config.ghosts if real.ghosts else replace(first.config.ghosts, count=0.0),
    )
    best = None
    for _ in progress(range(rounds), "fitting hidden joints"):
        sim = _simulated(clips, config, seed, workers)
        off = _distance(real.joints, sim.joints)
        if best is None or off < best[0]:
            best = off, config
        config = _corrected(config, real.joints, sim.joints)
    sim = _simulated(clips, config, seed, workers)
    config = best[1] if best and best[0] <= _distance(real.joints, sim.joints) else config
    kept = {name: why for name, why in first.undetermined.items() if name != "parts.small_toe"}
    return Fit(
        config, kept, measure_all(_redetected(clips, config, seed), len(clips), workers, ErrorReference.annotated)
    )


def distances(recordings: Sequence[Clip], config: DetectorConfig, seed: int = 0, workers: int = 1) -> list[Row]:
    """Compare the detections of clips with those of a simulated detector on the same clips, by the limits `LIMITS`."""
    clips = [on_body25(clip) for clip in recordings]
    real = measure_all(clips, len(clips), workers, ErrorReference.annotated)
    sim = measure_all(_redetected(clips, config, seed), len(clips), workers, ErrorReference.annotated)
    return compare(real, sim, LIMITS)


def on_body25(clip: Clip) -> Clip:
    """Return a clip with its detections on BODY25.

    Raises:
        ValueError: the clip has no truth, or no visibility labels.
    """
    if clip.truth is None or clip.occlusion is None:
        raise ValueError(
            f"clip {clip.id!r}: truth=annotated fits to clips with truth and labels of visibility, as "
            "dmae detect clip=... keeps them of what synth generate made"
        )
    return replace(clip, detections=convert_detections(clip.detections, BODY25), detection_labels=None)


def _redetected(clips: Sequence[Clip], config: DetectorConfig, seed: int) -> list[Clip]:
    # Clips of different data sets can have equal ids, and would then get equal random errors.
    return [redetect(replace(clip, id=str(number)), config, seed) for number, clip in enumerate(clips)]


def _simulated(clips: Sequence[Clip], config: DetectorConfig, seed: int, workers: int) -> DetectorObservations:
    return pooled(list(in_parallel(observe, ((clip,) for clip in _redetected(clips, config, seed)), workers)))


def _distance(real: JointsSeen, sim: JointsSeen) -> float:
    """Return the distance between errors and confidences of two detectors, over kinds, visible and hidden joints."""
    off = []
    for kind, hidden in product(dict.fromkeys(_KINDS), (False, True)):
        a, b = (_detected(both, kind, hidden) for both in (real, sim))
        if min(len(a.error), len(b.error)) >= _ENOUGH:
            off += [np.log(np.quantile(a.error, q) / max(np.quantile(b.error, q), 1e-6)) for q in (0.25, 0.5, 0.9)]
            off.append(4 * (a.score.mean() - b.score.mean()))
    return float(np.sqrt(np.mean(np.square(off)))) if off else 0.0


def _detected(joints: JointsSeen, kind: str, hidden: bool) -> JointsSeen:
    return joints[(_KINDS[joints.joint] == kind) & ((joints.cause != Visibility.VISIBLE) == hidden) & ~joints.missed]


def _corrected(config: DetectorConfig, real: JointsSeen, sim: JointsSeen) -> DetectorConfig:
    parts = {}
    for kind in dict.fromkeys(_KINDS):
        part = _corrected_misses(getattr(config.parts, kind), real, sim, kind)
        for hidden in (False, True):
            a, b = (_detected(both, kind, hidden) for both in (real, sim))
            if min(len(a.error), len(b.error)) >= _ENOUGH:
                part = _corrected_part(part, a, b, hidden, config)
        parts[kind] = part
    inversions = replace(config.inversions, body=_exchanged(config.inversions.body, real, sim))
    correlation = config.scores.error_correlation + _UNSURE_STEP * (_unsureness(real) - _unsureness(sim))
    scores = replace(config.scores, error_correlation=round(float(np.clip(correlation, 0, 0.95)), 4))
    return replace(config, parts=PartsConfig(**parts), inversions=inversions, scores=scores)


def _unsureness(joints: JointsSeen) -> float:
    """Return the logarithm of the ratio of median errors at low and high confidence; 0 if there are few of either."""
    some = [joints.error[joints.score < _LOW], joints.error[joints.score >= _HIGH]]
    if min(map(len, some)) < _ENOUGH:
        return 0.0
    return float(np.log(np.median(some[0]) / max(np.median(some[1]), 1e-6)))


def _corrected_part(
    part: PartConfig, real: JointsSeen, sim: JointsSeen, hidden: bool, config: DetectorConfig
) -> PartConfig:
    """Return a part with noise corrected by the median error, its tail by large errors, scores by mean and spread."""
    noise, tail, score = part.noise, part.tail, part.score
    if hidden:
        noise = part.hidden_noise or max(part.noise, 1e-3) * config.noise.hidden
        tail = part.hidden_tail or part.tail
        score = part.hidden_score if any(part.hidden_score) else config.scores.hidden
    middle, large = ([np.quantile(both.error, q) for both in (real, sim)] for q in (0.5, 0.9))
    noise = float(np.clip(noise * (middle[0] / max(middle[1], 1e-6)) ** _STEP, 1e-4, 0.3))
    ratios = [large[i] / max(middle[i], 1e-6) for i in (0, 1)]
    tail = float(np.clip(tail * (ratios[1] / ratios[0]) ** (2 * _STEP), 1.0, 30))
    shape = [round(each, 4) for each in _beta(score, real.score, sim.score)]
    if hidden:
        return replace(part, hidden_noise=round(noise, 5), hidden_tail=round(tail, 2), hidden_score=shape)
    return replace(part, noise=round(noise, 5), tail=round(tail, 2), score=shape)


def _beta(shape: Sequence[float], real: np.ndarray, sim: np.ndarray) -> tuple[float, float]:
    """Return (a, b) of the Beta distribution with mean and spread corrected towards the real values."""
    a, b = shape if shape[1] > 0 else (30.0, 1.0)
    mean = float(np.clip(a / (a + b) + _STEP * (real.mean() - sim.mean()), 0.02, 0.98))
    size = float(np.clip((a + b) * (sim.var() / max(real.var(), 1e-6)) ** _STEP, 0.3, 500))
    return mean * size, (1 - mean) * size


def _corrected_misses(part: PartConfig, real: JointsSeen, sim: JointsSeen, kind: str) -> PartConfig:
    """Return a part with corrected probabilities of misses by cause. A kind that is never detected is always missed."""
    miss = list(part.miss)
    of_kind = [both[_KINDS[both.joint] == kind] for both in (real, sim)]
    if not len(of_kind[0].joint):
        return replace(part, miss=[1.0] * len(miss))
    for place, cause in enumerate(_CAUSES):
        missed = [both.missed[both.cause == cause] for both in of_kind]
        if min(map(len, missed)) >= _ENOUGH:
            change = float(missed[0].mean() - missed[1].mean())
            miss[place] = (
                0.0 if not missed[0].any() else round(float(np.clip(miss[place] + _STEP * change, 0, 0.999)), 4)
            )
    return replace(part, miss=miss)


def _exchanged(body: float, real: JointsSeen, sim: JointsSeen) -> float:
    """Return the corrected probability that the sides of a whole body are exchanged, from exchanges of shoulders."""
    shares = []
    for both in (real, sim):
        some = both[np.isin(both.joint, _INVERTING) & ~both.missed]
        shares.append(float(some.inverted.mean()) if len(some.joint) else 0.0)
    if not shares[0]:
        return 0.0
    start = body or shares[0]
    return round(float(np.clip(start * (shares[0] / shares[1] if shares[1] else 1) ** _STEP, 0, 0.3)), 5)


def _person_misses(config: DetectorConfig, people: PeopleSeen):
    """Return misses with the maximum-likelihood probability that a person is not detected at all, by the share of
    hidden joints."""
    hidden = 1 - people.visible
    probability = partial(_missed_whole, hidden)
    grid = product((0.002, 0.005, 0.01, 0.02, 0.05, 0.1), (0.7, 0.85, 0.95, 0.99), (0.4, 0.5, 0.6, 0.7, 0.8, 1.0),
                   (1.0, 2.0, 3.0, 5.0, 8.0))  # fmt: skip
    found = np.where(people.found, 1, 0)

    def likelihood(values: tuple) -> float:
        missed = np.clip(probability(*values), 1e-4, 1 - 1e-4)
        return float((found * np.log(1 - missed) + (1 - found) * np.log(missed)).sum())

    person, hidden_person, lost_from, steepness = max(grid, key=likelihood)
    return replace(config.misses, person=person, hidden_person=hidden_person, lost_from=lost_from, steepness=steepness)


def _missed_whole(hidden: np.ndarray, person: float, hidden_person: float, lost_from: float, steepness: float):
    return person + (hidden_person - person) * np.minimum(hidden / lost_from, 1) ** steepness
