"""Clips for tests of the report: captured and completed people, with images that say which frame they are."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.images import Images, write_video
from tests.support.clips import full_clip

ERROR_M = 0.1
"""How far the completed joints lie from the truth."""


def completed_clip(frames: int = 30) -> Clip:
    """Two people, captured exactly apart from the second one's right elbow and wrist: completed in frames 10 to 19."""
    clip = full_clip(frames)
    xyz, source = clip.truth.xyz.copy(), np.full(clip.truth.source.shape, Source.MEASURED)
    arm = clip.truth.skeleton.index("r_elbow", "r_wrist")
    xyz[10:20, 1, arm] += (0, 0, ERROR_M)
    source[10:20, 1, arm] = Source.COMPLETED
    cov = np.broadcast_to(0.02**2 * np.eye(3), (*source.shape, 3, 3))
    return replace(
        clip, poses=Poses3D(clip.truth.skeleton, xyz, source, cov, np.where(source == Source.COMPLETED, 0, 4))
    )


def grey_of(frame: int) -> int:
    """Grey level of the image of a frame."""
    return 24 + 7 * frame


def with_images(clip: Clip, folder: Path) -> Clip:
    """Add videos of plain grey, a level for each frame."""
    for name, (width, height) in zip(clip.rig.names, clip.rig.size, strict=True):
        images = (np.full((height, width, 3), grey_of(frame), np.uint8) for frame in range(len(clip)))
        write_video(folder / "rgb" / f"{name}.mp4", images, clip.fps)
    return replace(clip, images=Images(folder, clip.rig.names, tuple(range(len(clip))), ("rgb",)))
