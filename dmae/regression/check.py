"""A solver against the pack: what it got wrong, how wrong it may be, and why so much."""

import signal
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dmae.progress import progress
from dmae.regression.pack import Case, cases

SECONDS = 30.0
"""What a solver may take for one case."""
_EXACT, _EXACT_IN_CORNERS = 1e-4, 3e-3
"""m."""
_MEDIAN, _HIGH, _HIGH_IN_CROWDS = 1.15, 1.25, 1.35
"""Times the errors of `oracle`."""
_DEEPEST = 0.1
"""m; points that even the oracle knows worse, along their worst direction, are not judged."""
_STANDARD_ERRORS = 4

REASONS = {
    "worst": "Exact pixels are known to 0.00003 px, less than a micrometre in the room. 0.1 mm leaves room for the "
    "last step of an iteration, and half a pixel makes 2 mm. Of distorted pixels 95 % must be so near and none 3 mm "
    "off: by default OpenCV's undistortPoints leaves 0.1 px in the corners.",
    "median": "1.15 times that of least squares over the views without gross errors, begun at the truth: it attains "
    "the Cramer-Rao bound, and weights that follow another noise, or are robust (Huber's cost 5 %), stay within.",
    "95 %": "1.25 times that of the same least squares: gross errors that get through show here first. In crowds 1.35 "
    "times: of few views one can be seen to err and it cannot be told which.",
    "bias": "The mean error of n points that nothing pulls to one side is within 4 standard errors of zero. Half a "
    "pixel is not. Detections of the crowd are biased themselves: no bound.",
    "refused": "What can be known must be given. A few rays in 50 may be held to be too nearly parallel; from a short "
    "baseline, and of a crowd, one in 10.",
    "invented": "What fewer than two views saw, or none can have seen, must be NaN. Nobody saw a point behind him.",
}
"""Why each measure is bounded as it is."""

ASKS = {
    "clean": "exact pixels of pinhole cameras: the geometry itself (rotations, order of views, pixel centres)",
    "off-centre": "principal points 80 to 160 px off the centre, fx and fy that differ by up to 30 %",
    "distorted-5": "five distortion coefficients, wide lenses, points out to the corners",
    "distorted-8": "eight distortion coefficients: the rational model",
    "far-world": "a room 5400 km from the origin (UTM): enough digits, or points taken relative to the cameras",
    "moving": "15 joints over 20 frames at 1.5 m/s: every point in its own frame and its own place",
    "absent": "views missing: two are enough, one or none is NaN",
    "behind": "half the points lie where lines of sight meet behind the cameras: NaN",
    "views-2": "two views, 1 px of noise",
    "views-3": "three views, 1 px of noise",
    "views-4": "four views, 1 px of noise",
    "views-6": "six views, 1 px of noise: each of them used",
    "views-8": "eight views, 1 px of noise: each of them used",
    "views-12": "twelve views, 1 px of noise: each of them used",
    "noisy": "five views, 3 px of noise",
    "short-baseline": "three cameras within 0.6 m, 4.5 m away, 0.5 px of noise",
    "outliers-1-of-5": "one of five views 50 to 300 px off, as confident as the others",
    "outliers-2-of-8": "two of eight views 50 to 300 px off, as confident as the others",
    "doubted": "one of four views 50 to 300 px off, at confidence 0.05 where the others have 0.8 to 0.95",
    "crowd-5": "six people and two things to hide behind, simulated; detections err, miss and swap as OpenPose's do",
    "crowd-3": "the same crowd seen by three of the five cameras",
}
"""What each case asks of a solver."""


