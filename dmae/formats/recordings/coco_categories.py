"""Names of joints in COCO's categories, and the skeletons with these joints."""

from pathlib import Path

from dmae.data.skeleton import SKELETONS, Skeleton
from dmae.formats.openpose import BY_COUNT

_SIDES = {"l_": "left_", "r_": "right_"}


def joint_names(skeleton: Skeleton) -> list[str]:
    """Return the names of joints as COCO writes them, left_eye for example."""
    names = []
    for joint in skeleton.joints:
        part, dot, bare = joint.rpartition(".")
        names.append(part + dot + _SIDES.get(bare[:2], bare[:2]) + bare[2:])
    return names


def category_joints(file: Path, categories) -> list[str] | None:
    """Return the names of the joints from the only category with keypoints; None if no category has keypoints."""
    if not isinstance(categories, list) or not all(isinstance(category, dict) for category in categories):
        raise ValueError(f"{file}: expected a list of categories, found {categories!r:.60}")
    named = [category["keypoints"] for category in categories if category.get("keypoints")]
    if len(named) > 1:
        raise ValueError(f"{file}: expected one category with keypoints, found {len(named)}")
    return [str(name).lower().replace(" ", "_") for name in named[0]] if named else None


def recognise_skeleton(path: Path, names: list[str] | None, joints: int | None) -> Skeleton:
    """Return the skeleton with the joints that a category names, or else the default for a number of joints.

    Args:
        path: Path of the annotations, for messages.
        names: Names of the joints, as `category_joints` returns them.
        joints: Number of joints in the annotations; None if there are no annotations.

    Raises:
        ValueError: no skeleton has these joints.
    """
    for skeleton in SKELETONS.values():
        if names and names in (joint_names(skeleton), list(skeleton.joints)):
            return skeleton
    if names is None and joints is None:
        raise ValueError(f"{path}: no keypoints in any annotation, and no category that names them")
    if names or joints not in BY_COUNT:
        raise ValueError(
            f"{path}: no skeleton has the keypoints {names or joints}; there are {sorted(SKELETONS)}, "
            "data.skeleton=... names the one to take them for"
        )
    return BY_COUNT[joints]
