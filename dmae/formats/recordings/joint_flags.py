"""How visible the joints of exported poses are in each view."""

from dataclasses import replace

import numpy as np

from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.labels import Visibility
from dmae.data.skeleton import Skeleton
from dmae.data.skeleton_conversion import convert


def joint_flags(clip: Clip, poses: Poses3D, skeleton: Skeleton) -> tuple[np.ndarray, np.ndarray]:
    """Return where the cameras of a clip see poses, and COCO's flag of visibility.

    A joint in the image is 2, visible, if the labels of a simulated clip say so of the truth, or if a joint of other
    poses was measured; it is 1 if it is hidden or completed. A joint derived from others is as visible as the least
    visible of them. Joints out of the image are 0.

    Args:
        clip: Its `rig` is projected to.
        poses: The truth of the clip, or other poses of its frames.
        skeleton: J joints to return.

    Returns:
        xy: (F, V, P, J, 2) px.
        flags: (F, V, P, J) int.
    """
    rig = clip.rig
    if poses is clip.truth and clip.occlusion is not None:
        visible = np.where(clip.occlusion.visibility == Visibility.VISIBLE, 2, 1)
    else:
        visible = np.where(poses.source == Source.COMPLETED, 1, 2)[:, None]
        visible = np.broadcast_to(visible, (len(visible), len(rig), *visible.shape[2:]))
    # `views` of derived joints is the least of those that they are made of, as flags have to be.
    flags = np.stack([convert(replace(poses, views=visible[:, v]), skeleton).views for v in range(len(rig))], 1)
    xy, _ = rig.project(convert(poses, skeleton).xyz)
    return xy, np.where(rig.inside(xy), flags, 0)