@dataclass(frozen=True)
class Verdict:
    """What came of one case.

    Attributes:
        case: The case.
        measured: Measure to what was found: errors and bias in m, refused a share, invented a count. Empty where the
            solver gave nothing to measure.
        bounds: Measure to the most allowed; what is not in it is not bounded.
        problem: Why there is nothing to measure: it raised, took too long, gave no (n, 3) numbers.
    """

    case: Case
    measured: dict[str, float]
    bounds: dict[str, float]
    problem: str = ""

    @property
    def broken(self) -> tuple[str, ...]:
        """The measures that are over their bounds."""
        # A solver that refuses everything has no error to measure: NaN is not within bounds either.
        return tuple(key for key in self.measured if key in self.bounds and not self.measured[key] <= self.bounds[key])

    @property
    def passed(self) -> bool:
        """True where every bound holds."""
        return not self.problem and not self.broken

    def __str__(self) -> str:
        """One line: what is broken, and what the case asks for."""
        found = [
            f"{key} {text(key, self.measured[key])} where {text(key, self.bounds[key])} is allowed"
            for key in self.broken
        ]
        return f"{self.case.name}: {self.problem or '; '.join(found) or 'ok'} ({ASKS[self.case.name]})"


def text(measure: str, value: float) -> str:
    """A measure as printed: errors in mm, shares in %."""
    if measure == "invented":
        return f"{value:.0f}"
    if measure == "refused":
        return f"{value:.0%}" if value in (0, 1) or value > 0.1 else f"{value:.1%}"
    return f"{1000 * value:.{2 if value < 0.01 else 1 if value < 0.1 else 0}f} mm"


def check(solver: Callable, skip: Sequence[str] = (), seconds: float = SECONDS) -> list[Verdict]:
    """A solver against every case of the pack, but for those to be skipped.

    Args:
        solver: Takes keywords `K` (V, 3, 3), `dist` (V, 5) or (V, 8), `cam_from_world` (V, 4, 4) m, `size` (V, 2) px,
            `xy` (n, V, 2) px, distorted, NaN where absent, and `confidence` (n, V); returns (n, 3) m, NaN where it
            refuses. Cameras are OpenCV's, none a fisheye; pixel (0, 0) is the centre of the first pixel.
        skip: Names of cases.
        seconds: What it may take for one case.

    Raises:
        ValueError: there is no case of a name in `skip`.
    """
    names = [case.name for case in cases()]
    unknown = [name for name in skip if name not in names]
    if unknown:
        raise ValueError(f"skip: no case {', '.join(map(repr, unknown))}; there are {', '.join(names)}")
    chosen = [case for case in cases() if case.name not in skip]
    return [check_case(solver, case, seconds) for case in progress(chosen, "checking")]


def check_case(solver: Callable, case: Case, seconds: float = SECONDS) -> Verdict:
    """A solver against one case; as `check`."""
    try:
        with _at_most(seconds):
            given = solver(**case.arrays())
        xyz = np.asarray(given, np.float64)
    except _TooSlow:
        return Verdict(case, {}, {}, f"did not return within {seconds:g} s")
    # sys.exit(0) in a solver must not end a check as if it were passed.
    except (Exception, SystemExit) as error:
        return Verdict(case, {}, {}, _raised(error))
    if xyz.shape != case.xyz.shape:
        return Verdict(case, {}, {}, f"returned shape {xyz.shape}, expected {case.xyz.shape}")
    infinite = np.isinf(xyz).any(-1)
    if infinite.any():
        return Verdict(case, {}, {}, f"{infinite.sum()} points are infinite, expected NaN where it refuses")
    return Verdict(case, _measure(case, xyz), _bounds(case))


def assert_passes(solver: Callable, case: Case) -> None:
    """AssertionError with what is wrong if a solver breaks a bound of a case."""
    __tracebackhide__ = True  # by pytest: the reader's own test is the place
    verdict = check_case(solver, case)
    if not verdict.passed:
        raise AssertionError(str(verdict))


def _raised(error: BaseException) -> str:
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"raised {type(error).__name__}: {error} ({Path(last.filename).name}, line {last.lineno})"


class _TooSlow(BaseException):
    """No Exception, so that a solver that catches those does not catch this."""


@contextmanager
def _at_most(seconds: float) -> Iterator[None]:
    """Raise `_TooSlow` after so long, where the system can interrupt: not on Windows, in threads, in compiled code."""
    if not hasattr(signal, "SIGALRM") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(*_):
        raise _TooSlow

    before = signal.signal(signal.SIGALRM, stop)
    timer = signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, *timer)
        signal.signal(signal.SIGALRM, before)


