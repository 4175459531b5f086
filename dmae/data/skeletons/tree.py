"""The type `Skeleton`: ordered joints, and the tree that connects them."""

from dataclasses import dataclass, field
from functools import cached_property

PERSON_M = 1.7
"""m; the size of people. Lengths in configurations and methods are valid for this size."""
_TORSO = {"mid_hip", "neck", "l_hip", "r_hip", "l_shoulder", "r_shoulder", "bottom_head"}


@dataclass(frozen=True)
class Skeleton:
    """An ordered set of named joints forming one or more trees.

    In the skeletons of this package, left and right joints are named `l_*` and `r_*`. The same name in two skeletons
    means the same body part, although the points of two annotators or detectors can differ by a few centimetres (see
    `dmae.data.skeleton_conversion`). `dmae.data.skeletons.definition` reads other skeletons from files.

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
            KeyError: a joint is unknown; the message lists the joints of the skeleton.
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
