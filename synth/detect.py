"""Detections from truth: what a 2D pose detector would say of a clip, and what is true of what it says."""

import zlib
from typing import NamedTuple

import numpy as np

from dmae.cameras import CameraRig
from dmae.clip import Detections2D, JointError, Poses3D, Visibility
from dmae.skeleton import BODY25
from synth.mistakes import DetectorConfig
from synth.mistakes.confusions import invert, merge, split, swapped
from synth.mistakes.errors import errors, offsets, scores
from synth.mistakes.ghosts import ghosts
from synth.mistakes.misses import misses
from synth.mistakes.parts import Effect, Luck, Seen, extent, kind_of, reported
from synth.mistakes.timing import exposed, shown

_SPREAD = {
    "nose": 0.026, "eye": 0.025, "ear": 0.035, "shoulder": 0.079, "elbow": 0.072, "wrist": 0.062, "hip": 0.107,
    "knee": 0.087, "ankle": 0.089, "big_toe": 0.068, "small_toe": 0.066, "heel": 0.066, "neck": 0.079, "mid_hip": 0.107,
}  # fmt: skip
"""Half of k in `JointError`: annotators' spread, by COCO and COCO-WholeBody; neck and middle of hips like theirs."""
_AREA = 0.53
"""Share of the box around a person's joints that the person fills, as is usual where COCO has no outline."""


class Detected(NamedTuple):
    """Detections and their truth, named like the fields of `Clip` that hold them.

    Attributes:
        detections: (F, V, D, 25) in an order that says nothing of who is who.
        detected_person: (F, V, D) int16.
        detected_joint_person: (F, V, D, 25) int16.
        detected_error: (F, V, D, 25) uint8 `JointError`.
        detected_off: (F, V, D, 25) float32, px.
    """

    detections: Detections2D
    detected_person: np.ndarray
    detected_joint_person: np.ndarray
    detected_error: np.ndarray
    detected_off: np.ndarray


def detect(
    truth: Poses3D,
    visibility: np.ndarray,
    hidden_by: np.ndarray,
    rig: CameraRig,
    fps: float,
    config: DetectorConfig,
    *,
    rng: np.random.Generator,
) -> Detected:
    """What the detector says of a clip. A view's detections do not depend on which other views there are.

    Args:
        truth: (F, P, K) poses whose skeleton holds the joints of BODY25, as such or as `body25.<joint>`.
        visibility: (F, V, P, K) `Visibility`.
        hidden_by: (F, V, P, K) index of the person or object in front.
        rig: V cameras.
        fps: Frames per second.
        config: The detector.
        rng: Drawn from once, whatever the clip.

    Raises:
        ValueError: the truth lacks joints of BODY25, arrays are of other shapes, or `fps` is not above 0.
    """
    columns = _columns(truth)
    expected = (len(truth.xyz), len(rig), *truth.xyz.shape[1:3])
    for name, array in (("visibility", visibility), ("hidden_by", hidden_by)):
        if array.shape != expected:
            raise ValueError(f"{name}: expected shape (F, V, P, K) = {expected}, found {array.shape}")
    if not fps > 0:
        raise ValueError(f"fps: expected frames per second above 0, got {fps}")
    xyz = truth.xyz[:, :, columns].astype(np.float64)
    xy, _ = rig.project(xyz)
    base = int(rng.integers(2**63))
    views = []
    for view, name in enumerate(rig.names):
        key = [base, zlib.crc32(name.encode())]

        def luck(effect, key=key):
            return np.random.default_rng([*key, effect])

        size = rig.size[view]
        seen = exposed(
            xy[:, view], visibility[:, view][..., columns], hidden_by[:, view][..., columns], size, fps, config, luck
        )
        seen = [*_see(*seen, size, fps, config, luck), ghosts(xyz, size, fps, config, luck)]
        seen[-1] = reported(seen[-1], size, config.least_score)
        seen, person = _shuffled(seen, luck)
        late = shown(len(xyz), fps, config, luck)
        views.append((_at(seen, late), np.where(late[:, None] < 0, -1, person[late])))
    return _stacked(views, xy)


def _columns(truth: Poses3D) -> list[int]:
    prefix = "body25." if "body25.nose" in truth.skeleton.joints else ""
    wanted = [prefix + joint for joint in BODY25.joints]
    lacking = [joint for joint in wanted if joint not in truth.skeleton.joints]
    if lacking:
        raise ValueError(
            f"truth of skeleton {truth.skeleton.name!r} lacks {lacking}: the simulated detector is one of BODY25, "
            "expected truth of body25, or of it and another as in body25+shelf14"
        )
    return truth.skeleton.index(*wanted)


