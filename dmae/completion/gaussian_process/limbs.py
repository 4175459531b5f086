"""Limbs in gaps: which hidden joints are predicted together, from which joint they hang, and by which others."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dmae.data.skeleton import Skeleton
from dmae.numerics.body import Bodies, median_bone_lengths

NEAR = 0.8
"""s; training poses are dense so far from a gap."""
SPAN = 12.0
"""s; and are taken from so far from it."""
DENSEST = 25.0
"""Training poses a second, near a gap."""


@dataclass(frozen=True)
class Gap:
    """Frames in a row in which a joint of a person is hidden, and the same of its ancestors.

    Attributes:
        person: Index.
        joint: Index.
        anchor: The nearest ancestor that is measured or on a ray, or the joint of the torso that the limb hangs from.
        hidden_ancestors: Number of joints between the two.
        frames: (Q,)
        whole: First and last frame in which the joint is hidden, whatever its ancestors are.
    """

    person: int
    joint: int
    anchor: int
    hidden_ancestors: int
    frames: np.ndarray
    whole: tuple[int, int]


def limb_joints(bodies: Bodies) -> list[int]:
    """Return the joints that hang from the torso, parents first."""
    return [joint for joint in bodies.attached if joint not in bodies.torso]


def ancestors(bodies: Bodies, joint: int) -> list[int]:
    """Return the joints above a joint of a limb, nearest first; the last one is of the torso."""
    above = [bodies.parents[joint]]
    while above[-1] not in bodies.torso and bodies.parents[above[-1]] >= 0:
        above.append(bodies.parents[above[-1]])
    return above


def gaps_of(bodies: Bodies, joint: int, hidden: np.ndarray, unseen: np.ndarray) -> Iterator[Gap]:
    """Yield the gaps of one joint of a limb.

    Args:
        hidden: (F, P, J) True where joints are hidden.
        unseen: (F, P, J) True where they are not on the ray of a single camera either.
    """
    above = ancestors(bodies, joint)
    # The joint of the torso is the anchor even if hidden: the torso is placed by itself.
    covered = np.cumprod(unseen[:, :, above[:-1]], -1).sum(-1) if len(above) > 1 else 0 * hidden[:, :, joint]
    for person in range(hidden.shape[1]):
        for first, end in runs(hidden[:, person, joint]):
            level = covered[first:end, person]
            cuts = [first, *(first + 1 + np.flatnonzero(np.diff(level))), end]
            for start, stop in pairwise(cuts):
                count = int(level[start - first])
                yield Gap(person, joint, above[count], count, np.arange(start, stop), (first, end - 1))


def input_joints(bodies: Bodies, gap: Gap) -> list[int]:
    """Return the joints by which a gap is filled: all but those hidden with it in its limb, and those below it."""
    limb = ancestors(bodies, gap.joint)[: gap.hidden_ancestors]
    return [
        other
        for other in bodies.attached
        if other != gap.joint and other not in limb and not _hangs_from(bodies, other, gap.joint)
    ]


def mirrored(skeleton: Skeleton, joint: int) -> bool:
    """Return whether a joint is of the right side, for which left and right are exchanged."""
    return skeleton.joints[joint].rpartition(".")[2].startswith("r_")


def name_of(skeleton: Skeleton, joint: int, other_side: bool) -> str:
    """Return the name of a joint, or of its partner of the other side."""
    return skeleton.joints[skeleton.mirror[joint] if other_side else joint].rpartition(".")[2]


def training_frames(usable: np.ndarray, gap: Gap, fps: float, most: int) -> np.ndarray:
    """Return frames (N,) to learn from, of those usable (F,): dense near the gap, evenly spaced farther away."""
    first, last = gap.whole
    frames = np.flatnonzero(usable)
    away = np.maximum(np.maximum(first - frames, frames - last), 0) / fps
    close = frames[(away <= NEAR) & (away > 0)]
    close = close[:: max(round(fps / DENSEST), 1)]
    far = frames[(away > NEAR) & (away <= SPAN)]
    count = min(len(far), max(most - len(close), 0))
    return np.sort(np.concatenate([close, far[np.linspace(0, len(far) - 1, count).round().astype(int)]]))


def body_sizes(xyz: np.ndarray, skeleton: Skeleton, bones: dict[str, float]) -> np.ndarray:
    """Return the size of each person of (F, P, J, 3), (P,), as a multiple of the person of usual `bones`."""
    known = [
        (pair, bones[name])
        for pair in skeleton.bones
        if (name := "-".join(skeleton.joints[joint].rpartition(".")[2] for joint in pair)) in bones
    ]
    if not known:
        return np.ones(xyz.shape[1])
    ratio = median_bone_lengths(xyz, [pair for pair, _ in known]) / [length for _, length in known]
    sizes = np.array([np.median(row[~np.isnan(row)]) if (~np.isnan(row)).any() else 1.0 for row in ratio])
    return sizes.clip(0.3, 2.0)


def _hangs_from(bodies: Bodies, joint: int, ancestor: int) -> bool:
    return joint not in bodies.torso and ancestor in ancestors(bodies, joint)


def runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """Return the first frames and the ends of runs of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
