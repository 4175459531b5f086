"""Small synthetic recordings for the tests."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.images import FIRST_OBJECT_ID, Images, write_image, write_video
from dmae.data.labels import DetectionLabels, JointError, OcclusionLabels, Visibility
from dmae.data.skeleton import BODY25, Skeleton

_STANDING = {
    "mid_hip": (0, 0, 0.95), "neck": (0, 0, 1.45), "nose": (0.1, 0, 1.62),
    "hip": (0, 0.1, 0.95), "knee": (0.02, 0.1, 0.5), "ankle": (0, 0.1, 0.08),
    "shoulder": (0, 0.18, 1.45), "elbow": (0, 0.46, 1.45), "wrist": (0, 0.71, 1.45),
    "eye": (0.08, 0.03, 1.66), "ear": (0, 0.075, 1.64),
    "big_toe": (0.2, 0.09, 0.02), "small_toe": (0.17, 0.14, 0.02), "heel": (-0.05, 0.1, 0.02),
    "bottom_head": (0, 0, 1.545), "top_head": (0.125, 0, 1.69),
    "head_top": (0, 0, 1.8), "eye_inner": (0.08, 0.015, 1.66), "eye_outer": (0.07, 0.045, 1.66),
    "mouth": (0.09, 0.02, 1.58), "little_finger": (0, 0.79, 1.43), "index_finger": (0.02, 0.8, 1.45),
    "thumb": (0.04, 0.76, 1.45),
}  # fmt: skip


def t_pose(skeleton: Skeleton = BODY25) -> np.ndarray:
    """(J, 3) m: a T-pose at the origin, facing +x, left is +y."""
    sides = {"l_": (1, 1, 1), "r_": (1, -1, 1)}
    return np.array([
        np.multiply(_STANDING[joint[2:]], sides[joint[:2]]) if joint[:2] in sides else _STANDING[joint]
        for joint in skeleton.joints
    ], float)  # fmt: skip


def looking_at_origin(views: int = 4) -> CameraRig:
    """Pinhole cameras on a circle of 6 m, 2 m up."""
    angle = np.linspace(0, 2 * np.pi, views, endpoint=False)
    return looking_inwards(np.stack([6 * np.cos(angle), 6 * np.sin(angle), np.full(views, 2.0)], -1))


def looking_inwards(centres: np.ndarray) -> CameraRig:
    """Pinhole cameras at centres (V, 3) m, none overhead, that look at a point 1 m above the origin."""
    cam_from_world = np.tile(np.eye(4), (len(centres), 1, 1))
    for view, centre in enumerate(centres):
        forward = (0, 0, 1) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, (0, 0, 1.0))
        right /= np.linalg.norm(right)
        R = np.stack([right, np.cross(forward, right), forward])
        cam_from_world[view, :3, :3], cam_from_world[view, :3, 3] = R, -R @ centre
    K = np.array([[800, 0, 480], [0, 800, 300], [0, 0, 1.0]])
    names = tuple(f"cam{view}" for view in range(len(centres)))
    K, size = np.tile(K, (len(centres), 1, 1)), np.tile((960, 600), (len(centres), 1))
    return CameraRig(names, K, np.zeros((len(centres), 5)), cam_from_world, size)


def walkers(frames: int = 12, persons: int = 2, skeleton: Skeleton = BODY25) -> Poses3D:
    """T-poses a metre and a half apart that glide along x at 1 m/s (25 fps)."""
    xyz = np.tile(t_pose(skeleton), (frames, persons, 1, 1))
    xyz[..., 1] += 1.5 * np.arange(persons)[:, None] - 0.75 * (persons - 1)
    xyz[..., 0] += np.arange(frames)[:, None, None] / 25
    return Poses3D(skeleton, xyz)


def full_clip(frames: int = 12, views: int = 4) -> Clip:
    """Return a clip with all fields except images and poses. Detections are exact projections, in shuffled order."""
    rng = np.random.default_rng(0)
    rig, truth = looking_at_origin(views), walkers(frames)
    xy, _ = rig.project(truth.xyz)
    persons = truth.xyz.shape[1]
    detected = np.argsort(rng.random((frames, views, persons)), axis=-1)
    xy = np.take_along_axis(xy, detected[..., None, None], 2)
    score = rng.uniform(0.3, 1, xy.shape[:-1])
    hidden = rng.random(score.shape) < 0.1
    xy[hidden], score[hidden] = np.nan, np.nan
    visibility = rng.integers(0, len(Visibility), (frames, views, *truth.xyz.shape[1:3]))
    return Clip(
        id="made-up",
        fps=25.0,
        rig=rig,
        detections=Detections2D(BODY25, xy, score),
        truth=truth,
        occlusion=OcclusionLabels(
            visibility,
            occluder=np.where(visibility == Visibility.HIDDEN_BY_OBJECT, 0, -1),
            depth_margin=np.where(visibility == Visibility.HIDDEN_BY_OBJECT, 0.5, np.nan),
            visible_pixels=np.full(visibility.shape[:3], 300),
            amodal_pixels=np.full(visibility.shape[:3], 400),
            objects=("box",),
        ),
        detection_labels=DetectionLabels(
            person=detected,
            joint_person=np.where(hidden, -1, detected[..., None]),
            error=np.where(hidden, JointError.ABSENT, JointError.GOOD),
            offset_px=np.where(hidden, np.nan, 0),
        ),
        true_rig=replace(rig, K=1.01 * rig.K + [[0, 0, 0], [0, 0, 0], [0, 0, -0.01]]),
        provenance={"seed": 0},
    )


def image_clip(folder: Path, frames: int = 3, views: int = 2, depth: bool = False) -> Clip:
    """A clip with images of colour and ids, 240 x 150 px: discs on the joints of two walkers, and before them a box.

    In the last frame of the first view the box is before all of person 1. With `depth`, the box is 2 m away, people
    4.321 m, and there is no surface elsewhere.
    """
    clip = full_clip(frames, views)
    quarter = np.diag([0.25, 0.25, 1])
    rig = replace(clip.rig, K=quarter @ clip.rig.K, size=clip.rig.size // 4)
    xy, _ = rig.project(clip.truth.xyz)
    shown = np.zeros((frames, views, 2), int)
    alone = np.zeros_like(shown)
    for view, name in enumerate(rig.names):
        colours = []
        for frame in range(frames):
            ids = np.zeros((150, 240), np.uint16)
            for person in (1, 0):
                body = np.zeros_like(ids)
                for x, y in xy[frame, view, person].round().astype(int):
                    body[max(y - 3, 0) : max(y + 4, 0), max(x - 3, 0) : max(x + 4, 0)] = 1
                alone[frame, view, person] = body.sum()
                ids[body > 0] = 1 + person
            ids[60:70, 100:140] = FIRST_OBJECT_ID
            if (frame, view) == (frames - 1, 0):
                ids[ids == 2] = FIRST_OBJECT_ID
            shown[frame, view] = [np.count_nonzero(ids == 1 + person) for person in (0, 1)]
            write_image("ids", folder / "ids" / name / f"{frame:06d}.png", ids)
            if depth:
                metres = np.select([ids >= FIRST_OBJECT_ID, ids > 0], [2, 4.321], np.nan)
                write_image("depth", folder / "depth" / name / f"{frame:06d}.png", metres)
            colours.append(np.array([(30, 60, 90), (200, 80, 40), (40, 200, 80), (200, 200, 60)], np.uint8)[
                np.select([ids == 1, ids == 2, ids >= FIRST_OBJECT_ID], [1, 2, 3], 0)
            ])  # fmt: skip
        write_video(folder / "rgb" / f"{name}.mp4", colours, clip.fps)
    pixels = {"visible_pixels": shown, "amodal_pixels": alone}
    return replace(
        clip,
        rig=rig,
        true_rig=None,
        detections=replace(clip.detections, xy=clip.detections.xy / 4),
        occlusion=replace(clip.occlusion, **pixels),
        images=Images(folder, rig.names, tuple(range(frames)), ("rgb", "ids", *["depth"] * depth)),
        provenance={"first_frame": 5},
    )
