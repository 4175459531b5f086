"""A detector's preset from a recording of its own: simulate, measure both alike, correct, repeat.

What a recording shows of a detector is bent by how it is measured: errors are judged against other views, misses are
counted of people found at all. So no parameter is read off directly. The detector is run on simulated clips, both
recordings go through `synth.failures.measure`, and each parameter is moved by what its own statistic is off.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import spearmanr

from dmae.clip import Clip
from dmae.progress import progress
from dmae.rng import Stream, generator
from synth.compare import measure_all
from synth.detect import detect
from synth.failures import Failures
from synth.mistakes import DetectorConfig, PartConfig, PartsConfig

_STEP = 0.7
"""Share of what a parameter is off that it is moved by: they pull at each other."""
_ENOUGH = 200
"""Detected joints of a kind without which nothing can be said of it."""
_FEW_RUNS = 50
_SIDED = 0.2
"""Joints that are missed so much more often on the far side of the body than on the camera's are hidden by it."""
_LOW = 0.35
"""Confidence below which a detector mostly guesses."""


@dataclass(frozen=True)
class Fit:
    """A fitted preset.

    Attributes:
        config: The detector.
        undetermined: Parameters of which the recording says too little, which are as they were, and why.
        failures: Of the recording simulated with it.
    """

    config: DetectorConfig
    undetermined: dict[str, str]
    failures: Failures


def redetect(clip: Clip, config: DetectorConfig, seed: int) -> Clip:
    """The clip as seen by another detector."""
    rng = generator(seed, int(clip.id), Stream.DETECTOR)
    rig = clip.true_rig or clip.rig
    detected = detect(clip.truth, clip.visibility, clip.hidden_by, rig, clip.fps, config, rng=rng)
    return replace(clip, **detected._asdict())


def fit(
    real: Failures, clips: Sequence[Clip], start: DetectorConfig, *, rounds: int = 8, seed: int = 0, workers: int = 1
) -> Fit:
    """Fit a detector to what was measured of a recording.

    Args:
        real: The recording's failures.
        clips: Simulated clips with truth and visibility, of a scene like the recording's.
        start: Where to start from, and what is kept of parameters that nothing is known of.
        rounds: Simulations; each takes as long as measuring the clips.
        seed: Of the detector's luck, the same in all rounds.

    Raises:
        ValueError: the clips carry no visibility, or are of another skeleton than the recording.
    """
    for clip in clips:
        if clip.visibility is None or clip.truth is None:
            raise ValueError(f"clip {clip.id!r}: a detector is fitted on simulated clips; it has no visibility")
    undetermined = _undetermined(real)
    config, best = start, None
    for _ in progress(range(rounds), "fitting the detector"):
        sim = measure_all((redetect(clip, config, seed) for clip in clips), len(clips), workers)
        if sim.kinds != real.kinds:
            raise ValueError(f"the recording has joints {list(real.kinds)}, the simulation {list(sim.kinds)}")
        off = distance(real, sim)
        if best is None or off < best[0]:
            best = off, Fit(config, undetermined, sim)
        config = _corrected(config, real, sim, undetermined)
    return best[1]


def distance(real: Failures, sim: Failures) -> float:
    """How far two recordings' failures are apart, in the units of `synth.compare`'s stated distances."""
    missed = np.abs(np.nanmean(real.missed, 0) - np.nanmean(sim.missed, 0)) / 0.03
    turned = np.abs(real.turned - sim.turned).ravel() / 0.1
    together = [abs(real.together[pair] - sim.together[pair]) / 0.1 for pair in real.together]
    error = [_log(_quantile(real, k, 0.5), _quantile(sim, k, 0.5)) / 0.1 for k in range(len(real.kinds))]
    runs = [_log(real.runs.mean(), sim.runs.mean()) / 0.1] if len(real.runs) and len(sim.runs) else []
    return float(np.sqrt(np.nanmean(np.square([*missed, *turned, *together, *error, *runs]))))


def _log(a: float, b: float) -> float:
    return abs(np.log(a / b)) if a > 0 and b > 0 else np.nan


def _quantile(failures: Failures, kind: int, share: float) -> float:
    some = failures.error[failures.kind == kind]
    return float(np.quantile(some, share)) if len(some) else float("nan")


