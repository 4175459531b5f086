"""How the detections of a recording fail, measured alike on real and on simulated ones.

Nothing but detections and cameras is needed: people are reconstructed by capture, and errors taken against what the
other views say of a joint. So a real recording and its simulation are judged by the same yardstick, which is a
little pessimistic for both. Where people are annotated, the annotation can be the yardstick instead.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from dmae.baselines import METHODS, smooth
from dmae.capture import CaptureConfig, capture
from dmae.clip import Clip, Poses3D
from dmae.mapping import convert
from dmae.metrics import gap_lengths
from synth.whose import Match, match_persons

GROSS = 0.1
"""Errors above so many heights are no longer noise."""
_SMOOTHING, _LONGEST = 0.1, 0.4
"""s; the reference is smoothed lightly, and bridges short gaps only."""
_OUT = 0.05
"""m; joints nearer to the vertical through the middle of head or shoulders lie on no side of it."""


class Truth(StrEnum):
    """What detections are judged against."""

    others = "others"
    """What capture makes of the other views."""
    annotated = "annotated"
    """The recording's own truth, on the joints that it shares with the detector."""


@dataclass(frozen=True)
class Failures:
    """What was measured. Kinds are joints, left and right alike. Lengths are in heights of the person in the image.

    Attributes:
        name: Of the recording.
        fps: Frames per second.
        kinds: (K,) names.
        kind: (n,) of each detected joint that other views locate: index into `kinds`.
        error: (n,) how far it is from where they see it.
        inverted: (n,) True where it is nearer to where they see its partner of the other side, by half and by GROSS.
        score: (n,) its confidence.
        missed: (V, K) share of the joints in the image, of people detected, that are missed.
        turned: (K, 2) the same share where the joint lies on the camera's side of the body, and where on the other.
        together: {"a|b": share of the missed joints of kind b on whose side the one of kind a is missed too}.
        views: (K, V + 1) share of the joints seen by 0..V views.
        runs: (r,) lengths of misses, s.
        lags: {s: correlation of the errors so far apart}.
        constant: Share of the energy of the errors that is constant for a person, view and joint.
        person_missed: (V,) share of the people in the image who are missed whole.
        ghosts: (V,) false persons a frame.
        ghost_joints: Median number of their joints; `ghost_score`, median of their confidences.
        fragments: (V,) pieces of people, apart from their largest, a frame.
    """

    name: str
    fps: float
    kinds: tuple[str, ...]
    kind: np.ndarray
    error: np.ndarray
    inverted: np.ndarray
    score: np.ndarray
    missed: np.ndarray
    turned: np.ndarray
    together: dict[str, float]
    views: np.ndarray
    runs: np.ndarray
    lags: dict[float, float]
    constant: float
    person_missed: np.ndarray
    ghosts: np.ndarray
    ghost_joints: float
    ghost_score: float
    fragments: np.ndarray


