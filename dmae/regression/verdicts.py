"""Check a solver against the pack: measures of its errors, their bounds, and the reasons for the bounds."""

import inspect
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from dmae.progress import progress
from dmae.registry import load_function, raised_in
from dmae.regression.pack import Case, cases

SECONDS = 30.0
"""s; time limit of a solver for one case."""
_EXACT, _EXACT_IN_CORNERS = 1e-4, 3e-3  # m
_MEDIAN, _HIGH, _HIGH_IN_CROWDS = 1.15, 1.25, 1.35  # Multiples of the errors of `oracle`
_DEEPEST = 0.1  # m; points with a larger standard deviation by the oracle, along its worst direction, are not judged
_STANDARD_ERRORS = 4
_ORACLE_STEPS = 10  # Of Gauss-Newton

REASONS = {
    "worst": "Exact pixels are stored to 0.00003 px, less than a micrometre in the room. 0.1 mm allows for the last "
    "step of an iteration; half a pixel is 2 mm. With distorted pixels 95 % must be within 0.1 mm and all within 3 mm: "
    "OpenCV's undistortPoints leaves 0.1 px in the corners by default.",
    "median": "1.15 times that of least squares over the views without gross errors, started at the truth, which "
    "attains the Cramer-Rao bound. Robust weights (Huber's cost 5 %), or weights for other noise, stay within.",
    "95 %": "1.25 times that of the same least squares: gross errors that are used show here first. In crowds 1.35 "
    "times: with few views an error can be detected, but not the view that has it.",
    "bias": "The mean error of n unbiased points is within 4 standard errors of zero; half a pixel is not. Detections "
    "of the crowd are biased themselves, so that there is no bound.",
    "refused": "Points that can be known must be given. One in 50 may be refused for nearly parallel rays; from a "
    "short baseline, and of a crowd, one in 10.",
    "invented": "Points seen by fewer than two views, and points behind the cameras, must be NaN.",
}
"""By measure, the reason for its bound."""

PURPOSES = {
    "clean": "exact pixels of pinhole cameras: the geometry itself (rotations, order of views, pixel centres)",
    "off-centre": "principal points 80 to 160 px off the centre, fx and fy that differ by up to 30 %",
    "distorted-5": "five distortion coefficients, wide lenses, points out to the corners",
    "distorted-8": "eight distortion coefficients: the rational model",
    "far-world": "a room 5400 km from the origin (UTM): enough digits, or coordinates relative to the cameras",
    "moving": "15 joints over 20 frames at 1.5 m/s: every point in its own frame and its own place",
    "absent": "views missing: two are enough, with fewer the point is NaN",
    "unsure": "exact pixels of confidences from 0.1 to 0.45: a low confidence weighs less, it removes nothing",
    "unrated": "pixels without a confidence (NaN), which agree on another point: they do not count",
    "skewed": "axes of pixels that are not at right angles: K[0, 1] of 20 to 60 px",
    "outside": "points 10 to 150 px outside the images of most views: they are used as they are, not clipped",
    "behind": "half the points lie behind the cameras, where the lines of sight meet: NaN",
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
    "crowd-5": "six people and two occluding objects, simulated; detections err, miss and swap as OpenPose's do",
    "crowd-3": "the same crowd seen by three of the five cameras",
}
"""By case, the property of a solver that it tests."""


@dataclass(frozen=True, repr=False)
class Verdict:
    """The result of one case."""

    case: Case  # The case
    # By measure, its value: errors and bias in m, refused a fraction, invented a count. Empty where the solver gave
    # nothing to measure.
    measured: dict[str, float]
    bounds: dict[str, float]  # By measure, the largest value allowed; measures without an entry are not bounded
    # Reason why nothing could be measured: the solver raised an error, took too long, or did not return (n, 3) numbers
    problem: str = ""

    @property
    def broken(self) -> tuple[str, ...]:
        """The measures that exceed their bounds."""
        # The errors of a solver that refuses everything are NaN, which is not within bounds.
        return tuple(key for key in self.measured if key in self.bounds and not self.measured[key] <= self.bounds[key])

    @property
    def passed(self) -> bool:
        """True where every bound holds."""
        return not self.problem and not self.broken

    def __str__(self) -> str:
        """Return one line: the bounds that are exceeded, and the purpose of the case."""
        found = [
            f"{key} {text(key, self.measured[key])} where {text(key, self.bounds[key])} is allowed"
            for key in self.broken
        ]
        return f"{self.case.name}: {self.problem or '; '.join(found) or 'ok'} ({PURPOSES[self.case.name]})"

    def __repr__(self) -> str:
        """Return the text without the purpose, so that a list of all cases can be read."""
        return f"<{str(self).removesuffix(f' ({PURPOSES[self.case.name]})')}>"


