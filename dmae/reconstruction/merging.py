"""Merging: the tracks of one person become one track, if they are duplicates or the person re-entered."""

from collections.abc import Callable
from itertools import permutations

import numpy as np

from dmae.data.skeleton import Skeleton
from dmae.files.mapped import by_frames, frame_blocks
from dmae.numerics.body import symmetric_bone_lengths
from dmae.numerics.statistics import median_over_frames
from dmae.reconstruction.association import NONE
from dmae.reconstruction.tracks import Tracks

_DUPLICATE_DISTANCE = 0.15
"""m; two tracks with a smaller median distance between their joints belong to one person."""
_REENTRY_DISTANCE, _WALKING_SPEED = 0.5, 1.5
"""m and m/s: largest distance of a re-entry from the place of exit."""
_BUILD_DIFFERENCE = 0.15
"""Relative difference of bone lengths above which two tracks belong to different people."""


def same_person(
    xyz: np.ndarray,
    skeleton: Skeleton,
    fps: float,
    reentry_s: float,
    appearance_differs: Callable[[], np.ndarray] | None = None,
) -> np.ndarray:
    """Find the tracks that belong to one person.

    Duplicates are two tracks that are at one place while both exist. A re-entry is a track that starts after another
    has ended, within `reentry_s` and the distance walked in that time, with bones of the same lengths and clothes of
    the same colour. The nearest re-entries are merged first, and no person is in two places at the same time.

    Args:
        xyz: (F, P, J, 3) m, NaN where absent.
        reentry_s: Longest absence, s.
        appearance_differs: Returns (P, P) True where the clothes of two tracks differ; None without images. It is
            called only if there are candidates for a re-entry.

    Returns:
        (P,) for each track, the lowest index of the tracks of its person.
    """
    present = by_frames(lambda xyz: ~np.isnan(xyz[..., 0]).all(-1), xyz)
    label = np.arange(xyz.shape[1])
    lengths = symmetric_bone_lengths(xyz, skeleton)
    reentries = []
    for a, b in permutations(np.flatnonzero(present.any(0)), 2):
        both = present[:, a] & present[:, b]
        last, first = np.flatnonzero(present[:, a])[-1], np.flatnonzero(present[:, b])[0]
        if both.any():
            if a < b and _median_distance(xyz[both, a], xyz[both, b]) < _DUPLICATE_DISTANCE:
                _join(label, a, b)
        elif 0 < first - last <= reentry_s * fps:
            # Use the horizontal distance: the last visible joints may be feet, and the first ones a head.
            distance = np.linalg.norm(
                median_over_frames(xyz[last, a, :, :2]) - median_over_frames(xyz[first, b, :, :2])
            )
            reach = _REENTRY_DISTANCE + _WALKING_SPEED * (first - last) / fps
            if distance < reach and _same_build(lengths[a], lengths[b]):
                reentries.append((distance, a, b))
    differs = appearance_differs() if appearance_differs and reentries else np.zeros((len(label), len(label)), bool)
    for _, a, b in sorted(reentries):
        at_once = present[:, label == label[a]].any(1) & present[:, label == label[b]].any(1)
        if not differs[a, b] and not at_once.any():
            _join(label, a, b)
    return label


def merge(tracks: Tracks, label: np.ndarray) -> Tracks:
    """Return one track per person. Among duplicates, the older track is used for each joint that it has.

    Args:
        label: (P,) as `same_person` returns it.
    """
    persons = np.unique(label)
    if len(persons) == len(label):
        return tracks
    merged = tracks.select(persons)
    assigned, xyz, supported = merged.assigned, merged.xyz, merged.supported
    for track in np.flatnonzero(label != np.arange(len(label))):
        person = np.searchsorted(persons, label[track])
        for part in frame_blocks(assigned, xyz, tracks.assigned, tracks.xyz):
            here, other = (part, person), (part, track)
            assigned[here] = np.where(assigned[here] == NONE, tracks.assigned[other], assigned[here])
            xyz[here] = np.where(np.isnan(xyz[here]), tracks.xyz[other], xyz[here])
        supported[:, person] |= tracks.supported[:, track]
    return merged


def _join(label: np.ndarray, a: int, b: int) -> None:
    """Give the tracks of two persons one label."""
    low, high = sorted((label[a], label[b]))
    label[label == high] = low


def _median_distance(a: np.ndarray, b: np.ndarray) -> float:
    """Return the median distance between the joints (F, J, 3) of two persons, m; NaN if they share none."""
    return float(median_over_frames(np.linalg.norm(a - b, axis=-1).ravel()))


def _same_build(a: np.ndarray, b: np.ndarray) -> bool:
    """Return whether bone lengths (B,) differ little, or share no bone."""
    difference = median_over_frames(np.abs(a - b) / np.maximum(a, b))
    return not difference >= _BUILD_DIFFERENCE
