"""Simulate a 2D pose detector: compute detections from the truth of a clip, and the true labels of the detections."""

import zlib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Detections2D, Poses3D
from dmae.data.labels import DetectionLabels, JointError, OcclusionLabels
from dmae.data.skeleton import BODY25
from dmae.registry import from_outside, load_function, takes
from synth.detector.config import DetectorConfig
from synth.detector.parts import by_joint, kind_of
from synth.detector.view import ErrorStream, View, box

_SPREAD = {
    "nose": 0.026, "eye": 0.025, "ear": 0.035, "shoulder": 0.079, "elbow": 0.072, "wrist": 0.062, "hip": 0.107,
    "knee": 0.087, "ankle": 0.089, "big_toe": 0.068, "small_toe": 0.066, "heel": 0.066, "neck": 0.079, "mid_hip": 0.107,
}  # fmt: skip
"""Half of k in `JointError`: the spread of annotators in COCO and COCO-WholeBody. Neck and mid hip are assumed."""
_AREA = 0.53
"""Fraction of the box around a person's joints that the person fills: the usual value if COCO has no outline."""


class Detected(NamedTuple):
    """Detections (F, V, D, 25) in random order, and their true labels."""

    detections: Detections2D
    labels: DetectionLabels


def detect(
    truth: Poses3D,
    occlusion: OcclusionLabels,
    rig: CameraRig,
    fps: float,
    config: DetectorConfig,
    *,
    rng: np.random.Generator,
) -> Detected:
    """Simulate a detector on a clip. The detections of a view do not depend on the other views.

    Raises ValueError if the truth lacks joints of BODY25, arrays have wrong shapes, `fps` is not above 0, or a custom
    error cannot be imported.

    Args:
        truth: (F, P, K) poses on a skeleton with the joints of BODY25, with the names `<joint>` or `body25.<joint>`.
        occlusion: Visibility and occluders of the K joints of `truth` in V views.
        rig: V cameras.
        rng: Used for exactly one draw for any clip.
    """
    columns = body25_columns(truth)
    expected = (len(truth.xyz), len(rig), *truth.xyz.shape[1:3])
    if occlusion.visibility.shape != expected:
        raise ValueError(
            f"occlusion: expected visibility of shape (F, V, P, K) = {expected}, found {occlusion.visibility.shape}"
        )
    if occlusion.occluder is None:
        raise ValueError("occlusion: expected labels with occluders")
    if not fps > 0:
        raise ValueError(f"fps: expected frames per second above 0, found {fps}")
    custom = custom_errors(config)
    xyz = truth.xyz[:, :, columns].astype(np.float64)
    xy, _ = rig.project(xyz)
    parts = by_joint(config.parts)
    base = int(rng.integers(2**63))
    views = []
    for index, name in enumerate(rig.names):
        random = partial(_generator, base, zlib.crc32(name.encode()))
        view = View(
            fps=fps,
            size=rig.size[index],
            xyz=xyz,
            true_xy=xy[:, index],
            visibility=occlusion.visibility[:, index][..., columns],
            occluder=occlusion.occluder[:, index][..., columns],
            parts=parts,
            times=config.times,
            minimum_score=config.scores.minimum,
            random=random,
        )
        for error in config.errors().values():
            view = error.apply(view)
        for key, function in custom.items():
            view = function(view, rng=random(ErrorStream.CUSTOM, zlib.crc32(key.encode())))
            if not isinstance(view, View):
                raise ValueError(f"detector.custom={key}: expected it to return a View, found {type(view).__name__}")
            view = view.reported()
        views.append(_shown(view))
    return _stacked(views, xy)


def custom_errors(config: DetectorConfig) -> dict[str, Callable]:
    """Return the user's errors by name. Raises ValueError if one is not there or is not a function of a view."""
    custom = {name: from_outside(load_function("detector.custom", name)) for name in config.custom}
    for name, function in custom.items():
        if not takes(function, "view", rng=None):
            raise ValueError(
                f"detector.custom={name}: expected a function of a synth.detector.view.View and rng, as in "
                "def glare(view, *, rng): ..."
            )
    return custom


