"""Clips to draw, and colours to look for in the images."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip, Detections2D, Poses3D, Source
from dmae.data.images import Images, write_video
from dmae.data.labels import OcclusionLabels, Visibility
from dmae.data.skeleton import BODY25, get_skeleton
from tests.support.standing_people import looking_along_x

VISIBLE, SELF, PERSON, OBJECT, OUTSIDE, BEHIND, ABSENT = Visibility


def occluded_clip(frames: int = 3, views: int = 2) -> Clip:
    """Return a clip of two people side by side. In the last frame the second is absent.

    Every joint of the second (at the right, y = -1) is hidden, each third by another kind of occluder.
    """
    rig = looking_along_x(*[(-4, 0.2 * view, 1.0) for view in range(views)])
    rng = np.random.default_rng(0)
    skeleton = get_skeleton("body25+shelf14")
    xyz = np.stack([rng.uniform(-0.4, 0.4, (39, 3)) + (0, y, 1) for y in (1, -1)])
    xyz = np.repeat(xyz[None], frames, 0)
    xyz[-1, 1] = np.nan
    visibility = np.full((frames, views, 2, 39), VISIBLE, np.uint8)
    visibility[:, :, 1] = np.array([SELF, PERSON, OBJECT])[np.arange(39) % 3]
    by = np.full(visibility.shape, -1)
    by[:, :, 1] = np.array([1, 0, 1])[np.arange(39) % 3]
    visibility[-1, :, 1], by[-1, :, 1] = ABSENT, -1
    nothing = np.zeros((frames, views, 0, 25))
    return Clip(
        "shown", 25.0, rig, Detections2D(BODY25, np.stack([nothing] * 2, -1), nothing),
        truth=Poses3D(skeleton, xyz), occlusion=OcclusionLabels(visibility, by, objects=("floor", "shelf")),
    )  # fmt: skip


def captured_clip(frames: int = 3, views: int = 2) -> Clip:
    """Return the same two people as a real clip, both there throughout: detections, poses and truth of BODY_25.

    Every sixth joint is completed; detections and truth are a few px and cm beside the poses.
    """
    clip = occluded_clip(frames, views)
    xyz = np.repeat(clip.truth.xyz[:1, :, :25], frames, 0)
    source = np.full(xyz.shape[:-1], Source.MEASURED)
    source[..., ::6] = Source.COMPLETED
    xy, _ = clip.rig.project(xyz + (0, 0, 0.1))
    return replace(
        clip,
        occlusion=None,
        detections=Detections2D(BODY25, xy, np.ones(xy.shape[:-1])),
        truth=Poses3D(BODY25, xyz + np.float32([0, 0, -0.1])),
        poses=Poses3D(BODY25, xyz, source),
    )


def with_images(clip: Clip, folder: Path) -> Clip:
    """Return the clip with images that are plain green."""
    for name in clip.rig.names:
        write_video(
            folder / "rgb" / f"{name}.mp4", np.full((len(clip), 480, 640, 3), (20, 120, 20), np.uint8), clip.fps
        )
    return replace(clip, images=Images(folder, clip.rig.names, tuple(range(len(clip))), ("rgb",)))


def near(image: np.ndarray, colour) -> np.ndarray:
    """(H, W) True for the pixels of a colour."""
    return (np.abs(image.astype(int) - colour) < 30).all(-1)
