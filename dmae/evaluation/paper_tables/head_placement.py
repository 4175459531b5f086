"""Where published evaluations place the ends of the annotated head of Shelf, which no detector finds.

Each formula has constants that were tuned on that recording. `dmae.data.conversion.convert` uses the formula
of Zhang et al. 2020, here `4da`.
"""

from dataclasses import replace

import numpy as np

from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import SHELF14, Skeleton

_LANDMARKS = ("nose", "l_ear", "r_ear", "l_shoulder", "r_shoulder")
_TOP_OF_NOSE = np.array([0.75, 0.75, 1.5])
"""The top of the head from the middle of the shoulders, as multiples of the nose's offset from there."""
_SHARE = {"mvpose": 1.0, "voxelpose": 0.75}
"""Weight of the nose's formula against that of the ears."""


def convert_with_head(poses: Poses3D, target: Skeleton, head: str) -> Poses3D:
    """Return poses on another skeleton, the ends of the head placed by a published formula.

    Args:
        poses: On any skeleton that `convert` can bring to the target.
        target: Only the head of Shelf's skeleton depends on the formula.
        head: `4da`, `mvpose` (Dong et al. 2019) or `voxelpose` (Tu et al. 2020). Poses that have that head already, or
            not the joints that the formula needs, are converted as by `4da`.
    """
    converted = convert(poses, target)
    own = target in poses.skeleton.parts or not set(_LANDMARKS) <= set(poses.skeleton.joints)
    if head not in _SHARE or target != SHELF14 or own:
        return converted
    landmarks = poses.skeleton.index(*_LANDMARKS)
    joints = poses.xyz[:, :, landmarks].astype(np.float64)
    nose, ears, shoulders = joints[:, :, 0], joints[:, :, 1:3].mean(2), joints[:, :, 3:].mean(2)
    ends = np.stack([(shoulders + nose) / 2, shoulders + (nose - shoulders) * _TOP_OF_NOSE], 2)
    if _SHARE[head] < 1:
        bottom = (shoulders + ears) / 2
        ends = _SHARE[head] * ends + (1 - _SHARE[head]) * np.stack([bottom, 2 * ears - bottom], 2)
    xyz, source = converted.xyz.copy(), converted.source.copy()
    placed = target.index("bottom_head", "top_head")
    xyz[:, :, placed] = ends
    weakest = poses.source[:, :, landmarks].max(-1, keepdims=True)
    source[:, :, placed] = np.where(np.isnan(ends).any(-1), Source.ABSENT, weakest)
    return replace(converted, xyz=xyz, source=source)
