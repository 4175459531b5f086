"""Your own skeletons: defined in a YAML file, or stored together with data on their joints.

name: hand
size_m: 0.19                  # optional
joints:                       # each with its parent; a joint without a parent is a root
  wrist:
  thumb_1: wrist
  thumb_2: thumb_1
mirror: [[l_ear, r_ear]]      # optional: pairs of left and right
torso: [wrist, thumb_1]       # optional: joints that do not move relative to each other
stretching: [thumb_2]         # optional: joints with a bone of variable length
"""

from difflib import get_close_matches
from pathlib import Path

from dmae.data.skeletons.tree import Skeleton
from dmae.files.structured import read_yaml

_KEYS = {"name", "joints", "mirror", "torso", "stretching", "size_m"}
_MOST_JOINTS = 500
_LONGEST_NAME = 60
_SIZES = (1e-3, 100.0)
"""m; smallest and largest `size_m`."""


def read_skeleton(path: Path) -> Skeleton:
    """Return the skeleton that a YAML file defines. The docstring of this module shows the file.

    Raises:
        FileNotFoundError: the file does not exist.
        ValueError: the YAML is malformed, a joint occurs twice, a parent is unknown, parents form a circle, or mirror
            pairs do not match; the message names the file and the joint.
    """
    path = Path(path)
    return define(read_yaml(path), str(path))


def define(values: object, where: str) -> Skeleton:
    """Return the skeleton that a dictionary defines.

    Args:
        values: A dictionary with the keys of the YAML file.
        where: Origin of the values, for messages.

    Raises:
        ValueError: as `read_skeleton`.
    """
    try:
        return _define(values)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def encode(skeleton: Skeleton) -> str | dict:
    """Return the name of a skeleton of this package, or the definition of another skeleton as a dictionary for JSON.

    `dmae.data.skeleton.decode_skeleton` is the inverse.
    """
    if not skeleton.defined:
        return skeleton.name
    names = skeleton.joints
    found: dict = {
        "name": skeleton.name,
        "joints": {
            joint: names[parent] if parent >= 0 else None for joint, parent in zip(names, skeleton.parents, strict=True)
        },
        "mirror": [[names[left], names[right]] for left, right in skeleton.pairs],
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
    unknown = [key for key in values if key not in _KEYS]
    if unknown:
        raise ValueError(f"unknown key {unknown[0]!r:.60}; a skeleton has {', '.join(sorted(_KEYS))}")
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
            raise ValueError(f"joint {joint!r}: its parent {_short(parent)} is no joint{_near(parent, names)}")
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
            raise ValueError(f"{key}: {_short(joint)} is no joint{_near(joint, names)}")
        if joint in values[:number]:
            raise ValueError(f"{key}: {joint!r} occurs twice")
    return tuple(names.index(joint) for joint in values)


def _name(value: object, key: str) -> str:
    fine = isinstance(value, str) and 0 < len(value) <= _LONGEST_NAME and value.isprintable()
    if not fine or value != value.strip() or set(value) & set("+./\\\t,"):
        raise ValueError(
            f"{key}: expected a name of up to {_LONGEST_NAME} characters without + . , / and \\, found "
            f"{_short(value)}; names such as no, on and 1 stand in quotes"
        )
    return value


def _size(value: object) -> float | None:
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not _SIZES[0] <= value <= _SIZES[1]:
        raise ValueError(f"size_m: expected a number from {_SIZES[0]:g} to {_SIZES[1]:g} m, found {_short(value)}")
    return float(value)


def _near(name: object, names: list[str]) -> str:
    near = get_close_matches(name, names, 1) if isinstance(name, str) else []
    return f"; did you mean {near[0]!r}?" if near else f"; there are {', '.join(names)[:200]}"


def _short(value: object) -> str:
    return f"{value!r:.60}" if not isinstance(value, dict | list) else f"{value!s:.60}"