def measure(clip: Clip, truth: Truth = Truth.others) -> Failures:
    """Measure the failures of a clip's detections.

    Raises:
        ValueError: fewer than three cameras, so that no joint can be checked against the others; no annotation that
            is asked for; or nobody is there to be measured on.
    """
    views = len(clip.rig)
    if truth == Truth.annotated:
        clip = _annotated(clip)
    elif views < 3:
        raise ValueError(
            f"clip {clip.id!r}: errors are measured against the other views, which takes 3 cameras or more"
        )
    reference = _reference(clip, truth)
    whole = match_persons(clip, reference)
    if not whole.matched.any():
        raise ValueError(f"clip {clip.id!r}: nobody is detected in two views or more, there is nothing to measure")
    joints = clip.detections.skeleton.joints
    kinds = tuple(dict.fromkeys(_kind(joint) for joint in joints))
    kind_of = np.array([kinds.index(_kind(joint)) for joint in joints])
    errors = [_errors(clip, view, truth) for view in range(views)]
    error, inverted, score, kind = (np.concatenate([part[i] for part in errors]) for i in range(4))
    expected = whole.matched[..., None] & ~np.isnan(whole.xy[..., 0])
    missed = expected & np.isnan(whole.score)
    in_image = ~np.isnan(whole.height)
    sides = _sides(clip, reference)
    ghosts = whole.left_over & ~whole.near
    ghost_sees = ~np.isnan(clip.detections.score) & ghosts[..., None]
    energy = [part[4] for part in errors]
    return Failures(
        name=clip.id,
        fps=clip.fps,
        kinds=kinds,
        kind=kind_of[kind],
        error=error,
        inverted=inverted,
        score=score,
        missed=np.stack([_share(missed, expected, kind_of == k, (0, 2, 3)) for k in range(len(kinds))], -1),
        turned=np.stack(
            [
                [_share(missed & side, expected & side, kind_of == k, (0, 1, 2, 3)) for side in sides]
                for k in range(len(kinds))
            ]
        ),
        together=_together(missed, expected, clip),
        views=np.stack([_views_histogram(whole, kind_of == k) for k in range(len(kinds))]),
        runs=_runs(missed, expected) / clip.fps,
        lags={lag: _mean_ratio([part[lag] for part in energy]) for lag in (0.04, 0.2)},
        constant=_mean_ratio([part["constant"] for part in energy]),
        person_missed=_ratio((in_image & ~whole.matched).sum((0, 2)), in_image.sum((0, 2))),
        ghosts=ghosts.sum((0, 2)) / len(clip),
        ghost_joints=float(np.median(ghost_sees.sum(-1)[ghosts])) if ghosts.any() else float("nan"),
        ghost_score=float(np.median(clip.detections.score[ghost_sees])) if ghosts.any() else float("nan"),
        fragments=(whole.left_over & whole.near).sum((0, 2)) / len(clip),
    )


def _kind(joint: str) -> str:
    return joint.removeprefix("l_").removeprefix("r_")


