"""Bodies that are no people: a hand of 21 points and a four-legged animal, in motion, seen by cameras with noise."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.skeleton import Skeleton, get_skeleton

FPS = 30.0
SKELETONS = Path(__file__).parents[2] / "examples" / "skeletons"
HAND, DOG = (get_skeleton(str(SKELETONS / f"{name}.yaml")) for name in ("hand", "dog"))
_FINGERS = {"thumb": -0.6, "index": -0.2, "middle": 0.0, "ring": 0.2, "little": 0.4}
_LENGTHS = {"thumb": 0.045, "index": 0.09, "middle": 0.088, "ring": 0.085, "little": 0.08}


def hand(frames: int, *, rng: np.random.Generator) -> np.ndarray:
    """(F, 21, 3) m: fingers bend at random while the hand turns in all directions."""
    phase, speed = rng.uniform(0, 2 * np.pi, 5), rng.uniform(0.4, 1.1, 5)
    seconds = np.arange(frames) / FPS
    points = {"wrist": np.zeros((frames, 3))}
    for number, (finger, angle) in enumerate(_FINGERS.items()):
        along = np.array([np.cos(angle), np.sin(angle), 0.0])
        bend = 0.5 - 0.5 * np.cos(2 * np.pi * speed[number] * seconds + phase[number])
        joint, names = _LENGTHS[finger] * along + np.zeros((frames, 1)), _names(finger)
        points[names[0]] = joint
        for part, (name, length) in enumerate(zip(names[1:], (0.042, 0.026, 0.022), strict=True), 1):
            tilt = bend * (0.5 + 0.35 * part)
            joint = joint + length * (np.cos(tilt)[:, None] * along - np.sin(tilt)[:, None] * (0, 0, 1))
            points[name] = joint
    xyz = np.stack([points[name] for name in HAND.joints], 1)
    turn = Rotation.from_euler("zyx", _smooth(frames, 3, 1.0, rng=rng) * (1.5, 0.8, 0.8))
    xyz = np.einsum("fij,fnj->fni", turn.as_matrix(), xyz)
    return xyz + 0.08 * _smooth(frames, 3, 1.5, rng=rng)[:, None] + (0, 0, 0.3)


def _names(finger: str) -> list[str]:
    return [name for name in HAND.joints if name.startswith(finger)]


def dog(frames: int, *, rng: np.random.Generator, radius: float = 0.8) -> np.ndarray:
    """(F, 19, 3) m: trots in a circle, with legs in diagonal pairs, a head that looks about and a tail that wags."""
    seconds, start = np.arange(frames) / FPS, rng.uniform(0, 2 * np.pi)
    stride, swing = 2 * np.pi * 1.6 * seconds, rng.uniform(0.8, 1.2)
    local = {
        "withers": (0.0, 0, 0.55), "tail_base": (-0.5, 0, 0.53), "tail_tip": (-0.75, 0, 0.6),
        "neck": (0.14, 0, 0.68), "nose": (0.38, 0, 0.66), "l_ear": (0.2, 0.06, 0.78), "r_ear": (0.2, -0.06, 0.78),
    }  # fmt: skip
    points = {name: np.tile(place, (frames, 1)) for name, place in local.items()}
    points["tail_tip"] = points["tail_tip"] + 0.1 * np.sin(2 * np.pi * 2.2 * seconds)[:, None] * (0, 1, 0)
    look = 0.06 * _smooth(frames, 3, 0.8, rng=rng)
    for name in ("nose", "l_ear", "r_ear"):
        points[name] = points[name] + look
    for end, x in (("fore", 0.0), ("hind", -0.47)):
        for side, y in (("l", 0.09), ("r", -0.09)):
            phase = stride + np.pi * ((end == "fore") == (side == "l"))
            top = np.tile((x, y, 0.48), (frames, 1))
            angle = 0.45 * swing * np.sin(phase)
            bent = angle + (-1 if end == "fore" else 1) * 0.5 * np.maximum(np.cos(phase), 0)
            middle = top + 0.22 * _down(angle)
            points[f"{side}_{end}_top"] = top
            points[f"{side}_{end}_middle"] = middle
            points[f"{side}_{end}_paw"] = middle + 0.24 * _down(bent)
    xyz = np.stack([points[name] for name in DOG.joints], 1)
    xyz[..., 2] += 0.015 * np.sin(2 * stride)[:, None]
    around = start + 1.3 * seconds / radius
    turn = Rotation.from_rotvec((around + np.pi / 2)[:, None] * (0, 0, 1)).as_matrix()
    xyz = np.einsum("fij,fnj->fni", turn, xyz)
    return xyz + np.stack([radius * np.cos(around), radius * np.sin(around), 0 * around], -1)[:, None]


def _down(angle: np.ndarray) -> np.ndarray:
    return np.stack([np.sin(angle), 0 * angle, -np.cos(angle)], -1)


def _smooth(frames: int, channels: int, seconds: float, *, rng: np.random.Generator) -> np.ndarray:
    """(F, channels) sums of slow waves, up to about 1."""
    time = np.arange(frames)[:, None] / FPS
    rates, phases = rng.uniform(0.1, 1, (2, 3, 1, channels))
    return np.sin(2 * np.pi * (rates * time / seconds + phases)).mean(0)


def around(distance: float, height: float, views: int = 4, focal: float = 900.0) -> CameraRig:
    """Cameras of 1280 x 720 px in a ring, which look at a point at that height above the origin."""
    poses = []
    for number in range(views):
        angle = 2 * np.pi * number / views + 0.3
        center = np.array([distance * np.cos(angle), distance * np.sin(angle), height + 0.5 * distance])
        ahead = np.array([0, 0, height]) - center
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, (0, 0, 1))
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(ahead, right), ahead])
        poses.append(np.block([[rotation, -(rotation @ center)[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]]))
    K = np.tile([[focal, 0, 639.5], [0, focal, 359.5], [0, 0, 1]], (views, 1, 1))
    names = tuple(f"cam{number}" for number in range(views))
    return CameraRig(names, K, np.zeros((views, 5)), np.stack(poses), np.tile([1280, 720], (views, 1)))


def detected(xyz: np.ndarray, skeleton: Skeleton, rig: CameraRig, *, rng: np.random.Generator) -> Clip:
    """Detections of bodies (F, P, J, 3): noise of 2 px, joints missed in bursts of half a second, some far off."""
    xy = rig.project(xyz)[0] + rng.normal(0, 2, (len(xyz), len(rig), *xyz.shape[1:3], 2))
    frames, bursts = len(xyz), -(-len(xyz) // 15)
    missed = np.repeat(rng.random((bursts, *xy.shape[1:-1])) < 0.25, 15, 0)[:frames]
    # Both legs or fingers of a moment are often hidden from all cameras.
    missed |= np.repeat(rng.random((bursts, 1, *xy.shape[2:-1])) < 0.1, 15, 0)[:frames]
    far = rng.random(xy.shape[:-1]) < 0.01
    xy[far] += rng.normal(0, 80, (far.sum(), 2))
    xy[missed | ~rig.inside(xy)] = np.nan
    score = np.where(np.isnan(xy[..., 0]), np.nan, rng.uniform(0.6, 0.95, xy.shape[:-1]))
    order = rng.permuted(np.tile(np.arange(xy.shape[2]), (*xy.shape[:2], 1)), axis=-1)[..., None]
    xy, score = np.take_along_axis(xy, order[..., None], 2), np.take_along_axis(score, order, 2)
    detections = Detections2D(skeleton, xy, score)
    return Clip(skeleton.name, FPS, rig, detections, truth=Poses3D(skeleton, xyz))


def hand_clip(frames: int = 300, seed: int = 0) -> Clip:
    """A hand before four cameras at 60 cm."""
    rng = np.random.default_rng(seed)
    return detected(hand(frames, rng=rng)[:, None], HAND, around(0.6, 0.3), rng=rng)


def hands_clip(frames: int = 300, seed: int = 0) -> Clip:
    """Two hands 12 cm apart, which overlap in most images."""
    rng = np.random.default_rng(seed)
    hands = [hand(frames, rng=rng) + (place, 0, 0) for place in (-0.06, 0.06)]
    return detected(np.stack(hands, 1), HAND, around(0.6, 0.3), rng=rng)


def dog_clip(frames: int = 300, seed: int = 0, dogs: int = 1) -> Clip:
    """Dogs before four cameras, 2.5 m away."""
    rng = np.random.default_rng(seed)
    bodies = [dog(frames, rng=rng, radius=0.6 + 0.9 * number) for number in range(dogs)]
    return detected(np.stack(bodies, 1), DOG, around(2.5 + dogs, 0.4), rng=rng)
