"""Skeletons: the type `Skeleton`, the skeletons of this package, and your own from YAML files.

`docs/how-to/skeleton.md` explains the keys of a file: `name`, `joints` with their parents, and optionally `mirror`,
`torso`, `stretching` and `size_m`.
"""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from dmae.files.structured import read_yaml
from dmae.nearest import choices, suggestion, unknown

PERSON_M = 1.7
"""m; the size of people. Lengths in configurations and methods are valid for this size."""
_TORSO = {"mid_hip", "neck", "l_hip", "r_hip", "l_shoulder", "r_shoulder", "bottom_head"}


@dataclass(frozen=True)
class Skeleton:
    """An ordered set of named joints forming one or more trees.

    In the skeletons of this package, left and right joints are named `l_*` and `r_*`. The same name in two skeletons
    means the same body part, although the points of two annotators or detectors can differ by a few centimetres (see
    `dmae.data.conversion`).

    Attributes:
        name: Key in the registry, lower case; any name for your own skeleton.
        joints: J joint names, unique.
        parents: (J,) index of the parent of each joint; -1 at a root.
        pairs: Indices of left joints and of the corresponding right joints; None for a skeleton of this package, in
            which joints named `l_*` and `r_*` correspond.
        torso: Indices of joints that do not move relative to each other. None for hips, shoulders and neck or, if your
            own skeleton has fewer than three of these, for the roots and their children.
        stretching: Indices of joints for which the bone from the parent changes its length.
        size_m: m; usual distance between the two joints farthest apart; None if it has to be measured. It is ignored
            when skeletons are compared.

    Raises:
        ValueError: names are not unique, or parents form a circle or are invalid.
    """

    name: str
    joints: tuple[str, ...]
    parents: tuple[int, ...]
    pairs: tuple[tuple[int, int], ...] | None = None
    torso: tuple[int, ...] | None = None
    stretching: tuple[int, ...] = ()
    size_m: float | None = field(default=PERSON_M, compare=False)

    def __post_init__(self):
        if len(set(self.joints)) != len(self.joints):
            raise ValueError(f"skeleton {self.name!r}: joint names must be unique, found {self.joints}")
        if len(self.parents) != len(self.joints):
            raise ValueError(
                f"skeleton {self.name!r}: expected {len(self.joints)} parents, one a joint, found {len(self.parents)}"
            )
        if any(not -1 <= parent < len(self.joints) for parent in self.parents):
            raise ValueError(f"skeleton {self.name!r}: parents must lie in -1..{len(self.joints) - 1}: {self.parents}")
        ancestors = list(self.parents)
        for _ in self.joints:
            ancestors = [self.parents[joint] if joint >= 0 else -1 for joint in ancestors]
        if max(ancestors, default=-1) >= 0:
            circle = ", ".join(joint for joint, above in zip(self.joints, ancestors, strict=True) if above >= 0)
            raise ValueError(f"skeleton {self.name!r}: parents run in a circle, through {circle}: {self.parents}")

    def __len__(self) -> int:
        return len(self.joints)

    def index(self, *names: str) -> list[int]:
        """Return the indices of the named joints; KeyError, which lists the skeleton's joints, if one is unknown."""
        lacking = [name for name in names if name not in self._index]
        if lacking:
            # A fused skeleton calls a nose `body25.nose`
            meant = next((joint for joint in self.joints if joint.endswith(f".{lacking[0]}")), lacking[0])
            raise KeyError(f"skeleton {self.name!r} has no joint {lacking}; {choices(meant, self.joints)}")
        return [self._index[name] for name in names]

    def index_of_part(self, part: "Skeleton") -> list[int] | None:
        """Return the indices of another skeleton's joints, which a fused skeleton names `<part>.<joint>`; None if this
        one lacks some."""
        for prefix in ("", f"{part.name}."):
            if set(names := [prefix + joint for joint in part.joints]) <= self._index.keys():
                return self.index(*names)
        return None

    @cached_property
    def _index(self) -> dict[str, int]:
        return {joint: i for i, joint in enumerate(self.joints)}

    @property
    def defined(self) -> bool:
        """Whether the skeleton was defined by the user, and is not a skeleton of this package."""
        return self.pairs is not None

    @cached_property
    def parts(self) -> tuple["Skeleton", ...]:
        """The two parts of a fused skeleton; for other skeletons, only the skeleton itself."""
        if "+" not in self.name:
            return (self,)
        names, found = self.name.split("+"), []
        for name in names:
            own = [i for i, joint in enumerate(self.joints) if joint.startswith(f"{name}.")]
            place = {joint: i for i, joint in enumerate(own)} | {-1: -1}
            joints = tuple(self.joints[i].removeprefix(f"{name}.") for i in own)
            found.append(Skeleton(name, joints, tuple(place[self.parents[i]] for i in own)))
        return tuple(found)

    @cached_property
    def bones(self) -> tuple[tuple[int, int], ...]:
        """Pairs of indices (parent, child), one for each joint with a parent."""
        return tuple((parent, child) for child, parent in enumerate(self.parents) if parent >= 0)

    @cached_property
    def rigid_bones(self) -> tuple[tuple[int, int], ...]:
        """The bones of constant length."""
        return tuple(bone for bone in self.bones if bone[1] not in self.stretching)

    @cached_property
    def mirror(self) -> tuple[int, ...]:
        """(J,) index of the corresponding joint on the other side; the joint's own index on the mid line."""
        if self.pairs is None:
            return tuple(self._index.get(_swap_side(joint), i) for i, joint in enumerate(self.joints))
        partner = dict(self.pairs) | {right: left for left, right in self.pairs}
        return tuple(partner.get(i, i) for i in range(len(self)))

    @cached_property
    def left(self) -> tuple[int, ...]:
        """Indices of joints on the left side with a corresponding joint on the right."""
        if self.pairs is not None:
            return tuple(sorted(left for left, _ in self.pairs))
        names = [joint.rpartition(".")[2] for joint in self.joints]
        return tuple(i for i, name in enumerate(names) if name.startswith("l_") and self.mirror[i] != i)

    @cached_property
    def trunk(self) -> tuple[int, ...]:
        """Indices of joints that do not move relative to each other, see `torso`."""
        if self.torso is not None:
            return self.torso
        found = tuple(i for i, joint in enumerate(self.joints) if joint.rpartition(".")[2] in _TORSO)
        if not self.defined or len(found) > 2:
            return found
        roots = {i for i, parent in enumerate(self.parents) if parent < 0}
        return tuple(i for i, parent in enumerate(self.parents) if i in roots or parent in roots)

    @property
    def scale(self) -> float:
        """Size as a multiple of the size of people; 1 if unknown."""
        return 1.0 if self.size_m is None else self.size_m / PERSON_M


