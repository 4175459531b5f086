"""Skeletons: their joints, in order, and the tree that connects them."""

from dataclasses import dataclass
from functools import cached_property


@dataclass(frozen=True)
class Skeleton:
    """An ordered set of named joints forming one or more trees.

    Left and right joints are named `l_*` and `r_*`. The same name in two skeletons is the same body part, though
    annotators and detectors may put the point a few centimetres apart (see `dmae.data.skeleton_conversion`).

    Attributes:
        name: Key in the registry, lower case.
        joints: J joint names, unique.
        parents: (J,) index of each joint's parent; -1 at a root.

    Raises:
        ValueError: names are not unique, or parents are not a tree.
    """

    name: str
    joints: tuple[str, ...]
    parents: tuple[int, ...]

    def __post_init__(self):
        if len(set(self.joints)) != len(self.joints):
            raise ValueError(f"skeleton {self.name!r}: joint names must be unique, got {self.joints}")
        if len(self.parents) != len(self.joints):
            raise ValueError(
                f"skeleton {self.name!r}: expected {len(self.joints)} parents, one a joint, got {len(self.parents)}"
            )
        if any(not -1 <= parent < len(self.joints) for parent in self.parents):
            raise ValueError(f"skeleton {self.name!r}: parents must lie in -1..{len(self.joints) - 1}: {self.parents}")
        ancestors = list(self.parents)
        for _ in self.joints:
            ancestors = [self.parents[joint] if joint >= 0 else -1 for joint in ancestors]
        if max(ancestors, default=-1) >= 0:
            raise ValueError(f"skeleton {self.name!r}: parents run in a circle: {self.parents}")

    def __len__(self) -> int:
        return len(self.joints)

    def index(self, *names: str) -> list[int]:
        """Return the indices of the named joints.

        Raises:
            KeyError: no such joint; the message lists the joints of the skeleton.
        """
        unknown = [name for name in names if name not in self._index]
        if unknown:
            raise KeyError(f"skeleton {self.name!r} has no joint {unknown}; it has {list(self.joints)}")
        return [self._index[name] for name in names]

    @cached_property
    def _index(self) -> dict[str, int]:
        return {joint: i for i, joint in enumerate(self.joints)}

    @cached_property
    def parts(self) -> tuple["Skeleton", ...]:
        """The two skeletons of a fused one; otherwise only this one."""
        return tuple(SKELETONS[name] for name in self.name.split("+")) if "+" in self.name else (self,)

    @cached_property
    def bones(self) -> tuple[tuple[int, int], ...]:
        """Index pairs (parent, child), one for each joint with a parent."""
        return tuple((parent, child) for child, parent in enumerate(self.parents) if parent >= 0)

    @cached_property
    def mirror(self) -> tuple[int, ...]:
        """(J,) index of each joint's partner of the other side; its own on the mid line."""
        return tuple(self._index.get(_swap_side(joint), i) for i, joint in enumerate(self.joints))


def _swap_side(joint: str) -> str:
    prefix, dot, part = joint.rpartition(".")
    sides = {"l_": "r_", "r_": "l_"}
    return prefix + dot + sides.get(part[:2], part[:2]) + part[2:]


def _skeleton(name: str, *joints: str) -> Skeleton:
    """Make a skeleton of joints written `joint<parent`, roots without `<`."""
    names = [joint.partition("<")[0] for joint in joints]
    parents = [joint.partition("<")[2] for joint in joints]
    return Skeleton(name, tuple(names), tuple(names.index(parent) if parent else -1 for parent in parents))


def fuse(first: Skeleton, second: Skeleton) -> Skeleton:
    """Return both skeletons side by side, joints named `<skeleton>.<joint>`.

    The paper's pose fusion learns the target skeleton from the tokens of such a pair. The generator writes its truth in
    `body25+shelf14`.
    """
    name = f"{first.name}+{second.name}"
    joints = tuple(f"{part.name}.{joint}" for part in (first, second) for joint in part.joints)
    shifted = tuple(parent + len(first) if parent >= 0 else -1 for parent in second.parents)
    return Skeleton(name, joints, first.parents + shifted)


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
"""OpenPose BODY_25B, as Pose2Sim's demo recordings use it."""

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
    """Return a skeleton by name, or two fused: `body25`, `body21+shelf14`.

    Raises:
        KeyError: no such skeleton; the message lists the known ones.
    """
    if not isinstance(name, str):
        raise KeyError(f"expected the name of a skeleton, found {name!r:.60}")
    parts = name.split("+")
    unknown = [part for part in parts if part not in SKELETONS]
    if unknown or len(parts) > 2:
        raise KeyError(f"no skeleton {name!r}; there are {sorted(SKELETONS)}, and two of them joined by '+'")
    return SKELETONS[name] if len(parts) == 1 else fuse(SKELETONS[parts[0]], SKELETONS[parts[1]])