def _generator(base: int, view: int, *stream: int) -> np.random.Generator:
    return np.random.default_rng([base, view, *stream])


def body25_columns(truth: Poses3D) -> list[int]:
    """Return the indices of the joints of BODY25, with the names `<joint>` or `body25.<joint>`, in a truth.

    Raises ValueError if it lacks some.
    """
    columns = truth.skeleton.index_of_part(BODY25)
    if columns is None:
        known = {joint.removeprefix("body25.") for joint in truth.skeleton.joints}
        lacking = [joint for joint in BODY25.joints if joint not in known]
        raise ValueError(
            f"truth of skeleton {truth.skeleton.name!r} lacks {lacking}: the simulated detector is one of BODY25, "
            "expected truth of body25, or of it and another as in body25+shelf14"
        )
    return columns


def _shown(view: View) -> tuple[View, np.ndarray]:
    """Return the view as reported, detections in random order, and the person of each detection (F, D), -1 for none."""
    detected, lost = np.any(view.observed, -1), view.shown < 0
    order = np.argsort(view.random(ErrorStream.ORDER).uniform(size=detected.shape) + ~detected, axis=1)
    place = view.shown[:, None], order[view.shown]
    arrays = {name: getattr(view, name)[place] for name in ("xy", "score", "owner", "kind")}
    arrays["xy"][lost], arrays["score"][lost] = np.nan, np.nan
    return replace(view, **arrays), np.where(detected[place] & ~lost[:, None], view.person[place[1]], -1)


def _stacked(views: list[tuple[View, np.ndarray]], true_xy: np.ndarray) -> Detected:
    """Stack all views and label the detections. D is the greatest number of detections in any view and frame."""
    most = max((int(view.observed.any(-1).sum(1).max(initial=0)) for view, _ in views), default=0)
    frames = len(true_xy)
    xy = np.full((frames, len(views), most, len(BODY25), 2), np.nan, np.float32)
    score = np.full(xy.shape[:-1], np.nan, np.float32)
    person = np.full(xy.shape[:3], -1, np.int16)
    owner, kind = np.full(score.shape, -1, np.int16), np.full(score.shape, JointError.ABSENT, np.uint8)
    for index, (view, persons) in enumerate(views):
        places = min(most, persons.shape[1])
        for whole, part in ((xy, view.xy), (score, view.score), (person, persons), (owner, view.owner),
                            (kind, view.kind)):  # fmt: skip
            whole[:, index, :places] = part[:, :places]
    absent = np.isnan(score)
    owner[absent], kind[absent] = -1, JointError.ABSENT
    offset, similarity = _offset_and_similarity(xy, person, true_xy)
    by_size = np.select([similarity >= 0.85, similarity >= 0.5], [JointError.GOOD, JointError.JITTER], JointError.FAR)
    kind = np.where(kind == JointError.GOOD, by_size, kind)
    return Detected(Detections2D(BODY25, xy, score), DetectionLabels(person, owner, kind, offset))


def _offset_and_similarity(xy, person, true_xy) -> tuple[np.ndarray, np.ndarray]:
    """Return distances of joints from the true joints of their persons, px, and similarities, (F, V, D, 25) each."""
    offset = np.full(xy.shape[:-1], np.nan, np.float32)
    similarity = np.zeros(offset.shape)
    place = np.nonzero(person >= 0)
    frame, view, _ = place
    offset[place] = np.linalg.norm(xy[place] - true_xy[frame, view, person[place]], axis=-1)
    low, high = box(true_xy)
    area = _AREA * (high - low).prod(-1)[frame, view, person[place]]
    spread = 2 * np.array([_SPREAD[kind_of(joint)] for joint in BODY25.joints])
    size = np.maximum(area, 1)[:, None] * spread**2
    similarity[place] = np.nan_to_num(np.exp(-(offset[place] ** 2) / (2 * size)))
    return offset, similarity
