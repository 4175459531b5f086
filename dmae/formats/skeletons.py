"""The skeleton of detections, by the names of their joints or by the lengths of their bones."""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dmae.data.skeleton import (
    BLAZEPOSE33,
    BODY21,
    BODY25,
    BODY25B,
    COCO17,
    COCO18,
    HALPE26,
    PANOPTIC19,
    SHELF14,
    SKELETONS,
    Skeleton,
    decode_skeleton,
    define,
    encode,
)
from dmae.files.checks import MOST_PIXELS, check_numbers
from dmae.files.structured import parse_json
from dmae.formats.recordings import NumberedDetections, plain

_MIN_BONES = 4
"""Smallest number of bones of each skeleton that a person must show to be compared.

With this number, all of 4674 people in two real recordings fit the right skeleton better."""
_MIN_PEOPLE = 3  # Smallest number of people that must be compared
_MAJORITY = 0.8  # Share of the people that have to fit the same skeleton best


def skeleton_text(skeleton: Skeleton) -> str:
    """Return the name of a skeleton, or the definition of your own as JSON, as files of poses state it."""
    encoded = encode(skeleton)
    return encoded if isinstance(encoded, str) else json.dumps(encoded)


def read_skeleton_text(path: Path, text: str) -> Skeleton:
    """Return the skeleton that `skeleton_text` wrote into a file; ValueError, with its path, if there is no such."""
    try:
        return decode_skeleton(parse_json(text) if text.startswith("{") else text, "skeleton")
    except (ValueError, KeyError) as error:
        raise ValueError(f"{path}: {error.args[0] if error.args else error}") from None


_BY_COUNT = {
    len(skeleton): skeleton for skeleton in (BODY25, COCO18, COCO17, BODY21, HALPE26, PANOPTIC19, SHELF14, BLAZEPOSE33)
}
_WHOLE_BODY = 133
OF_25_JOINTS = (BODY25, BODY25B)
"""Skeletons with 25 joints, the most common first. Only the positions of the joints distinguish them."""


def default_skeleton(path: Path | str, joints: int | None) -> Skeleton:
    """Return the default skeleton of a number of joints; ValueError, with the path, if there is none.

    Of the 133 points of COCO-WholeBody, it is that of the first 17.
    """
    if joints == _WHOLE_BODY:
        return COCO17
    if joints not in _BY_COUNT:
        known = ", ".join(f"{count} ({skeleton.name})" for count, skeleton in sorted(_BY_COUNT.items()))
        raise ValueError(
            f"{path}: found people of {joints} joints, which is no skeleton known; there are {known}, or yours, by "
            "data.skeleton=<file> (docs/how-to/skeleton.md)"
        )
    return _BY_COUNT[joints]


def guess_skeleton(path: Path, people: np.ndarray) -> tuple[Skeleton, tuple[str, ...]]:
    """Return the one of `OF_25_JOINTS` whose bones are shortest in the image: in the other order, bones cross the body.

    For each person of `people` (N, 25, 3), x, y in px and confidence, the mean length of the bones, relative to the
    extent of the person's joints, is compared between the skeletons. Each person counts as one vote. Notes give the
    margin of the decision, unless the most common skeleton fits at least 95% of the people best.

    Raises ValueError, with the path, if too few people show enough joints, or too few of them agree.
    """
    candidates, xy = OF_25_JOINTS, people[..., :2]
    if not len(xy):
        return candidates[0], ()
    lengths = np.array([_mean_bone(skeleton, xy) for skeleton in candidates])
    lengths = lengths[:, np.isfinite(lengths).all(0)]
    votes = (
        np.bincount(lengths.argmin(0), minlength=len(candidates)) if lengths.size else np.zeros(len(candidates), int)
    )
    count, best = int(votes.sum()), int(votes.argmax())
    names = " or ".join(f"data.skeleton={skeleton.name}" for skeleton in candidates)
    if count < _MIN_PEOPLE or votes[best] < _MAJORITY * count:
        found = " and ".join(
            f"{number} fit {skeleton.name}" for number, skeleton in zip(votes, candidates, strict=True)
        )
        raise ValueError(
            f"{path}: people of {xy.shape[1]} joints can have different skeletons, and the detections do not decide: "
            f"of {len(xy)} detected people {count} show enough joints to be compared, {found}; give {names}"
        )
    others = np.delete(lengths, best, 0).min(0)
    margin = float(np.median(others / np.maximum(lengths[best], 1e-9)))
    if best == 0 and votes[0] >= 0.95 * count:
        return candidates[0], ()
    wrong = " or ".join(skeleton.name for skeleton in candidates if skeleton != candidates[best])
    return candidates[best], (
        f"people of {xy.shape[1]} joints are assumed to be {candidates[best].name}, not {wrong}: its bones are "
        f"{margin:.1f} times shorter, in {votes[best]} of {count} people that show enough joints; data.skeleton "
        "overrides",
    )


