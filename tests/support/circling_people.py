"""Walking people made of sine waves: true poses for the tests of training, generated in milliseconds."""

import numpy as np

from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.skeleton import BODY25
from tests.support.clips import looking_at_origin

# (joint, m forward, m left, m up, m swing forward at the given phase of the left leg's)
_BODY = {
    "mid_hip": (0, 0, 0.95, 0, 0), "neck": (0, 0, 1.45, 0, 0), "nose": (0.1, 0, 1.6, 0.01, 0),
    **{f"{s}_{j}": (x, side * y, z, swing, phase + (0 if s == "l" else np.pi))
       for s, side in (("l", 1), ("r", -1))
       for j, x, y, z, swing, phase in (
           ("eye", 0.08, 0.03, 1.64, 0.01, 0), ("ear", 0, 0.07, 1.62, 0.01, 0),
           ("shoulder", 0, 0.18, 1.42, 0.02, np.pi), ("elbow", -0.02, 0.22, 1.15, 0.1, np.pi),
           ("wrist", 0.08, 0.22, 0.92, 0.22, np.pi - 0.3), ("hip", 0, 0.09, 0.93, 0.01, 0),
           ("knee", 0.03, 0.1, 0.5, 0.16, -0.1), ("ankle", 0, 0.1, 0.1, 0.3, -0.4),
           ("heel", -0.05, 0.1, 0.04, 0.3, -0.4), ("big_toe", 0.17, 0.09, 0.04, 0.3, -0.4),
           ("small_toe", 0.14, 0.14, 0.04, 0.3, -0.4))},
}  # fmt: skip


def circling_people(frames: int, persons: int, *, rng: np.random.Generator, fps: float = 25.0) -> Poses3D:
    """Return poses (F, P, 25). Each person walks round a different circle, with a different pace and body size."""
    joints = np.array([_BODY[joint] for joint in BODY25.joints])
    time = np.arange(frames)[:, None] / fps
    size, pace = rng.uniform(0.9, 1.1, persons), rng.uniform(0.8, 1.2, persons)
    step = (2 * np.pi * pace * time + rng.uniform(0, 2 * np.pi, persons))[..., None]
    body = np.broadcast_to(joints[:, :3], (frames, persons, len(joints), 3)).copy()
    body[..., 0] += joints[:, 3] * np.sin(step + joints[:, 4])
    body[..., 2] += 0.03 * np.cos(2 * step)
    radius, start = rng.uniform(1.5, 3, persons), rng.uniform(0, 2 * np.pi, persons)
    angle = start + 1.2 * pace * time / radius
    cos, sin = np.cos(angle + np.pi / 2)[..., None], np.sin(angle + np.pi / 2)[..., None]
    body = body * size[:, None, None]
    x = cos * body[..., 0] - sin * body[..., 1] + (radius * np.cos(angle))[..., None]
    y = sin * body[..., 0] + cos * body[..., 1] + (radius * np.sin(angle))[..., None]
    return Poses3D(BODY25, np.stack([x, y, body[..., 2]], -1))


def clip_of(poses: Poses3D, name: str, fps: float = 25.0) -> Clip:
    """Return a clip of one camera without detections, with these poses as truth."""
    nothing = np.full((len(poses.xyz), 1, 0, len(BODY25)), np.nan)
    detections = Detections2D(BODY25, np.stack([nothing, nothing], -1), nothing)
    return Clip(name, fps, looking_at_origin(1), detections, truth=poses)