def _swap_side(joint: str) -> str:
    prefix, dot, part = joint.rpartition(".")
    sides = {"l_": "r_", "r_": "l_"}
    return prefix + dot + sides.get(part[:2], part[:2]) + part[2:]


def fuse(first: Skeleton, second: Skeleton) -> Skeleton:
    """Return a skeleton with the joints of both skeletons, named `<skeleton>.<joint>`.

    The paper's pose fusion learns the target skeleton from the tokens of a fused skeleton. The generator writes its
    truth in `body25+shelf14`.
    """
    name = f"{first.name}+{second.name}"
    joints = tuple(f"{part.name}.{joint}" for part in (first, second) for joint in part.joints)
    shifted = tuple(parent + len(first) if parent >= 0 else -1 for parent in second.parents)
    return Skeleton(name, joints, first.parents + shifted)


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


def get_skeleton(name: str | Path | Skeleton) -> Skeleton:
    """Return a skeleton by name, fused from two, or from a file: `body25`, `body21+shelf14`, `my_skeleton.yaml`.

    A skeleton is returned as it is.

    Raises:
        KeyError: the skeleton is unknown; the message lists the known skeletons.
        TypeError: what is given is neither a name, nor a file, nor a skeleton.
        FileNotFoundError, ValueError: the file does not exist, or defines no skeleton (`read_skeleton`).
    """
    if isinstance(name, Skeleton):
        return name
    if not isinstance(name, str | Path):
        raise TypeError(f"skeleton: expected its name, its file or a dmae.Skeleton, found {type(name).__name__}")
    name = str(name)
    if name.endswith(_FILES):
        return check_name(read_skeleton(Path(name)), name)
    parts = name.split("+")
    if len(parts) > 2 or not all(part in SKELETONS for part in parts):
        known = unknown("skeleton", name, sorted(SKELETONS))
        raise KeyError(f"{known}; two of them joined by '+'; and your own in a YAML file, by its path")
    return SKELETONS[name] if len(parts) == 1 else fuse(SKELETONS[parts[0]], SKELETONS[parts[1]])