def _ratio(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    return np.where(whole > 0, part / np.maximum(whole, 1), np.nan)


def _mean_ratio(parts: list[tuple[float, float]]) -> float:
    above, below = np.sum(parts, 0)
    return float(above / below) if below > 0 else float("nan")


def _share(event: np.ndarray, counted: np.ndarray, joints: np.ndarray, axis: tuple[int, ...]) -> np.ndarray:
    return _ratio(event[..., joints].sum(axis), counted[..., joints].sum(axis))


def _annotated(clip: Clip) -> Clip:
    """The frames in which somebody is annotated."""
    if clip.truth is None or np.isnan(clip.truth.xyz).all():
        raise ValueError(f"clip {clip.id!r}: nobody is annotated; measure against the other views with truth=others")
    return clip.select(frames=np.flatnonzero(~np.isnan(clip.truth.xyz).all((1, 2, 3))))


def _reference(clip: Clip, truth: Truth) -> Poses3D:
    """Who is where: as annotated, or as capture says, short gaps bridged."""
    if truth == Truth.annotated:
        return convert(clip.truth, clip.detections.skeleton)
    poses = capture(clip, CaptureConfig())
    short = gap_lengths(poses.measured) <= _LONGEST * clip.fps
    filled = smooth(METHODS["linear"](poses, clip.fps), clip.fps, _SMOOTHING)
    return Poses3D(poses.skeleton, np.where(short[..., None], filled.xyz, np.nan))


def _errors(clip: Clip, view: int, truth: Truth) -> tuple:
    """Errors of the joints detected in one view, against the truth or people reconstructed from the others.

    Returns:
        error, inverted, score, joint: (n,) each, and the energies that `Failures.lags` and `.constant` are ratios of.
    """
    others = [other for other in range(len(clip.rig)) if other != view]
    match = match_persons(clip.select(views=[view]), _reference(clip.select(views=others), truth))
    off = (match.found - match.xy)[:, 0] / match.height[:, 0, :, None, None]
    mirror = np.asarray(clip.detections.skeleton.mirror)
    across = np.linalg.norm((match.found - match.xy[..., mirror, :])[:, 0], axis=-1) / match.height[:, 0, :, None]
    size = np.linalg.norm(off, axis=-1)
    known = ~np.isnan(size)
    inverted = (size > GROSS) & (across < size / 2) & (mirror != np.arange(len(mirror)))
    energies = {lag: _correlation(off, size, max(round(lag * clip.fps), 1)) for lag in (0.04, 0.2)}
    fine = np.where((size < GROSS)[..., None], off, np.nan)
    count = (~np.isnan(fine[..., 0])).sum(0)
    total = np.where(np.isnan(fine), 0, fine)
    long = count > clip.fps
    energies["constant"] = (
        float(((total.sum(0) ** 2).sum(-1)[long] / count[long]).sum()),
        float((total**2).sum((0, -1))[long].sum()),
    )
    return size[known], inverted[known], match.score[:, 0][known], np.nonzero(known)[-1], energies


def _correlation(off: np.ndarray, size: np.ndarray, frames: int) -> tuple[float, float]:
    """Products of errors so many frames apart, and of themselves; gross ones left out."""
    both = (size[:-frames] < GROSS) & (size[frames:] < GROSS)
    first, second = off[:-frames][both], off[frames:][both]
    return float((first * second).sum()), float(((first**2).sum() + (second**2).sum()) / 2)


def _together(missed: np.ndarray, expected: np.ndarray, clip: Clip) -> dict[str, float]:
    """Elbow and wrist, knee and ankle: how often the one is missed with the other."""
    index, shares = clip.detections.skeleton.index, {}
    for a, b in (("elbow", "wrist"), ("wrist", "elbow"), ("knee", "ankle"), ("ankle", "knee")):
        first, second = index(f"l_{a}", f"r_{a}"), index(f"l_{b}", f"r_{b}")
        both = expected[..., first] & expected[..., second] & missed[..., second]
        shares[f"{a}|{b}"] = float(_ratio((missed[..., first] & both).sum(), both.sum()))
    return shares


def _sides(clip: Clip, reference: Poses3D) -> tuple[np.ndarray, np.ndarray]:
    """(F, V, P, J) True for joints within 60 degrees of the camera's direction, and opposite.

    Of the face as seen from between the ears, of limbs from between the shoulders; neck and trunk have no sides.
    """
    flat, index = reference.xyz[..., :2].astype(np.float64), reference.skeleton.index
    middles = [flat[:, :, index(f"l_{part}", f"r_{part}")].mean(2, keepdims=True) for part in ("shoulder", "ear")]
    of_face = np.array([_kind(joint) in ("nose", "eye", "ear") for joint in reference.skeleton.joints])
    out = flat - np.where(of_face[:, None], middles[1], middles[0])
    length = np.linalg.norm(out, axis=-1)
    sided = of_face | (np.array(reference.skeleton.mirror) != np.arange(len(of_face)))
    out = np.where(((length > _OUT) & sided)[..., None], out / np.maximum(length, _OUT)[..., None], np.nan)
    sight = clip.rig.centers[:, None, None, :2] - flat[:, None]
    along = (sight * out[:, None]).sum(-1) / np.linalg.norm(sight, axis=-1)
    return along > 0.5, along < -0.5


def _views_histogram(match: Match, joints: np.ndarray) -> np.ndarray:
    """(V + 1,) share of the joints, of people in at least two images, that 0..V views detect."""
    there = (~np.isnan(match.height)).sum(1) >= 2
    count = (~np.isnan(match.score[..., joints])).sum(1)[there]
    return np.bincount(count.ravel(), minlength=match.score.shape[1] + 1) / max(count.size, 1)


def _runs(missed: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Lengths in frames of stretches in which a joint is missed, each counted once; those cut off by the ends too."""
    lengths = gap_lengths(~missed)
    starts = missed & np.concatenate([np.ones_like(missed[:1]), ~missed[:-1]])
    return lengths[starts & expected]
