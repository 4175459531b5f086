"""Landmarks: the points on a body where annotators and detectors place each joint."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dmae.data.skeleton import Skeleton, get_skeleton
from synth.people.body import ANKLE_HEIGHT, HEAD_HEIGHT, SIDES, Body, segment_origins, side_and_name
from synth.people.segments import SEGMENTS

SKELETON = get_skeleton("body25+shelf14")


class _Landmark(NamedTuple):
    """A point that moves with a segment, on the left side.

    Attributes:
        segment: Segment that it moves with.
        joint: Segment; the offset is relative to its origin in the T-pose.
        x, y, z: Offset, fractions of stature; an offset from the head is also scaled by the size of the head.
        radius: Depth in the limb, with clothes, for three quarters of the directions from which it is seen, fractions
            of stature; it scales with girth. It is 0 for points on the skin of the head, which the head itself hides.
    """

    segment: str
    joint: str
    x: float
    y: float
    z: float
    radius: float = 0.0


# The eyes are 0.936 of stature above the floor and the chin 0.870 (Winter, fig. 4.1). OpenPose's hips are
# slightly above and outside the joint's centre; Shelf's annotators put hips 40 to 78 mm, and shoulders 21 to 38 mm,
# below those of OpenPose.
_LIMBS = {
    "elbow": _Landmark("forearm", "forearm", 0, 0, 0, 0.037),
    "wrist": _Landmark("hand", "hand", 0, 0, 0, 0.024),
    "knee": _Landmark("shin", "shin", 0, 0, 0, 0.057),
    "ankle": _Landmark("foot", "foot", 0, 0, 0, 0.040),
}
_BODY25 = _LIMBS | {
    "nose": _Landmark("head", "head", 0.075, 0, 0.068),
    "neck": _Landmark("chest", "upper_arm", 0.002, 0, 0.002, 0.125),
    "shoulder": _Landmark("chest", "upper_arm", 0.002, -0.002, 0.002, 0.068),
    "mid_hip": _Landmark("pelvis", "pelvis", 0, 0, 0.010, 0.101),
    "hip": _Landmark("pelvis", "thigh", 0, 0.006, 0.010, 0.090),
    "eye": _Landmark("head", "head", 0.060, 0.018, 0.091),
    "ear": _Landmark("head", "head", 0.006, 0.047, 0.082),
    "big_toe": _Landmark("foot", "foot", 0.108, -0.013, 0.009 - ANKLE_HEIGHT, 0.018),
    "small_toe": _Landmark("foot", "foot", 0.085, 0.026, 0.008 - ANKLE_HEIGHT, 0.021),
    "heel": _Landmark("foot", "foot", -0.037, 0, 0.009 - ANKLE_HEIGHT, 0.022),
}
_SHELF14 = _LIMBS | {
    "hip": _Landmark("thigh", "thigh", 0, 0.008, -0.024, 0.098),
    "shoulder": _Landmark("chest", "upper_arm", 0.002, -0.002, -0.015, 0.068),
    # Relative to the point half way between the shoulders and the ears.
    "bottom_head": _Landmark("head", "head", 0.0, 0, 0.0, 0.098),
    # 125 mm ahead of that and 145 mm above, on a body of 1.75 m.
    "top_head": _Landmark("head", "head", 0.0714, 0, 0.0829),
}
_HEADS = ("bottom_head", "top_head")
# As annotated in MPII, and therefore in BODY_25B and Halpe: the crown, and the point where the neck meets the head.
_CROWN = {"head_top": _Landmark("head", "head", 0.005, 0, HEAD_HEIGHT)}
# BlazePose's: corners of the eyes and of the mouth, and knuckles.
_FACE_AND_HANDS = {
    "eye_inner": _Landmark("head", "head", 0.062, 0.009, 0.091),
    "eye_outer": _Landmark("head", "head", 0.055, 0.027, 0.091),
    "mouth": _Landmark("head", "head", 0.066, 0.014, 0.044),
    "little_finger": _Landmark("hand", "hand", -0.018, 0.047, -0.002, 0.014),
    "index_finger": _Landmark("hand", "hand", 0.018, 0.053, -0.002, 0.014),
    "thumb": _Landmark("hand", "hand", 0.030, 0.033, -0.004, 0.014),
}
_PLACES = {
    "shelf14": _SHELF14,
    "body25b": _BODY25 | _CROWN | {"neck": _Landmark("head", "head", 0.006, 0, 0.022, 0.060)},
    "halpe26": _BODY25 | _CROWN,
    "blazepose33": _BODY25 | _FACE_AND_HANDS,
}
"""Landmarks of skeletons that place joints differently from the joints of the same name in BODY_25."""
_SKIN = 0.025
"""Depth through which a joint on the skin still counts as seen, m."""


@lru_cache(maxsize=512)
def landmarks(body: Body, skeleton: Skeleton = SKELETON) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the joints of a skeleton on a body, each where the skeleton's annotators or detector place it.

    Args:
        body: The body.
        skeleton: Any of `dmae.data.skeleton.SKELETONS`, or two of them side by side.

    Returns:
        segments: (J,) index into `SEGMENTS` of the segment that each joint moves with.
        points: (J, 3) position of the joint in that segment's frame, m.
        depth: (J,) greatest distance before the joint at which a ray may first meet the body and still count as seeing
            the joint, m: the depth of the joint in its limb, or little more than skin.
    """
    at = dict(zip(SEGMENTS, segment_origins(body, np.zeros((1, 3)), np.tile(np.eye(3), (1, 16, 1, 1)))[0], strict=True))
    segments, places, depth = [], [], []

    def place(landmark: _Landmark, side: str) -> np.ndarray:
        local = np.array((landmark.x, landmark.y * SIDES.get(side, 1.0), landmark.z)) * _size(body, landmark)
        return local + np.mean([at[s] for s in _sided(landmark.joint, side)], axis=0)

    # Origin of Shelf's heads: half way between the shoulders and the ears.
    middle = np.mean([place(_BODY25[point], side) for side in SIDES for point in ("shoulder", "ear")], axis=0)
    for name in skeleton.joints:
        family, _, joint = name.rpartition(".")
        side, kind = side_and_name(joint)
        landmark = _PLACES.get(family or skeleton.name, _BODY25)[kind]
        counted = middle - at["head"] if kind in _HEADS else 0.0
        places.append(place(landmark, side) + counted)
        segments.append(_sided(landmark.segment, side)[0])
        depth.append(_SKIN + landmark.radius * _size(body, landmark) * body.girth)
    points = np.array(places) - np.array([at[segment] for segment in segments])
    return np.array([SEGMENTS.index(segment) for segment in segments]), points, np.array(depth)


def _size(body: Body, landmark: _Landmark) -> float:
    return body.stature * (body.head if landmark.joint == "head" else 1.0)


def _sided(name: str, side: str) -> list[str]:
    """Return the segments for a name without its side: the one on `side` or the mid line; both if `side` is empty."""
    if name in SEGMENTS:
        return [name]
    return [f"{one}_{name}" for one in ([side] if side else SIDES)]
