"""Recordings of four rigs without faults, and functions that plant the usual faults in them."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from omegaconf import OmegaConf

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.skeleton import BODY25
from dmae.formats.config import Convention
from tests.support.circling_people import circling_people
from tests.support.clips import looking_inwards

CONFIGS = Path(__file__).parents[2] / "configs"


def preset(name: str) -> CameraRig:
    cameras = OmegaConf.to_container(OmegaConf.load(CONFIGS / f"rig/{name}.yaml"))["cameras"]
    poses = np.tile(np.eye(4), (len(cameras), 1, 1))
    poses[:, :3] = [np.reshape(camera["cam_from_world"], (3, 4)) for camera in cameras]
    K = [np.reshape(camera["K"], (3, 3)) for camera in cameras]
    size = [camera["size"] for camera in cameras]
    return CameraRig([camera["name"] for camera in cameras], K, np.zeros((len(cameras), 5)), poses, size)


def ring() -> CameraRig:
    angle = np.array([0.2, 1.5, 3.4, 4.9])
    return looking_inwards(np.stack([5 * np.cos(angle), 5 * np.sin(angle), [2.0, 1.4, 2.6, 1.8]], -1))


def lenses() -> CameraRig:
    """A rig with pixels that are not square, principal points off the middle, and barrel distortion."""
    angle = np.array([0.0, 1.9, 3.6, 5.0])
    rig = looking_inwards(np.stack([4.5 * np.cos(angle), 4.5 * np.sin(angle), [2.2, 1.6, 2.5, 1.2]], -1))
    K = np.array([[720, 0, 505], [0, 800, 310], [0, 0, 1.0]])
    return replace(rig, K=np.tile(K, (4, 1, 1)), dist=np.tile([-0.25, 0.08, 1e-3, -1e-3, 0], (4, 1)))


RIGS = {"shelf": lambda: preset("shelf"), "campus": lambda: preset("campus"), "ring": ring, "lenses": lenses}


@cache
def sound(name: str, frames: int = 50) -> Clip:
    """A recording of three people, by default for two seconds."""
    rig, rng = RIGS[name](), np.random.default_rng(0)
    return Clip(name, 25.0, rig, detected(rig, circling_people(frames, 3, rng=rng), rng=rng))


def detected(rig: CameraRig, truth: Poses3D, *, rng: np.random.Generator) -> Detections2D:
    """People with the errors, misses and inversions of OpenPose on the Shelf recording, and a ghost in every view."""
    exact, depth = rig.project(truth.xyz)
    ahead = np.isfinite(exact).all((-2, -1), keepdims=True)
    exact = np.where(ahead, exact, np.nan)
    shape = exact.shape[:-1]
    low, high = np.where(ahead, exact, 0).min(3, keepdims=True), np.where(ahead, exact, 0).max(3, keepdims=True)
    error = rng.normal(0, 1, exact.shape)
    for frame in range(1, len(error)):
        error[frame] = 0.75 * error[frame - 1] + np.sqrt(1 - 0.75**2) * error[frame]
    error = 0.009 * error / np.sqrt(rng.chisquare(2.5, (*shape, 1)) / 2.5) + rng.normal(0, 0.006, exact.shape[1:])
    xy = exact + error * (high - low)[..., 1:]

    def bursts(share: float, *of: int) -> np.ndarray:
        """(F, *of) True for this share of the time, six frames at once."""
        return np.repeat(rng.random((len(xy) // 6 + 1, *of)) < share, 6, 0)[: len(xy)]

    missed = ~rig.inside(exact) | bursts(0.06, *shape[1:3])[..., None]
    for person in range(shape[2]):
        box_low, box_high = low[:, :, person, None], high[:, :, person, None]
        covered = ((exact > box_low) & (exact < box_high)).all(-1)
        covered &= np.nanmedian(depth[:, :, person], -1)[..., None, None] < depth - 0.2
        missed |= covered & bursts(0.6, *shape[1:])
    legs, arms = (
        BODY25.index(*(f"{s}_{j}" for s in "lr" for j in js)) for js in (("knee", "ankle"), ("elbow", "wrist"))
    )
    missed[..., arms] |= bursts(0.2, *shape[1:3])[..., None]
    inverted = bursts(0.01, *shape[1:3])
    xy[..., legs, :] = np.where(inverted[..., None, None], xy[..., np.array(BODY25.mirror)[legs], :], xy[..., legs, :])
    ghost = exact[40, :, :1] * rng.uniform(0.4, 0.9) + rng.normal(0, 3, (len(xy), shape[1], 1, *exact.shape[3:]))
    absent = ~bursts(0.25, shape[1], 1)[..., None] | (rng.random(shape[1:2] + (1, shape[3])) < 0.5)
    xy = np.where(np.concatenate([missed, absent], 2)[..., None], np.nan, np.concatenate([xy, ghost], 2))
    order = np.argsort(rng.random(xy.shape[:3]), 2)
    xy = np.take_along_axis(xy, order[..., None, None], 2)
    return Detections2D(BODY25, xy, np.where(np.isnan(xy[..., 0]), np.nan, 0.8))


def seen(clip: Clip, xy: np.ndarray, score: np.ndarray | None = None) -> Clip:
    score = clip.detections.score if score is None else score
    return replace(clip, detections=Detections2D(clip.detections.skeleton, xy, score))


def inverse(clip, *views):
    pose = clip.rig.cam_from_world.copy()
    pose[list(views)] = np.linalg.inv(pose[list(views)])
    return replace(clip, rig=replace(clip.rig, cam_from_world=pose))


def written(clip, **convention):
    """As if the files were written in a convention that is not stated."""
    return replace(clip, rig=Convention(**convention).written_rig(clip.rig))


def centres(clip, *views):
    pose = clip.rig.cam_from_world.copy()
    pose[list(views), :3, 3] = clip.rig.centers[list(views)]
    return replace(clip, rig=replace(clip.rig, cam_from_world=pose))


def exchanged(clip, x, y, *views):
    """Exchange two entries of K, as ((0, 0), (1, 1)) for the focal lengths."""
    K = clip.rig.K.copy()
    for view in views:
        K[view][x], K[view][y] = clip.rig.K[view][y], clip.rig.K[view][x]
    return replace(clip, rig=replace(clip.rig, K=K))


def focal(clip, *views):
    return exchanged(clip, (0, 0), (1, 1), *views)


def principal(clip, *views):
    return exchanged(clip, (0, 2), (1, 2), *views)


def late(clip, frames, view):
    """Delay a camera by a number of frames, which may be negative."""
    count = len(clip) - abs(frames)
    cut = clip.select(frames=slice(max(-frames, 0), max(-frames, 0) + count))
    own = slice(max(frames, 0), max(frames, 0) + count)
    xy, score = cut.detections.xy.copy(), cut.detections.score.copy()
    xy[:, view], score[:, view] = clip.detections.xy[own, view], clip.detections.score[own, view]
    return seen(cut, xy, score)


def swapped(clip, a, b):
    order = list(range(len(clip.rig)))
    order[a], order[b] = b, a
    return seen(clip, clip.detections.xy[:, order], clip.detections.score[:, order])


def scaled(clip, scale, *views):
    xy = clip.detections.xy.copy()
    xy[:, list(views)] *= scale
    return seen(clip, xy)


def mirrored(clip, *views):
    """Detect people in mirrored images, with left and right exchanged."""
    xy, score = clip.detections.xy.copy(), clip.detections.score.copy()
    mirror = list(clip.detections.skeleton.mirror)
    for view in views:
        xy[:, view, ..., 0] = clip.rig.size[view, 0] - 1 - xy[:, view, ..., 0]
        xy[:, view], score[:, view] = xy[:, view][..., mirror, :], score[:, view][..., mirror]
    return seen(clip, xy, score)


def turned(clip, view):
    """Turn the images of a camera to the right."""
    xy = clip.detections.xy.copy()
    x, y = clip.detections.xy[:, view, ..., 0], clip.detections.xy[:, view, ..., 1]
    xy[:, view] = np.stack([clip.rig.size[view, 1] - 1 - y, x], -1)
    return seen(clip, xy)


def lens(clip, factor):
    return replace(clip, rig=replace(clip.rig, dist=factor * clip.rig.dist))


def size(clip):
    return replace(clip, rig=replace(clip.rig, size=clip.rig.size[:, ::-1]))
