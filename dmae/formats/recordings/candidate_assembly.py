"""Assemble 2D skeletons from joint candidates and part affinities."""

from collections.abc import Sequence
from itertools import chain

import numpy as np

BODY25_LINKS = (
    (1, 8), (9, 10), (10, 11), (8, 9), (8, 12), (12, 13), (13, 14), (1, 2), (2, 3), (3, 4), (2, 17), (1, 5), (5, 6),
    (6, 7), (5, 18), (1, 0), (0, 15), (0, 16), (15, 17), (16, 18), (14, 19), (19, 20), (14, 21), (11, 22), (22, 23),
    (11, 24),
)  # fmt: skip
"""Joint pairs of BODY_25 with a part affinity field in OpenPose, in OpenPose's order.

The pairs of shoulder and ear, (2, 17) and (5, 18), close loops: they connect the head to the body if the nose is
hidden.
"""

_MIN_AFFINITY = 0.05
"""Links with a smaller affinity are ignored. This is OpenPose's own threshold."""


def assemble(
    counts: Sequence[int], affinities: Sequence[np.ndarray], links: Sequence[tuple[int, int]] = BODY25_LINKS
) -> np.ndarray:
    """Join the candidates of one image into skeletons.

    This is Kruskal's algorithm on the graph of candidates. It takes links from the strongest to the weakest. Each link
    joins two parts of a skeleton, unless both parts contain the same joint. Links may form loops, the order of joints
    does not matter, and incomplete skeletons are kept.

    Args:
        counts: Numbers of candidates of the J joints.
        affinities: One (n_a, n_b) array of affinities in [0, 1] for each of `links`.
        links: Pairs (a, b) of joints.

    Returns:
        (D, J) index of the candidate for each joint of each skeleton; -1 if there is none. A candidate without links
        is a skeleton of one joint. Skeletons with more joints come first.
    """
    first = np.concatenate([[0], np.cumsum(counts)]).astype(int)
    total = int(first[-1])
    joint = np.repeat(np.arange(len(counts)), counts)
    skeleton = list(range(total))
    members = [[candidate] for candidate in range(total)]
    joints = [1 << j for j in joint.tolist()]
    for a, b in _strong_links(first, affinities, links):
        into, gone = skeleton[a], skeleton[b]
        if joints[into] & joints[gone]:
            continue
        if len(members[into]) < len(members[gone]):
            into, gone = gone, into
        for candidate in members[gone]:
            skeleton[candidate] = into
        members[into] += members[gone]
        joints[into] |= joints[gone]
        members[gone], joints[gone] = [], 0
    found = sorted(filter(None, members), key=len, reverse=True)
    assembled = np.full((len(found), len(counts)), -1)
    candidate = np.array(list(chain.from_iterable(found)), int)
    row, column = np.repeat(np.arange(len(found)), [len(candidates) for candidates in found]), joint[candidate]
    assembled[row, column] = candidate - first[column]
    return assembled


def _strong_links(first: np.ndarray, affinities: Sequence[np.ndarray], links: Sequence[tuple[int, int]]):
    """Return pairs of candidates, strongest affinity first. Candidates are numbered across all joints."""
    flat = np.concatenate([affinity.ravel() for affinity in affinities])
    strong = np.flatnonzero(flat > _MIN_AFFINITY)
    strong = strong[np.argsort(-flat[strong], kind="stable")]
    offsets = np.cumsum([0, *(affinity.size for affinity in affinities)])
    link = offsets.searchsorted(strong, side="right") - 1
    side_a, side_b = np.asarray(links)[link].T
    row, column = np.divmod(strong - offsets[link], (first[side_b + 1] - first[side_b]))
    return zip((first[side_a] + row).tolist(), (first[side_b] + column).tolist(), strict=True)