def text(measure: str, value: float) -> str:
    """Return a measure as printed: errors in mm, fractions in %."""
    if measure == "invented":
        return f"{value:.0f}"
    if measure == "refused":
        return f"{value:.0%}" if value in (0, 1) or value > 0.1 else f"{value:.1%}"
    return f"{1000 * value:.{2 if value < 0.01 else 1 if value < 0.1 else 0}f} mm"


def check(solver: Callable | str, skip: Sequence[str] = (), seconds: float = SECONDS) -> list[Verdict]:
    """Check a solver, as `dmae.regress` describes it, against every case of the pack, except those to skip, by name.

    `seconds` is the time limit for one case. Raises ValueError if it is not positive, `skip` has a name that no case
    has, or the solver is not a function of these keywords or the name of one, `package.module:function`.
    """
    solver = _solver(solver)
    if not seconds > 0:
        raise ValueError(f"seconds={seconds:g}: expected a time limit above 0")
    names = [case.name for case in cases()]
    unknown = [name for name in skip if name not in names]
    if unknown:
        raise ValueError(f"skip: no case {', '.join(map(repr, unknown))}; there are {', '.join(names)}")
    chosen = [case for case in cases() if case.name not in skip]
    return [check_case(solver, case, seconds) for case in progress(chosen, "checking")]


def _solver(given: Callable | str) -> Callable:
    """Return the solver, imported if it is `package.module:function`; ValueError if it cannot be called as one."""
    solver = load_function("solver", given, "dmae.regression.solvers:ours") if isinstance(given, str) else given
    keywords = ", ".join(cases()[0].arrays())
    try:
        if not callable(solver):
            raise TypeError("it cannot be called")
        inspect.signature(solver).bind(**cases()[0].arrays())
    except TypeError as error:
        found = f"{solver.__name__}{inspect.signature(solver)}" if inspect.isfunction(solver) else f"{solver!r:.80}"
        name = given if isinstance(given, str) else getattr(given, "__name__", f"{given!r:.80}")
        raise ValueError(
            f"solver={name}: {error}; expected a function of the keywords {keywords} that returns (n, 3) points, found "
            f"{found}"
        ) from None
    except ValueError:
        pass  # compiled functions may have no signature
    return solver


def check_case(solver: Callable, case: Case, seconds: float = SECONDS) -> Verdict:
    """Check a solver against one case, as `check` does."""
    try:
        with _at_most(seconds):
            given = solver(**case.arrays())
        xyz = np.asarray(given, np.float64)
    except _TooSlow:
        return Verdict(case, {}, {}, f"did not return within {seconds:g} s")
    # sys.exit(0) in a solver must not end the check with success.
    except (Exception, SystemExit) as error:
        return Verdict(case, {}, {}, f"raised {raised_in(error, solver)}")
    if given is None:
        return Verdict(case, {}, {}, "returned None, expected (n, 3) points")
    if xyz.shape != case.xyz.shape:
        return Verdict(case, {}, {}, f"returned shape {xyz.shape}, expected {case.xyz.shape} of xy {case.xy.shape}")
    infinite = np.isinf(xyz).any(-1)
    if infinite.any():
        return Verdict(case, {}, {}, f"{infinite.sum()} points are infinite, expected NaN where it refuses")
    return Verdict(case, _measure(case, xyz), _bounds(case))


def assert_passes(solver: Callable, case: Case) -> None:
    """Raise AssertionError, with the bounds that are exceeded, if a solver does not pass a case."""
    __tracebackhide__ = True  # pytest then points to the test that called this
    verdict = check_case(solver, case)
    if not verdict.passed:
        raise AssertionError(str(verdict))


class _TooSlow(BaseException):
    """Raised at the time limit. It is not an `Exception`: a solver that catches every `Exception` does not catch it."""


@contextmanager
def _at_most(seconds: float) -> Iterator[None]:
    """Raise `_TooSlow` at the time limit. It has no effect on Windows, in threads and in compiled code."""
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
    """Return the measures, named as in `REASONS`, of a solver's points (n, 3)."""
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
    """Return (n,) True for the points with errors that count."""
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


def oracle(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Return the best estimate possible, (n, 3) m, and its covariance, if the views with gross errors are known.

    Gauss-Newton from the truth on the reprojection errors of the usable views, without distortion. Where they are
    normal this is the maximum likelihood estimate, and its covariance, (J^T J)^-1 sigma^2, the Cramer-Rao bound
    (Hartley & Zisserman, 2nd ed., 5.2). With fewer than two usable views, the estimate is the truth and the covariance
    NaN.
    """
    xyz, cov = case.xyz.copy(), np.full((len(case.xyz), 3, 3), np.nan)
    P, due = case.K @ case.cam_from_world[:, :3], case.due
    usable, xy = case.usable[due][..., None], case.xy[due]
    for _ in range(_ORACLE_STEPS):
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