def _see(xy, visibility, hidden_by, size, fps: float, config: DetectorConfig, luck: Luck) -> list[Seen]:
    """Detections (F, P, ...) of the persons of a clip as one view has them, and of what is torn off them."""
    missed = misses(visibility, fps, config, luck)
    guessed = (visibility != Visibility.VISIBLE) & (visibility <= Visibility.HIDDEN_BY_OBJECT)
    error, rank = errors(xy, guessed, size, fps, config, luck)
    owner = swapped(xy, visibility, hidden_by, fps, config, luck)
    meant = np.take_along_axis(xy + offsets(xy, config, luck), owner[..., None].astype(int), 1)
    score = np.where(missed, np.nan, scores(rank, guessed, fps, config, luck))
    own = owner == np.arange(xy.shape[1])[:, None]
    kind = np.where(own, JointError.GOOD, JointError.SWAPPED).astype(np.uint8)
    seen = Seen(meant + error, score, owner.astype(np.int16), kind)
    invert(seen, fps, config, luck)
    seen = reported(seen, size, config.least_score)
    merge(seen, fps, config, luck)
    return [seen, split(seen, fps, config, luck)] if config.split else [seen]


def _shuffled(parts: list[Seen], luck: Luck) -> tuple[Seen, np.ndarray]:
    """All detections in random order, those there are first, and (F, D) whose each is; ghosts are the last part."""
    rng = luck(Effect.ORDER)
    seen = Seen(*(np.concatenate(arrays, 1) for arrays in zip(*parts, strict=True)))
    frames = len(seen.score)
    person = [np.arange(part.score.shape[1]) for part in parts[:-1]] + [np.full(parts[-1].score.shape[1], -1)]
    person = np.concatenate(person).astype(np.int16)
    there = np.isfinite(seen.score).any(-1)
    order = np.argsort(rng.uniform(size=there.shape) + ~there, axis=1)
    rows = np.arange(frames)[:, None]
    return Seen(*(array[rows, order] for array in seen)), np.where(there[rows, order], person[order], -1)


def _at(seen: Seen, frames: np.ndarray) -> Seen:
    """What was seen in these frames, nothing where that is -1."""
    nothing = frames < 0
    xy, score = seen.xy[frames], seen.score[frames]
    xy[nothing], score[nothing] = np.nan, np.nan
    return Seen(xy, score, seen.owner[frames], seen.kind[frames])


def _stacked(views: list[tuple[Seen, np.ndarray]], true_xy: np.ndarray) -> Detected:
    """All views side by side, with as many places as the fullest view and frame needs, and what is true of them."""
    most = max((int(np.isfinite(seen.score).any(-1).sum(1).max(initial=0)) for seen, _ in views), default=0)
    frames = len(true_xy)
    xy = np.full((frames, len(views), most, len(BODY25), 2), np.nan, np.float32)
    score = np.full(xy.shape[:-1], np.nan, np.float32)
    person = np.full(xy.shape[:3], -1, np.int16)
    owner, kind = np.full(score.shape, -1, np.int16), np.full(score.shape, JointError.ABSENT, np.uint8)
    for view, (seen, who) in enumerate(views):
        places = min(most, who.shape[1])
        for whole, part in zip((xy, score, person, owner, kind), (seen.xy, seen.score, who, seen.owner, seen.kind),
                               strict=True):  # fmt: skip
            whole[:, view, :places] = part[:, :places]
    nothing = np.isnan(score)
    owner[nothing], kind[nothing] = -1, JointError.ABSENT
    off, similarity = _off(xy, person, true_xy)
    sized = np.select([similarity >= 0.85, similarity >= 0.5], [JointError.GOOD, JointError.JITTER], JointError.FAR)
    kind = np.where(kind == JointError.GOOD, sized, kind)
    return Detected(Detections2D(BODY25, xy, score), person, owner, kind, off)


def _off(xy: np.ndarray, person: np.ndarray, true_xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far (F, V, D, 25) joints are from those of the persons they are of, px, and their keypoint similarity."""
    off = np.full(xy.shape[:-1], np.nan, np.float32)
    similarity = np.zeros(off.shape)
    place = np.nonzero(person >= 0)
    frame, view, _ = place
    off[place] = np.linalg.norm(xy[place] - true_xy[frame, view, person[place]], axis=-1)
    low, high = extent(true_xy)
    area = _AREA * (high - low).prod(-1)[frame, view, person[place]]
    spread = 2 * np.array([_SPREAD[kind_of(joint)] for joint in BODY25.joints])
    size = np.maximum(area, 1)[:, None] * spread**2
    similarity[place] = np.nan_to_num(np.exp(-(off[place] ** 2) / (2 * size)))
    return off, similarity
