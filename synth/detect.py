"""Detections from truth: what a 2D pose detector would say of a clip."""

import zlib

import numpy as np

from dmae.cameras import CameraRig
from dmae.clip import Detections2D, Poses3D
from dmae.skeleton import BODY25
from synth.mistakes import DetectorConfig, Seen, see_ghosts, see_persons


def detect(
    truth: Poses3D,
    visibility: np.ndarray,
    hidden_by: np.ndarray,
    rig: CameraRig,
    fps: float,
    config: DetectorConfig,
    *,
    rng: np.random.Generator,
) -> tuple[Detections2D, np.ndarray]:
    """What the detector says of a clip. A view's detections do not depend on which other views there are.

    Args:
        truth: (F, P, K) poses whose skeleton holds the joints of BODY25, as such or as `body25.<joint>`.
        visibility: (F, V, P, K) `Visibility`.
        hidden_by: (F, V, P, K) index of the person or object in front.
        rig: V cameras.
        fps: Frames per second.
        config: The detector.
        rng: Drawn from once, whatever the clip.

    Returns:
        detections: (F, V, D, 25) in an order that says nothing of who is who.
        detected_person: (F, V, D) int16 person index of each detection, -1 for ghosts and where there is none.
    """
    prefix = "body25." if "body25.nose" in truth.skeleton.joints else ""
    columns = truth.skeleton.index(*(prefix + joint for joint in BODY25.joints))
    xyz = truth.xyz[:, :, columns].astype(np.float64)
    xy, _ = rig.project(xyz)
    base = int(rng.integers(2**63))
    views = []
    for view, name in enumerate(rig.names):
        own = np.random.default_rng([base, zlib.crc32(name.encode())])
        size, codes, owners = rig.size[view], visibility[:, view][..., columns], hidden_by[:, view][..., columns]
        persons = see_persons(xy[:, view], codes, owners, size, fps, config, rng=own)
        ghosts = see_ghosts(xyz, size, fps, config, rng=own)
        views.append(_shuffled(persons, ghosts, rng=own))
    return _stacked(views)


def _shuffled(persons: Seen, ghosts: Seen, *, rng) -> tuple[Seen, np.ndarray]:
    """Persons and ghosts in random order, those there are first, and (F, D) whose each is."""
    frames, count = persons.score.shape[:2]
    xy, score = (np.concatenate(pair, 1) for pair in zip(persons, ghosts, strict=True))
    person = np.concatenate([np.arange(count), np.full(ghosts.score.shape[1], -1)])
    there = np.isfinite(score).any(-1)
    order = np.argsort(rng.uniform(size=there.shape) + ~there, axis=1)
    rows = np.arange(frames)[:, None]
    return Seen(xy[rows, order], score[rows, order]), np.where(there[rows, order], person[order], -1)


def _stacked(views: list[tuple[Seen, np.ndarray]]) -> tuple[Detections2D, np.ndarray]:
    """All views side by side, with as many places as the fullest view and frame needs."""
    most = max((int(np.isfinite(seen.score).any(-1).sum(1).max(initial=0)) for seen, _ in views), default=0)
    frames = len(views[0][1])
    xy = np.full((frames, len(views), most, len(BODY25), 2), np.nan, np.float32)
    score = np.full(xy.shape[:-1], np.nan, np.float32)
    person = np.full(xy.shape[:3], -1, np.int16)
    for view, (seen, who) in enumerate(views):
        places = min(most, who.shape[1])
        xy[:, view, :places], score[:, view, :places] = seen.xy[:, :places], seen.score[:, :places]
        person[:, view, :places] = who[:, :places]
    return Detections2D(BODY25, xy, score), person