def _mean_bone(skeleton: Skeleton, xy: np.ndarray) -> np.ndarray:
    """Return the mean bone length (D,) of people (D, J, 2), relative to their extent; NaN if few bones are known."""
    start, end = np.array(skeleton.bones).T
    length = np.linalg.norm(xy[:, start] - xy[:, end], axis=-1)
    known, bones = np.isfinite(xy).all(-1, keepdims=True), np.isfinite(length)
    count = np.maximum(known.sum(1), 1)
    middle = np.where(known, xy, 0).sum(1) / count
    extent = np.sqrt((np.where(known, xy - middle[:, None], 0) ** 2).sum((1, 2)) / count[:, 0])
    enough = (bones.sum(1) >= _MIN_BONES) & (extent > 0)
    mean = np.where(bones, length, 0).sum(1) / np.maximum(bones.sum(1), 1)
    return np.where(enough, mean / np.maximum(extent, 1e-9), np.nan)


_REFUSED = re.compile(r"[+./\\\t,]")
_SIDES = {"l": "r", "left": "right", "L": "R", "Left": "Right", "LEFT": "RIGHT"}
_SIDE = re.compile(r"^(left|Left|LEFT|[lL](?=[_A-Z -]))|(?<=[a-z_ -])(left|Left|LEFT|L)$|(?<=[_ -])l$")


@dataclass(frozen=True)
class NamedDetections:
    """Detections in the file of one camera, with the names of their joints."""

    names: Sequence[str]  # Names of the J joints
    people: np.ndarray  # (F, D, J, 3) x and y in px, confidence; NaN where absent
    frames: Sequence[int] | np.ndarray | None = None  # (F,) numbers of the frames; by default they count from 0
    edges: Sequence[tuple[int, int]] = ()  # Pairs of indices of connected joints, the parent first
    skeleton: Skeleton | None = None  # The skeleton that the file names; None if it names none


def named_detections(
    files: Mapping[str, Path], read: Callable[[Path], NamedDetections], wanted: Skeleton | None
) -> NumberedDetections:
    """Return the detections of all cameras, read from the file of each, on one skeleton, which `named_skeleton` finds.

    A joint without coordinates or confidence is absent. A person without joints is also absent. Raises ValueError if
    coordinates are impossible, or joints differ from the `wanted` skeleton or another camera.
    """
    views: dict[str, dict[int, np.ndarray]] = {}
    first: list[str] = []
    notes: tuple[str, ...] = ()
    for camera, file in files.items():
        found = read(file)
        names = list(found.names)
        if not views:
            wanted, index, notes = named_skeleton(names, found.edges, wanted or found.skeleton, file)
            first = names
        elif names != first:
            expected = f"expected the joints of the other cameras, {', '.join(first)}"
            raise ValueError(f"{file}: {expected}; found {', '.join(names)}")
        check_numbers(f"{file}: coordinates", found.people[..., :2], MOST_PIXELS)
        people = found.people[:, :, index]
        people[~np.isfinite(people).all(-1)] = np.nan
        there = ~np.isnan(people[..., 0]).all(-1)
        frames = range(len(people)) if found.frames is None else found.frames
        views[camera] = {int(n): each[shown] for n, each, shown in zip(frames, people, there, strict=True)}
    assert wanted is not None, "no file"
    return NumberedDetections(wanted, views, notes=notes)


