"""The skeleton of joints that a file names, with or without bones."""

import re
from collections.abc import Sequence
from pathlib import Path

from dmae.data.skeleton import SKELETONS, Skeleton
from dmae.data.skeletons.definition import define

_REFUSED = re.compile(r"[+./\\\t,]")
_SIDES = {"l": "r", "left": "right", "L": "R", "Left": "Right", "LEFT": "RIGHT"}
_SIDE = re.compile(r"^(left|Left|LEFT|[lL](?=[_A-Z -]))|(?<=[a-z_ -])(left|Left|LEFT|L)$|(?<=[_ -])l$")


def named_skeleton(
    names: Sequence[str], edges: Sequence[tuple[int, int]], wanted: Skeleton | None, path: Path
) -> tuple[Skeleton, list[int], tuple[str, ...]]:
    """Return the skeleton of joints in a file, and where the file has each.

    Without a skeleton that is asked for, it is one of this package with the same joints, or else made of the names, the
    edges, and left and right in the names.

    Args:
        names: Of the joints in the file.
        edges: Pairs of indices of joints that are connected, the parent first.
        wanted: The skeleton that is asked for; all its joints have to be in the file.
        path: Of the file, for messages.

    Returns:
        skeleton: J joints.
        index: (J,) into `names`.
        notes: Decisions that can be wrong.

    Raises:
        ValueError: a joint is there twice or missing; the message has the joints of both.
    """
    plain = [_plain(name) for name in names]
    if len(set(plain)) < len(plain) or not names:
        raise ValueError(f"{path}: expected joints of different names, found {', '.join(names) or 'none'}")
    same = (each for each in SKELETONS.values() if {_plain(joint) for joint in each.joints} == set(plain))
    skeleton = wanted or next(same, None)
    if skeleton is not None:
        lacking = [joint for joint in skeleton.joints if _plain(joint) not in plain]
        if lacking:
            raise ValueError(
                f"{path}: its joints are not those of {skeleton.name}: it lacks {', '.join(lacking)}, and has "
                f"{', '.join(names)}"
            )
        index = [plain.index(_plain(joint)) for joint in skeleton.joints]
        others = [name for number, name in enumerate(names) if number not in index]
        notes = (f"joints that {skeleton.name} lacks are left out: {', '.join(others)}",) if others else ()
        return skeleton, index, notes
    return _made(names, edges, path)


def _made(
    names: Sequence[str], edges: Sequence[tuple[int, int]], path: Path
) -> tuple[Skeleton, list[int], tuple[str, ...]]:
    joints = [_REFUSED.sub("_", name).strip() for name in names]
    parents: dict[str, str | None] = dict.fromkeys(joints)
    notes = []
    for parent, child in edges:
        if parents[joints[child]] is None and not _above(joints[child], joints[parent], parents):
            parents[joints[child]] = joints[parent]
        else:
            notes.append(f"the edge from {joints[parent]} to {joints[child]} is left out, as bones make a tree")
    pairs = [[name, other] for name in joints if (other := _other_side(name)) in joints]
    fitting = [pair for pair in pairs if _fits(pair, pairs, parents)]
    skeleton = define({"name": "tracked", "joints": parents, "mirror": fitting}, str(path))
    sides = ", ".join(f"{left} and {right}" for left, right in fitting)
    notes.append(
        f"no skeleton was given: {len(joints)} joints with {len(skeleton.bones)} bones as the file names them"
        + (f", of left and right {sides}" if sides else "")
        + "; data.skeleton=my_skeleton.yaml states bones, sides and size"
    )
    return skeleton, list(range(len(joints))), tuple(notes)


def _above(ancestor: str, joint: str | None, parents: dict[str, str | None]) -> bool:
    while joint is not None and joint != ancestor:
        joint = parents[joint]
    return joint is not None


def _fits(pair: list[str], pairs: list[list[str]], parents: dict[str, str | None]) -> bool:
    """Return whether a pair hangs, as do all above it, from one joint or from a pair."""
    above = [parents[joint] for joint in pair]
    if above[0] == above[1]:
        return True
    return above in pairs and _fits(above, pairs, parents)


def _other_side(name: str) -> str | None:
    """Return the name of the partner on the right of a joint on the left; None for others."""
    found = _SIDE.search(name)
    if not found:
        return None
    return name[: found.start()] + _SIDES[found[0]] + name[found.end() :]


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())