def _measure(case: Case, xyz: np.ndarray) -> dict[str, float]:
    """The measures of `REASONS` of points (n, 3)."""
    judged = _judged(case)
    given = np.isfinite(xyz).all(-1)
    errors = (xyz - case.xyz)[judged & given]
    shares = {"refused": float(1 - given[judged].mean()), "invented": float(given[case.unknowable].sum())}
    return (_errors(errors) if len(errors) else dict.fromkeys(("median", "95 %", "worst", "bias"), np.nan)) | shares


def _errors(errors: np.ndarray) -> dict[str, float]:
    distance = np.linalg.norm(errors, axis=-1)
    return {
        "median": float(np.median(distance)),
        "95 %": float(np.quantile(distance, 0.95)),
        "worst": float(distance.max()),
        "bias": float(np.linalg.norm(errors.mean(0))),
    }


def _judged(case: Case) -> np.ndarray:
    """(n,) True for the points whose error counts."""
    if not case.sigma:
        return case.due
    deepest = np.zeros(len(case.xyz))
    deepest[case.due] = np.linalg.eigvalsh(oracle(case)[1][case.due])[:, -1]
    return case.due & (deepest <= _DEEPEST**2)


def _bounds(case: Case) -> dict[str, float]:
    crowd = case.name.startswith("crowd")
    few = 0.1 if crowd or case.name == "short-baseline" else 0.02
    if not case.sigma:
        wide = {"95 %": _EXACT, "worst": _EXACT_IN_CORNERS} if case.dist.any() else {"worst": _EXACT}
        return wide | {"refused": few if case.name == "absent" else 0.0, "invented": 0}
    judged = _judged(case)
    errors = (oracle(case)[0] - case.xyz)[judged]
    best = _errors(errors)
    high = _HIGH_IN_CROWDS if crowd else _HIGH
    found = {"median": _MEDIAN * best["median"], "95 %": high * best["95 %"], "refused": few, "invented": 0}
    standard_error = _MEDIAN * np.sqrt((errors**2).sum(-1).mean() / judged.sum())
    return found if crowd else found | {"bias": float(_STANDARD_ERRORS * standard_error)}


def oracle(case: Case, steps: int = 10) -> tuple[np.ndarray, np.ndarray]:
    """The best that can be done by who knows which views are grossly wrong, of cameras without distortion.

    Gauss-Newton from the truth on the reprojection errors of the usable views. Where they are normal this is the
    maximum likelihood estimate, and its covariance, (J^T J)^-1 sigma^2, the Cramer-Rao bound (Hartley & Zisserman,
    2nd ed., 5.2).

    Returns:
        xyz: (n, 3) m; the truth where fewer than two views are usable.
        cov: (n, 3, 3) m^2; NaN there.
    """
    xyz, cov = case.xyz.copy(), np.full((len(case.xyz), 3, 3), np.nan)
    P, due = case.K @ case.cam_from_world[:, :3], case.due
    usable, xy = case.usable[due][..., None], case.xy[due]
    for _ in range(steps):
        homogeneous = np.einsum("vij,nj->nvi", P, np.c_[xyz[due], np.ones(due.sum())])
        depth = homogeneous[..., 2:]
        pixels = homogeneous[..., :2] / depth
        residual = np.where(usable, pixels - xy, 0)
        jacobian = (P[:, :2, :3] - pixels[..., None] * P[:, None, 2, :3]) / depth[..., None]
        jacobian = np.where(usable[..., None], jacobian, 0)
        information = np.einsum("nvki,nvkj->nij", jacobian, jacobian)
        gradient = np.einsum("nvki,nvk->ni", jacobian, residual)
        xyz[due] -= np.linalg.solve(information, gradient[..., None])[..., 0]
    cov[due] = np.linalg.inv(information) * case.sigma**2
    return xyz, cov