def bare(name: str) -> str:
    """Return the letters and digits of the name of a joint, with sides as l and r: of left_knee, L.Knee and l_knee."""
    return re.sub("^(l|r)(eft|ight)(?=.)", r"\1", plain(name))


def named_skeleton(
    names: Sequence[str], edges: Sequence[tuple[int, int]], wanted: Skeleton | None, path: Path
) -> tuple[Skeleton, list[int], tuple[str, ...]]:
    """Return a skeleton for the named joints in a file, the index (J,) of each joint in `names`, and notes.

    Without a `wanted` skeleton, it is a skeleton of this package with the same joints. If there is none, a new skeleton
    is defined by the names, the edges (pairs of indices, the parent first), and left and right in the names. Raises
    ValueError, which lists joints of the file, if a joint occurs twice or a wanted one is missing.
    """
    known = [bare(name) for name in names]
    if len(set(known)) < len(known) or not names:
        raise ValueError(f"{path}: expected joints of different names, found {', '.join(names) or 'none'}")
    same = (each for each in SKELETONS.values() if {bare(joint) for joint in each.joints} == set(known))
    skeleton = wanted or next(same, None)
    if skeleton is not None:
        lacking = [joint for joint in skeleton.joints if bare(joint) not in known]
        if lacking:
            raise ValueError(
                f"{path}: expected the joints of {skeleton.name}: it lacks {', '.join(lacking)}, and has "
                f"{', '.join(names)}"
            )
        index = [known.index(bare(joint)) for joint in skeleton.joints]
        others = [name for number, name in enumerate(names) if number not in index]
        notes = (f"joints that {skeleton.name} lacks are left out: {', '.join(others)}",) if others else ()
        return skeleton, index, notes
    return _new_skeleton(names, edges, path)


def _new_skeleton(
    names: Sequence[str], edges: Sequence[tuple[int, int]], path: Path
) -> tuple[Skeleton, list[int], tuple[str, ...]]:
    joints = [_REFUSED.sub("_", name).strip() for name in names]
    parents: dict[str, str | None] = dict.fromkeys(joints)
    notes = []
    for parent, child in edges:
        if parents[joints[child]] is None and not _is_ancestor(joints[child], joints[parent], parents):
            parents[joints[child]] = joints[parent]
        else:
            notes.append(f"the edge from {joints[parent]} to {joints[child]} is left out, as bones make a tree")
    pairs = [[name, other] for name in joints if (other := _other_side(name)) in joints]
    fitting = [pair for pair in pairs if _can_be_mirrored(pair, pairs, parents)]
    skeleton = define({"name": "tracked", "joints": parents, "mirror": fitting}, str(path))
    sides = ", ".join(f"{left} and {right}" for left, right in fitting)
    notes.append(
        f"no skeleton was given: {len(joints)} joints with {len(skeleton.bones)} bones as the file names them"
        + (f", of left and right {sides}" if sides else "")
        + "; data.skeleton=my_skeleton.yaml states bones, sides and size"
    )
    return skeleton, list(range(len(joints))), tuple(notes)


def _is_ancestor(ancestor: str, joint: str | None, parents: dict[str, str | None]) -> bool:
    while joint is not None and joint != ancestor:
        joint = parents[joint]
    return joint is not None


def _can_be_mirrored(pair: list[str], pairs: list[list[str]], parents: dict[str, str | None]) -> bool:
    """Return whether a pair of joints can be mirrored: their parents are one joint, or a pair that can be mirrored."""
    above = [parents[joint] for joint in pair]
    if above[0] == above[1]:
        return True
    return any(each == above and _can_be_mirrored(each, pairs, parents) for each in pairs)


def _other_side(name: str) -> str | None:
    """Return the name of the joint on the right that corresponds to a joint on the left; None for other joints."""
    found = _SIDE.search(name)
    if not found:
        return None
    return name[: found.start()] + _SIDES[found[0]] + name[found.end() :]
