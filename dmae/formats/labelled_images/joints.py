"""Labels of the joints in each view of a clip: position, visibility and occluder."""

from dataclasses import dataclass, replace

import numpy as np

from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.labels import Visibility
from dmae.data.skeleton import Skeleton
from dmae.formats.recordings.pixel_covariances import pixel_covariances


@dataclass(frozen=True)
class JointLabels:
    """Labels of J joints of P persons in V views and F frames.

    Attributes:
        skeleton: J joints.
        xyz: (F, P, J, 3) m, world.
        xy: (F, V, P, J, 2) px.
        flags: (F, V, P, J) COCO's v: 2 visible, 1 in the image but hidden or not measured, 0 not in the image.
        sources: (F, P, J) `Source` of the poses.
        cause: (F, V, P, J) `Visibility`; None if unknown for all joints.
        occluder: (F, V, P, J) index of the occluder, as in `OcclusionLabels.occluder`; None if `cause` is None.
        cov: (F, V, P, J, 3) px^2, xx, xy and yy of the covariance of `xy`; None if unknown for all joints.
        true: Whether the poses are the truth of the clip. Only then do its images of ids show the same persons.
    """

    skeleton: Skeleton
    xyz: np.ndarray
    xy: np.ndarray
    flags: np.ndarray
    sources: np.ndarray
    cause: np.ndarray | None = None
    occluder: np.ndarray | None = None
    cov: np.ndarray | None = None
    true: bool = False


def joint_labels(clip: Clip, poses: Poses3D, skeleton: Skeleton) -> JointLabels:
    """Return the labels of the joints of poses in each view of a clip.

    For the truth of a simulated clip, its occlusion labels state which joints in the image are visible. For other
    poses, completed joints count as hidden and the others as visible. A joint that is derived from several joints has
    the visibility and the occluder of the least visible of them.

    Args:
        clip: The clip. Its `true_rig`, if it has one, projects the truth; its `rig` projects other poses.
        poses: The truth of the clip, or other poses of its frames.
        skeleton: Skeleton of the labels, with J joints.
    """
    true = poses is clip.truth
    rig = clip.true_rig if true and clip.true_rig is not None else clip.rig
    converted = convert(poses, skeleton)
    xy, _ = rig.project(converted.xyz)
    inside = rig.inside(xy)
    if not true or clip.occlusion is None:
        visible = np.where(converted.source == Source.COMPLETED, 1, 2)[:, None]
        flags, cov = np.where(inside, visible, 0), pixel_covariances(converted, rig)
        return JointLabels(skeleton, converted.xyz, xy, flags, converted.source, cov=cov, true=true)
    occluders = clip.occlusion.occluder
    views = [
        _converted_causes(
            poses, skeleton, clip.occlusion.visibility[:, view], None if occluders is None else occluders[:, view]
        )
        for view in range(len(rig))
    ]
    cause, occluder = (np.stack(each, 1) for each in zip(*views, strict=True))
    flags = np.where(inside, np.where(cause == Visibility.VISIBLE, 2, 1), 0)
    return JointLabels(skeleton, converted.xyz, xy, flags, converted.source, cause, occluder, true=true)


def _converted_causes(
    poses: Poses3D, skeleton: Skeleton, visibility: np.ndarray, occluder: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return cause and occluder of one view, (F, P, J) each, for the joints of another skeleton.

    This uses `convert`: for a derived joint it returns the smallest `views` of the joints that it is derived from. Here
    `views` are replaced by the ranks of the joints by visibility, with 1 for the least visible.
    """
    order = np.argsort(-visibility.astype(int), -1, kind="stable")
    ranks = np.empty(order.shape, np.uint8)
    np.put_along_axis(ranks, order, np.arange(1, order.shape[-1] + 1, dtype=np.uint8), -1)
    least = convert(replace(poses, views=ranks), skeleton).views.astype(int)
    joint = np.take_along_axis(order, np.maximum(least - 1, 0), -1)
    cause = np.where(least > 0, np.take_along_axis(visibility, joint, -1), Visibility.ABSENT).astype(np.uint8)
    if occluder is None:
        return cause, np.full(cause.shape, -1, np.int16)
    return cause, np.where(least > 0, np.take_along_axis(occluder, joint, -1), -1).astype(np.int16)
