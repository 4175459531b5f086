"""The skeletons of this package, and functions that return a skeleton by name or from a file."""

from pathlib import Path

from dmae.data.skeletons.definition import define, read_skeleton
from dmae.data.skeletons.tree import Skeleton as Skeleton
from dmae.data.skeletons.tree import fuse as fuse
from dmae.registry import unknown

_FILES = (".yaml", ".yml")


def _skeleton(name: str, *joints: str) -> Skeleton:
    """Return a skeleton from joints written as `joint<parent`; roots have no `<`."""
    names = [joint.partition("<")[0] for joint in joints]
    parents = [joint.partition("<")[2] for joint in joints]
    return Skeleton(name, tuple(names), tuple(names.index(parent) if parent else -1 for parent in parents))


_BODY25 = (
    "nose<neck", "neck<mid_hip",
    "r_shoulder<neck", "r_elbow<r_shoulder", "r_wrist<r_elbow",
    "l_shoulder<neck", "l_elbow<l_shoulder", "l_wrist<l_elbow",
    "mid_hip", "r_hip<mid_hip", "r_knee<r_hip", "r_ankle<r_knee",
    "l_hip<mid_hip", "l_knee<l_hip", "l_ankle<l_knee",
    "r_eye<nose", "l_eye<nose", "r_ear<r_eye", "l_ear<l_eye",
    "l_big_toe<l_ankle", "l_small_toe<l_big_toe", "l_heel<l_ankle",
    "r_big_toe<r_ankle", "r_small_toe<r_big_toe", "r_heel<r_ankle",
)  # fmt: skip

BODY25 = _skeleton("body25", *_BODY25)
"""OpenPose BODY_25."""

BODY21 = _skeleton("body21", *(joint for joint in _BODY25 if "small_toe" not in joint and "heel" not in joint))
"""The paper's source skeleton: BODY_25 without small toes and heels."""

BODY25B = _skeleton(
    "body25b", "nose<neck", "l_eye<nose", "r_eye<nose", "l_ear<l_eye", "r_ear<r_eye",
    "l_shoulder<neck", "r_shoulder<neck", "l_elbow<l_shoulder", "r_elbow<r_shoulder",
    "l_wrist<l_elbow", "r_wrist<r_elbow", "l_hip<neck", "r_hip<neck", "l_knee<l_hip", "r_knee<r_hip",
    "l_ankle<l_knee", "r_ankle<r_knee", "neck", "head_top<nose",
    "l_big_toe<l_ankle", "l_small_toe<l_big_toe", "l_heel<l_ankle",
    "r_big_toe<r_ankle", "r_small_toe<r_big_toe", "r_heel<r_ankle",
)  # fmt: skip
"""OpenPose BODY_25B. Pose2Sim's demo recordings use it."""

COCO17 = _skeleton(
    "coco17", "nose", "l_eye<nose", "r_eye<nose", "l_ear<l_eye", "r_ear<r_eye",
    "l_shoulder<nose", "r_shoulder<nose", "l_elbow<l_shoulder", "r_elbow<r_shoulder",
    "l_wrist<l_elbow", "r_wrist<r_elbow", "l_hip<l_shoulder", "r_hip<r_shoulder",
    "l_knee<l_hip", "r_knee<r_hip", "l_ankle<l_knee", "r_ankle<r_knee",
)  # fmt: skip

COCO18 = _skeleton(
    "coco18", "nose<neck", "neck", "r_shoulder<neck", "r_elbow<r_shoulder", "r_wrist<r_elbow",
    "l_shoulder<neck", "l_elbow<l_shoulder", "l_wrist<l_elbow", "r_hip<neck", "r_knee<r_hip", "r_ankle<r_knee",
    "l_hip<neck", "l_knee<l_hip", "l_ankle<l_knee", "r_eye<nose", "l_eye<nose", "r_ear<r_eye", "l_ear<l_eye",
)  # fmt: skip
"""OpenPose COCO: the joints of `COCO17` and a neck, in another order."""

SHELF14 = _skeleton(
    "shelf14", "r_ankle<r_knee", "r_knee<r_hip", "r_hip<bottom_head", "l_hip<bottom_head",
    "l_knee<l_hip", "l_ankle<l_knee", "r_wrist<r_elbow", "r_elbow<r_shoulder",
    "r_shoulder<bottom_head", "l_shoulder<bottom_head", "l_elbow<l_shoulder", "l_wrist<l_elbow",
    "bottom_head", "top_head<bottom_head",
)  # fmt: skip
"""The joints annotated in the Shelf and Campus recordings."""

