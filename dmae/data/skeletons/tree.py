"""The type: joints, in order, and the tree that connects them."""

from dataclasses import dataclass, field
from functools import cached_property

PERSON_M = 1.7
"""m; the size of people, to which the lengths in configurations and methods refer."""
_TORSO = {"mid_hip", "neck", "l_hip", "r_hip", "l_shoulder", "r_shoulder", "bottom_head"}


@dataclass(frozen=True)
class Skeleton:
    """An ordered set of named joints forming one or more trees.

    In the skeletons of this package left and right joints are named `l_*` and `r_*`. The same name in two skeletons is
    the same body part, though annotators and detectors may put the point a few centimetres apart (see
    `dmae.data.skeleton_conversion`). `dmae.data.skeletons.definition` reads others from files.

    Attributes:
        name: Key in the registry, lower case; any name for a skeleton of your own.
        joints: J joint names, unique.
        parents: (J,) index of each joint's parent; -1 at a root.
        pairs: Indices of left joints and of their partners on the right; None for joints named `l_*` and `r_*`.
        torso: Joints that keep their places relative to each other; None for hips, shoulders and neck, or, where a
            skeleton has fewer than three of these, the roots and their children.
        stretching: Joints with a bone from their parent that changes its length.
        size_m: m; usual distance between the two joints farthest apart, None where it is to be measured. Two skeletons
            that differ in nothing else are equal.

    Raises:
        ValueError: names are not unique, or parents are not a tree.
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
            circle = ", ".join(joint for joint, above in zip(self.joints, ancestors, strict=True) if above >= 0)
            raise ValueError(f"skeleton {self.name!r}: parents run in a circle, through {circle}: {self.parents}")

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

    @property
    def defined(self) -> bool:
        """Whether it was defined by a file, and is not a skeleton of this package."""
        return self.pairs is not None

    @cached_property
    def parts(self) -> tuple["Skeleton", ...]:
        """The two skeletons of a fused one; otherwise only this one."""
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
        """Index pairs (parent, child), one for each joint with a parent."""
        return tuple((parent, child) for child, parent in enumerate(self.parents) if parent >= 0)

    @cached_property
    def rigid_bones(self) -> tuple[tuple[int, int], ...]:
        """The bones that keep their length."""
        return tuple(bone for bone in self.bones if bone[1] not in self.stretching)

    @cached_property
    def mirror(self) -> tuple[int, ...]:
        """(J,) index of each joint's partner of the other side; its own on the mid line."""
        if self.pairs is None:
            return tuple(self._index.get(_swap_side(joint), i) for i, joint in enumerate(self.joints))
        partner = dict(self.pairs) | {right: left for left, right in self.pairs}
        return tuple(partner.get(i, i) for i in range(len(self)))

    @cached_property
    def left(self) -> tuple[int, ...]:
        """Joints of the left side that have a partner on the right."""
        if self.pairs is not None:
            return tuple(sorted(left for left, _ in self.pairs))
        names = [joint.rpartition(".")[2] for joint in self.joints]
        return tuple(i for i, name in enumerate(names) if name.startswith("l_") and self.mirror[i] != i)

    @cached_property
    def trunk(self) -> tuple[int, ...]:
        """Joints that keep their places relative to each other, see `torso`."""
        if self.torso is not None:
            return self.torso
        found = tuple(i for i, joint in enumerate(self.joints) if joint.rpartition(".")[2] in _TORSO)
        if not self.defined or len(found) > 2:
            return found
        roots = {i for i, parent in enumerate(self.parents) if parent < 0}
        return tuple(i for i, parent in enumerate(self.parents) if i in roots or parent in roots)

    @property
    def scale(self) -> float:
        """Size as a multiple of that of people; 1 where it is not known."""
        return 1.0 if self.size_m is None else self.size_m / PERSON_M


def _swap_side(joint: str) -> str:
    prefix, dot, part = joint.rpartition(".")
    sides = {"l_": "r_", "r_": "l_"}
    return prefix + dot + sides.get(part[:2], part[:2]) + part[2:]


def fuse(first: Skeleton, second: Skeleton) -> Skeleton:
    """Return both skeletons side by side, joints named `<skeleton>.<joint>`.

    The paper's pose fusion learns the target skeleton from the tokens of such a pair. The generator writes its truth in
    `body25+shelf14`.
    """
    name = f"{first.name}+{second.name}"
    joints = tuple(f"{part.name}.{joint}" for part in (first, second) for joint in part.joints)
    shifted = tuple(parent + len(first) if parent >= 0 else -1 for parent in second.parents)
    return Skeleton(name, joints, first.parents + shifted)