def _undetermined(real: Failures) -> dict[str, str]:
    """Names of the parameters that stay, and why."""
    counts = np.bincount(real.kind, minlength=len(real.kinds))
    found = {
        f"parts.{kind}": f"{count} joints could be checked, {_ENOUGH} are needed"
        for kind, count in zip(real.kinds, counts, strict=True)
        if count < _ENOUGH
    }
    if len(real.runs) < _FEW_RUNS:
        found["bursts"] = f"{len(real.runs)} stretches of misses, {_FEW_RUNS} are needed"
    if not np.isfinite(real.lags[0.2]):
        found["correlation"] = "no joint is followed for 0.2 s"
    if not np.isfinite(real.constant) or real.constant <= 0:
        found["bias"] = "no joint is followed for a second"
    if not np.nansum(real.ghosts) > 0:
        found["ghost_joints"] = found["ghost_score"] = "there is no false person"
    return found


def _towards(value: float, real: float, sim: float, low: float, high: float) -> float:
    """A value that its statistic is proportional to, corrected."""
    if not (real > 0 and sim > 0):
        return value
    return float(np.clip(value * (real / sim) ** _STEP, low, high))


def _odds(share: float) -> float:
    share = float(np.clip(share, 1e-4, 1 - 1e-4))
    return share / (1 - share)


def _shifted(share: float, factor: float) -> float:
    """A share with its odds multiplied; 0 and 1 stay."""
    if share in (0, 1):
        return share
    odds = _odds(share) * factor
    return round(float(np.clip(odds / (1 + odds), 1e-4, 0.999)), 4)


def _corrected(config: DetectorConfig, real: Failures, sim: Failures, kept: dict[str, str]) -> DetectorConfig:
    parts = {}
    for k, kind in enumerate(real.kinds):
        part = getattr(config.parts, kind)
        parts[kind] = part if f"parts.{kind}" in kept else _corrected_part(part, real, sim, k)
    changes: dict[str, Callable[[], object]] = {
        "correlation": lambda: _correlation(config, real, sim),
        "bias": lambda: _towards(config.bias, real.constant, sim.constant, 0.01, 0.9),
        "guess_noise": lambda: _towards(config.guess_noise, _unsure(real), _unsure(sim), 1, 8),
        "score_knows": lambda: float(
            np.clip(config.score_knows + _STEP * (_knowledge(real) - _knowledge(sim)), 0, 0.95)
        ),
        "bursts": lambda: _bursts(config.bursts, real.runs, sim.runs),
        "together": lambda: float(
            np.clip(
                config.together
                + _STEP * (_pairs(real, "elbow|wrist", "knee|ankle") - _pairs(sim, "elbow|wrist", "knee|ankle")),
                0,
                0.99,
            )
        ),
        "hanging": lambda: float(
            np.clip(
                config.hanging
                + _STEP * (_pairs(real, "wrist|elbow", "ankle|knee") - _pairs(sim, "wrist|elbow", "ankle|knee")),
                0,
                1,
            )
        ),
        "person_miss": lambda: _whole(config.person_miss, real, sim),
        "person_miss_hidden": lambda: _whole(config.person_miss_hidden, real, sim),
        "leg_inversion": lambda: _towards(config.leg_inversion, *_inverted(real, sim, "knee", "ankle"), 0, 0.2),
        "arm_inversion": lambda: _towards(config.arm_inversion, *_inverted(real, sim, "elbow", "wrist"), 0, 0.2),
        "split": lambda: _towards(config.split, np.nanmean(real.fragments), np.nanmean(sim.fragments), 0, 0.5),
        "ghosts": lambda: _towards(config.ghosts, np.nanmean(real.ghosts), np.nanmean(sim.ghosts), 0, 5),
        "ghost_joints": lambda: _towards(config.ghost_joints, real.ghost_joints, sim.ghost_joints, 0.05, 0.95),
        "ghost_score": lambda: _beta(config.ghost_score, real.ghost_score - sim.ghost_score, 1.0),
    }
    found = {name: change() for name, change in changes.items() if name not in kept}
    return replace(config, parts=PartsConfig(**parts), **{name: _rounded(value) for name, value in found.items()})


def _rounded(value):
    return [round(float(v), 4) for v in value] if isinstance(value, list) else round(float(value), 5)