PANOPTIC19 = _skeleton(
    "panoptic19", "neck<mid_hip", "nose<neck", "mid_hip",
    "l_shoulder<neck", "l_elbow<l_shoulder", "l_wrist<l_elbow", "l_hip<mid_hip", "l_knee<l_hip", "l_ankle<l_knee",
    "r_shoulder<neck", "r_elbow<r_shoulder", "r_wrist<r_elbow", "r_hip<mid_hip", "r_knee<r_hip", "r_ankle<r_knee",
    "l_eye<nose", "l_ear<l_eye", "r_eye<nose", "r_ear<r_eye",
)  # fmt: skip

HALPE26 = _skeleton(
    "halpe26", "nose<neck", "l_eye<nose", "r_eye<nose", "l_ear<l_eye", "r_ear<r_eye",
    "l_shoulder<neck", "r_shoulder<neck", "l_elbow<l_shoulder", "r_elbow<r_shoulder",
    "l_wrist<l_elbow", "r_wrist<r_elbow", "l_hip<mid_hip", "r_hip<mid_hip", "l_knee<l_hip", "r_knee<r_hip",
    "l_ankle<l_knee", "r_ankle<r_knee", "head_top<neck", "neck<mid_hip", "mid_hip",
    "l_big_toe<l_ankle", "r_big_toe<r_ankle", "l_small_toe<l_big_toe", "r_small_toe<r_big_toe",
    "l_heel<l_ankle", "r_heel<r_ankle",
)  # fmt: skip

BLAZEPOSE33 = _skeleton(
    "blazepose33", "nose", "l_eye_inner<nose", "l_eye<l_eye_inner", "l_eye_outer<l_eye",
    "r_eye_inner<nose", "r_eye<r_eye_inner", "r_eye_outer<r_eye", "l_ear<l_eye_outer", "r_ear<r_eye_outer",
    "l_mouth<nose", "r_mouth<nose", "l_shoulder<nose", "r_shoulder<nose", "l_elbow<l_shoulder", "r_elbow<r_shoulder",
    "l_wrist<l_elbow", "r_wrist<r_elbow", "l_little_finger<l_wrist", "r_little_finger<r_wrist",
    "l_index_finger<l_wrist", "r_index_finger<r_wrist", "l_thumb<l_wrist", "r_thumb<r_wrist",
    "l_hip<l_shoulder", "r_hip<r_shoulder", "l_knee<l_hip", "r_knee<r_hip", "l_ankle<l_knee", "r_ankle<r_knee",
    "l_heel<l_ankle", "r_heel<r_ankle", "l_big_toe<l_ankle", "r_big_toe<r_ankle",
)  # fmt: skip
"""The landmarks of MediaPipe's BlazePose."""

SKELETONS = {
    skeleton.name: skeleton
    for skeleton in (BODY25, BODY21, BODY25B, COCO17, COCO18, SHELF14, PANOPTIC19, HALPE26, BLAZEPOSE33)
}  # fmt: skip


def get_skeleton(name: str) -> Skeleton:
    """Return a skeleton by name, fused from two, or from a file: `body25`, `body21+shelf14`, `my_skeleton.yaml`.

    Args:
        name: Name of a skeleton of this package, two names joined by `+`, or path of a YAML file, see
            `dmae.data.skeletons.definition.read_skeleton`.

    Raises:
        KeyError: the skeleton is unknown; the message lists the known skeletons.
        FileNotFoundError, ValueError: the file does not exist, or defines no skeleton; the message names the file.
    """
    if not isinstance(name, str):
        raise KeyError(f"expected the name of a skeleton, found {name!r:.60}")
    if name.endswith(_FILES):
        return check_name(read_skeleton(Path(name)), name)
    parts = name.split("+")
    if len(parts) > 2 or not all(part in SKELETONS for part in parts):
        known = unknown("skeleton", name, sorted(SKELETONS))
        raise KeyError(f"{known}; two of them joined by '+'; and your own in a YAML file, by its path")
    return SKELETONS[name] if len(parts) == 1 else fuse(SKELETONS[parts[0]], SKELETONS[parts[1]])


def check_name(skeleton: Skeleton, where: str) -> Skeleton:
    """Return a skeleton unchanged.

    Raises:
        ValueError: it has the name of a skeleton of this package, but differs from it.
    """
    if skeleton.name in SKELETONS and skeleton != SKELETONS[skeleton.name]:
        raise ValueError(f"{where}: {skeleton.name!r} is the name of a skeleton of this package; choose another name")
    return skeleton


def decode_skeleton(value: str | dict, where: str) -> Skeleton:
    """Return a skeleton from the output of `dmae.data.skeletons.definition.encode`: a name, or a definition.

    Raises:
        KeyError, ValueError: the value is neither the name nor the definition of a skeleton.
    """
    if isinstance(value, dict):
        return check_name(define(value, where), where)
    if isinstance(value, str) and value.endswith(_FILES):
        raise ValueError(f"{where}: expected a skeleton, found the name of a file, {value!r:.60}")
    return get_skeleton(value)