def option_skeleton(option: str, name: str | Skeleton) -> Skeleton:
    """Return the skeleton that an option names, as `get_skeleton`; ValueError, with the option, if it is unknown."""
    try:
        return get_skeleton(name)
    except KeyError as error:
        raise ValueError(f"{option}={name}: {error.args[0]}") from None


def check_name(skeleton: Skeleton, where: str) -> Skeleton:
    """Return a skeleton, or raise ValueError if it differs from the one of this package with its name."""
    if skeleton.name in SKELETONS and skeleton != SKELETONS[skeleton.name]:
        raise ValueError(f"{where}: {skeleton.name!r} is the name of a skeleton of this package; choose another name")
    return skeleton


def decode_skeleton(value: str | dict, where: str) -> Skeleton:
    """Return a skeleton from the output of `encode`: a name, or a definition; KeyError or ValueError."""
    if isinstance(value, dict):
        return check_name(define(value, where), where)
    if isinstance(value, str) and value.endswith(_FILES):
        raise ValueError(f"{where}: expected a skeleton, found the name of a file, {value!r:.60}")
    if not isinstance(value, str):
        raise ValueError(f"{where}: expected the name of a skeleton or its definition, found {value!r:.60}")
    return get_skeleton(value)


_FILES = (".yaml", ".yml")
_KEYS = {"name", "joints", "mirror", "torso", "stretching", "size_m"}
_MOST_JOINTS = 500
_LONGEST_NAME = 60
_SIZES = (1e-3, 100.0)  # m; smallest and largest `size_m`


def read_skeleton(path: Path) -> Skeleton:
    """Return the skeleton that a YAML file defines, as shown above.

    Raises FileNotFoundError, or ValueError, which names the file and the joint, if the YAML is malformed, a joint
    occurs twice, a parent is unknown, parents form a circle, or mirror pairs do not match.
    """
    path = Path(path)
    return define(read_yaml(path), str(path))


def define(values: object, where: str) -> Skeleton:
    """Return the skeleton that a dictionary with the YAML file's keys defines, or raise ValueError, with `where`."""
    try:
        return _define(values)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def encode(skeleton: Skeleton) -> str | dict:
    """Return one of our skeletons by name, another as a dictionary for JSON; `decode_skeleton` is the inverse."""
    if not skeleton.defined:
        return skeleton.name
    names = skeleton.joints
    found: dict = {
        "name": skeleton.name,
        "joints": {
            joint: names[parent] if parent >= 0 else None for joint, parent in zip(names, skeleton.parents, strict=True)
        },
        "mirror": [[names[left], names[right]] for left, right in skeleton.pairs or ()],
        "stretching": [names[joint] for joint in skeleton.stretching],
    }
    if skeleton.torso is not None:
        found["torso"] = [names[joint] for joint in skeleton.torso]
    if skeleton.size_m is not None:
        found["size_m"] = skeleton.size_m
    return found