def _corrected_part(part: PartConfig, real: Failures, sim: Failures, kind: int) -> PartConfig:
    """Noise by the median error, its tail by the errors beyond, misses by their odds, scores by mean and spread.

    Where turning away tells, misses of visible joints follow those on the camera's side of the body, and the rest is
    left to what is hidden: who turns away from one camera turns to another, and joints are seldom lost to all.
    """
    if not (sim.kind == kind).any():
        return part
    tails = [_quantile(both, kind, 0.95) / _quantile(both, kind, 0.5) for both in (real, sim)]
    missed = _more_missed(real, sim, kind)
    scores = [both.score[both.kind == kind] for both in (real, sim)]
    spread = float(scores[0].var() / max(scores[1].var(), 1e-6))
    return replace(
        part,
        noise=round(_towards(part.noise, _quantile(real, kind, 0.5), _quantile(sim, kind, 0.5), 1e-4, 0.2), 5),
        tail=round(_towards(part.tail, tails[1], tails[0], 1.5, 30), 2),
        score=_rounded(_beta(part.score, float(scores[0].mean() - scores[1].mean()), spread)),
        miss=[_shifted(share, factor**_STEP) for share, factor in zip(part.miss, missed, strict=True)],
    )


def _more_missed(real: Failures, sim: Failures, kind: int) -> list[float]:
    """Factors of the odds of misses, in the order of `PartConfig.miss`."""
    mean = _odds(float(np.nanmean(real.missed[:, kind]))) / _odds(float(np.nanmean(sim.missed[:, kind])))
    tells = np.diff(real.turned[kind])[0] > _SIDED and np.isfinite(sim.turned[kind, 0])
    near = _odds(real.turned[kind, 0]) / _odds(sim.turned[kind, 0]) if tells else mean
    return [near, mean, mean, mean]


def _beta(shape: Sequence[float], shift: float, spread: float) -> list[float]:
    """A Beta distribution moved by so much, and its variance multiplied; the constant 1 becomes one first."""
    a, b = shape if shape[1] > 0 else (30.0, 1.0)
    mean = float(np.clip(a / (a + b) + _STEP * shift, 0.02, 0.98))
    return [mean * (size := float(np.clip((a + b) / spread**_STEP, 2, 200))), (1 - mean) * size]


def _correlation(config: DetectorConfig, real: Failures, sim: Failures) -> float:
    """The time that makes errors 0.2 s apart as alike as they are, the constant share apart."""
    times = [
        -0.2 / np.log(np.clip((both.lags[0.2] - both.constant) / (1 - both.constant), 0.02, 0.98))
        for both in (real, sim)
    ]
    return _towards(max(config.correlation, 0.01), *times, 0.01, 5.0)


def _knowledge(failures: Failures) -> float:
    """Rank correlation of confidence and nearness within kinds of joints, mean over them."""
    found = []
    for kind in range(len(failures.kinds)):
        of_kind = failures.kind == kind
        if of_kind.sum() >= _ENOUGH and np.ptp(failures.score[of_kind]) > 0:
            found.append(-spearmanr(failures.score[of_kind], failures.error[of_kind]).statistic)
    return float(np.mean(found)) if found else 0.0


def _unsure(failures: Failures) -> float:
    """Median error where the confidence is low; NaN of too few."""
    some = failures.error[failures.score < _LOW]
    return float(np.median(some)) if len(some) >= _ENOUGH else float("nan")


def _bursts(times: Sequence[float], real: np.ndarray, sim: np.ndarray) -> list[float]:
    """The long time by the share of missed time in long stretches, the short one by the mean stretch."""
    if not len(sim):
        return list(times)
    long, short = times
    held = [max(runs[runs >= 0.6].sum() / runs.sum(), 0.01) for runs in (real, sim)]
    return [_towards(long, *held, 0.2, 20), _towards(short, real.mean(), sim.mean(), 0.02, 5)]


def _pairs(failures: Failures, *pairs: str) -> float:
    return float(np.nan_to_num(np.nanmean([failures.together[pair] for pair in pairs])))


def _whole(share: float, real: Failures, sim: Failures) -> float:
    return _towards(share, np.nanmean(real.person_missed), np.nanmean(sim.person_missed), 0, 0.9)


def _inverted(real: Failures, sim: Failures, *kinds: str) -> tuple[float, float]:
    """Share of left taken for right among some kinds of joints; half a joint where there is none."""
    shares = []
    for both in (real, sim):
        some = np.isin(both.kind, [both.kinds.index(kind) for kind in kinds])
        shares.append(max(both.inverted[some].sum(), 0.5) / max(some.sum(), 1))
    return shares[0], shares[1]
