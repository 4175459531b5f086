"""Check rigs: capture people that were not used in planning, and score the captures."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Poses3D
from dmae.data.conversion import convert
from dmae.data.skeleton import Skeleton, get_skeleton
from dmae.metrics.comparison import Comparison
from dmae.metrics.identity import identity_switches, idf1
from dmae.metrics.pcp import correct_limbs
from dmae.metrics.position import percent
from dmae.numerics.filling import fill_world, smooth
from dmae.numerics.paths import linear
from dmae.numerics.statistics import mean_known
from dmae.parallel import in_parallel
from dmae.progress import progress
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture
from synth.detector.config import DetectorConfig
from synth.planning.config import PlanConfig
from synth.planning.rehearsal import rehearse

FIGURES = {
    "missing": ("joints not measured", "%"),
    "pcp": ("PCP", "%"),
    "error": ("error", "mm"),
    "switches": ("identities confused", "a minute"),
    "idf1": ("IDF1", "%"),
}
"""Scored figures: heading and unit. PCP and the error are computed after gaps are filled by straight lines and the
paths are smoothed, as in `dmae evaluate methods=[linear]`."""
_SMOOTH = 0.1
_LEVEL = 0.95


@dataclass(frozen=True)
class Expected:
    """The expected value of a figure of a rig, with its 95 % interval over clips."""

    value: float
    low: float
    high: float


def measure(captured: Poses3D, truth: Poses3D, fps: float) -> dict[str, float]:
    """Return the figures of `FIGURES` of one capture. A figure without data is NaN.

    Args:
        captured: Poses from `dmae.capture`.
        truth: (F, T) true people, on the skeleton of the comparison.
        fps: Frames per second.
    """
    filled = convert(smooth(fill_world(captured, fps, linear), fps, _SMOOTH), truth.skeleton)
    actors = tuple(np.flatnonzero(np.isfinite(truth.xyz).all(-1).any((0, 2))))
    compared = Comparison(filled, convert(captured, truth.skeleton), truth, actors, fps=fps)
    correct, known = correct_limbs(compared.matched, truth.xyz, truth.skeleton)
    error = np.linalg.norm(compared.matched - truth.xyz.astype(np.float64), axis=-1)
    minutes = len(truth.xyz) / fps / 60
    return {
        "missing": float(percent(compared.hidden & compared.known, compared.known, None)),
        "pcp": float(mean_known(percent(correct, known, (0, 2))[list(actors)])),
        "error": 1000 * float(mean_known(error, None)),
        "switches": identity_switches(compared.matches) / minutes,
        "idf1": idf1(filled.xyz, truth.xyz),
    }


def scored_skeleton(clip: Clip) -> Skeleton:
    """Return the skeleton that captures are scored on. For a fused skeleton this is its second part."""
    return get_skeleton(clip.truth.skeleton.parts[-1].name)


def check_rigs(
    config: PlanConfig, cameras: CameraRig, rigs: Sequence[Sequence[int]], numbers: Sequence[int]
) -> dict[str, np.ndarray]:
    """Capture clips with each rig.

    People are simulated once for all rigs. A camera has the same detections in every rig that contains it.

    Args:
        config: The plan.
        cameras: All cameras of the rigs.
        rigs: Indices of the cameras of each of R rigs; each rig has at least two.
        numbers: Numbers of N clips.

    Returns:
        The figures of `FIGURES`, (R, N) each.

    Raises:
        FailedSimulation: a clip failed with every seed.
    """
    tasks = ((config, cameras, [list(rig) for rig in rigs], number) for number in numbers)
    made = in_parallel(_check_clip, tasks, config.workers)
    clips = list(progress(made, "capturing people not used in planning", len(numbers)))
    return {name: np.array([[found[name] for found in clip] for clip in clips]).T for name in FIGURES}


def _check_clip(config: PlanConfig, cameras: CameraRig, rigs: list[list[int]], number: int) -> list[dict]:
    return capture_all(_seen(config, config.detector, cameras, number), rigs)


def _seen(config: PlanConfig, detector: DetectorConfig, cameras: CameraRig, number: int) -> Clip:
    return rehearse(config, number).seen_by(cameras, detector)


def capture_all(clip: Clip, rigs: Sequence[Sequence[int]]) -> list[dict[str, float]]:
    """Return the figures of a clip for each subset of its cameras in `rigs`."""
    truth = convert(clip.truth, scored_skeleton(clip))
    return [measure(capture(clip.select(views=list(rig)), CaptureConfig()), truth, clip.fps) for rig in rigs]


def expected(figures: np.ndarray, least: float = -np.inf, greatest: float = np.inf) -> Expected:
    """Return the mean of a figure over N clips, with its interval for clips of other people (Student's t).

    Clips without the figure are left out. The interval is NaN if fewer than two clips remain.

    Args:
        figures: (N,) the figure in each clip.
        least, greatest: Possible range of the figure. The interval is cut at these limits.
    """
    known = figures[np.isfinite(figures)]
    if not len(known):
        return Expected(np.nan, np.nan, np.nan)
    mean = float(known.mean())
    if len(known) < 2:
        return Expected(mean, np.nan, np.nan)
    half = stats.t.ppf((1 + _LEVEL) / 2, len(known) - 1) * known.std(ddof=1) / np.sqrt(len(known))
    return Expected(mean, max(mean - float(half), least), min(mean + float(half), greatest))