def _define(values: object) -> Skeleton:
    if not isinstance(values, dict) or not {"name", "joints"} <= values.keys():
        found = ", ".join(map(str, values)) if isinstance(values, dict) else type(values).__name__
        raise ValueError(f"expected a skeleton with name and joints, found {found:.200}")
    odd = [key for key in values if key not in _KEYS]
    if odd:
        raise ValueError(f"unknown key {odd[0]!r:.60}; a skeleton has {', '.join(sorted(_KEYS))}")
    name, joints = _name(values["name"], "name"), values["joints"]
    if not isinstance(joints, dict) or not 1 <= len(joints) <= _MOST_JOINTS:
        raise ValueError(f"joints: expected 1 to {_MOST_JOINTS} lines 'joint: parent', found {_short(joints)}")
    names = [_name(joint, "joints") for joint in joints]
    parents = []
    for joint, parent in joints.items():
        if parent in (None, ""):
            parents.append(-1)
            continue
        if parent not in names:
            near = f"{suggestion(str(parent), names):.200}"
            raise ValueError(f"joint {joint!r}: its parent {_short(parent)} is no joint; {near}")
        parents.append(names.index(parent))
    pairs = _pairs(values.get("mirror"), names, parents)
    torso = None if values.get("torso") is None else _joints(values["torso"], names, "torso")
    stretching = _joints(values.get("stretching") or [], names, "stretching")
    return Skeleton(name, tuple(names), tuple(parents), pairs, torso, stretching, _size(values.get("size_m")))


def _pairs(values: object, names: list[str], parents: list[int]) -> tuple[tuple[int, int], ...]:
    """Return the indices of mirror pairs, left first. If `values` is None, the joints `l_*` and `r_*` are pairs."""
    if values is None:
        both = [(name, f"r_{name[2:]}") for name in names if name.startswith("l_")]
        values = [list(pair) for pair in both if pair[1] in names]
    if not isinstance(values, list) or any(not isinstance(pair, list) or len(pair) != 2 for pair in values):
        raise ValueError(f"mirror: expected pairs [left, right], found {_short(values)}")
    flat = _joints([joint for pair in values for joint in pair], names, "mirror")
    pairs = tuple(zip(flat[::2], flat[1::2], strict=True))
    partner = dict(pairs) | {right: left for left, right in pairs}
    for left, right in pairs:
        above = [parents[left], parents[right]]
        if partner.get(above[0], above[0]) != above[1] and above != [right, -1] and above != [-1, left]:
            shown = [repr(names[parent]) if parent >= 0 else "none" for parent in above]
            raise ValueError(
                f"mirror: {names[left]!r} and {names[right]!r} do not match, as their parents {shown[0]} and "
                f"{shown[1]} are neither one joint nor a mirror pair"
            )
    return pairs


def _joints(values: object, names: list[str], key: str) -> tuple[int, ...]:
    """Return the indices of the joints in a list; raise ValueError if one is unknown or occurs twice."""
    if not isinstance(values, list):
        raise ValueError(f"{key}: expected a list of joints, found {_short(values)}")
    for number, joint in enumerate(values):
        if joint not in names:
            raise ValueError(f"{key}: {_short(joint)} is no joint; {suggestion(str(joint), names):.200}")
        if joint in values[:number]:
            raise ValueError(f"{key}: {joint!r} occurs twice")
    return tuple(names.index(joint) for joint in values)


def _name(value: object, key: str) -> str:
    if isinstance(value, str) and 0 < len(value) <= _LONGEST_NAME and value.isprintable():  # noqa: SIM102
        if value == value.strip() and not set(value) & set("+./\\\t,"):
            return value
    raise ValueError(
        f"{key}: expected a name of up to {_LONGEST_NAME} characters without + . , / and \\, found "
        f"{_short(value)}; names such as no, on and 1 stand in quotes"
    )


def _size(value: object) -> float | None:
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not _SIZES[0] <= value <= _SIZES[1]:
        raise ValueError(f"size_m: expected a number from {_SIZES[0]:g} to {_SIZES[1]:g} m, found {_short(value)}")
    return float(value)


def _short(value: object) -> str:
    return f"{value!r:.60}" if not isinstance(value, dict | list) else f"{value!s:.60}"
