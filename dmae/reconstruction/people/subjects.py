"""Selection of captured people: the people in a volume, a number of people, or one subject."""

import itertools

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.skeleton import Skeleton
from dmae.files.mapped import by_frames, total
from dmae.numerics.body import bone_lengths, symmetric_bone_lengths
from dmae.numerics.statistics import median_known, median_over_frames
from dmae.reconstruction.association import NONE
from dmae.reconstruction.config import CaptureConfig, SubjectConfig
from dmae.reconstruction.merging import merge
from dmae.reconstruction.tracks import Tracks

_LINK_BUILD = 0.1
"""Relative difference of bone lengths above which two tracks are never linked to one person."""
_LINK_DISTANCE, _LINK_SPEED = 0.5, 2.0
"""m and m/s: largest distance from the end of a track to the start of another track of the same person."""
_NEAR_SUBJECT_M, _NEAR_SUBJECT = 1.0, 0.1
"""m, and diagonals of the image: largest distance of the subject from the given place."""


def inside_volume(tracks: Tracks, volume: list[float] | None) -> Tracks:
    """Return tracks without the frames in which the middle of the person is outside a box.

    Args:
        volume: x, y, z of one corner and of the opposite one, m; None for no box.
    """
    if volume is None or not tracks.xyz.size:
        return tracks
    corners = np.sort(np.reshape(volume, (2, 3)), 0)
    middle = by_frames(median_known, tracks.xyz)
    with np.errstate(invalid="ignore"):
        outside = ~((middle >= corners[0]) & (middle <= corners[1])).all(-1)
    absent = outside[..., None, None]
    return Tracks(
        by_frames(lambda absent, assigned: np.where(absent, np.int16(NONE), assigned), absent, tracks.assigned),
        by_frames(lambda absent, xyz: np.where(absent, np.nan, xyz), absent, tracks.xyz),
        tracks.supported & ~outside,
    )


def wanted_people(tracks: Tracks, rig: CameraRig, skeleton: Skeleton, fps: float, config: CaptureConfig) -> Tracks:
    """Return the tracks of the people that `config.persons` and `config.subject` ask for, in the order of their births.

    The whole recording decides: the people measured most, by joints times frames, are kept. If there are more tracks
    than requested people, tracks that follow each other, of the same build and within reach, are linked first.

    Raises:
        ValueError: the subject cannot be found; the message states the places of people.
    """
    subject = config.subject
    if subject.leg_m is not None:
        legs = leg_lengths(tracks.xyz, skeleton)
        with np.errstate(invalid="ignore"):
            tracks = tracks.select((legs >= subject.leg_m[0]) & (legs <= subject.leg_m[1]))
    persons = config.persons
    if subject.at is not None:
        person = _person_at(tracks.xyz, rig, subject)
        label = _linked(tracks.xyz, skeleton, fps, 1, person)
        return merge(tracks, label).select(np.unique(label) == label[person])
    if persons is None or tracks.xyz.shape[1] <= persons:
        return tracks
    tracks = merge(tracks, _linked(tracks.xyz, skeleton, fps, persons))
    measured = total(lambda xyz: (~np.isnan(xyz[..., 0])).sum(-1), tracks.xyz)
    return tracks.select(np.sort(np.argsort(-measured, kind="stable")[:persons]))


def leg_lengths(xyz: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return the length from hip to knee to ankle of people (F, P, J, 3), (P,) m; NaN where no leg was measured."""
    joints = {f"{side}_{joint}" for side in "lr" for joint in ("hip", "knee", "ankle")}
    if not joints <= set(skeleton.joints):
        raise ValueError(f"subject.leg_m: skeleton {skeleton.name!r} lacks {', '.join(sorted(joints))}; leave it out")
    sides = [skeleton.index(*(f"{side}_{joint}" for joint in ("hip", "knee", "ankle"))) for side in "lr"]
    legs = [bone_lengths(xyz, [(hip, knee), (knee, ankle)]) for hip, knee, ankle in sides]
    thigh, shank = (median_over_frames(np.concatenate([leg[..., bone] for leg in legs])) for bone in (0, 1))
    return thigh + shank


def _person_at(xyz: np.ndarray, rig: CameraRig, subject: SubjectConfig) -> int:
    """Return the index of the person at the given place."""
    frame, *place = subject.at
    if frame != int(frame) or not 0 <= frame < len(xyz):
        raise ValueError(f"subject.at={subject.at}: expected a frame from 0 to {len(xyz) - 1}, found {frame:g}")
    joints = xyz[int(frame)]
    if subject.camera is None:
        where, reach = median_known(joints)[:, :2], _NEAR_SUBJECT_M
        unit = "m"
    else:
        if subject.camera not in rig.names:
            raise ValueError(f"subject.camera={subject.camera}: expected one of {', '.join(rig.names)}")
        view = rig.names.index(subject.camera)
        where = median_known(rig.project(joints[None])[0][0, view])
        reach, unit = _NEAR_SUBJECT * float(np.hypot(*rig.size[view])), "px"
    distance = np.linalg.norm(where - place, axis=-1)
    distance = np.where(np.isnan(distance), np.inf, distance)
    if not distance.size or distance.min() > reach:
        there = "; ".join(f"({x:.2f}, {y:.2f})" for x, y in where[np.isfinite(where).all(-1)]) or "no place"
        raise ValueError(
            f"subject.at={subject.at}: found no person within {reach:.3g} {unit} of it in that frame; people are at "
            f"{there} {unit}"
        )
    return int(distance.argmin())


def _linked(xyz: np.ndarray, skeleton: Skeleton, fps: float, persons: int, only: int | None = None) -> np.ndarray:
    """Return (P,) for each track the lowest index of the tracks linked with it; links stop at a given number of people.

    The possible link with the most similar bone lengths comes first.

    Args:
        only: A track; only links with its person are made.
    """
    label, present = np.arange(xyz.shape[1]), by_frames(lambda xyz: ~np.isnan(xyz[..., 0]).all(-1), xyz)
    lengths = symmetric_bone_lengths(xyz, skeleton)
    while len(np.unique(label)) > persons:
        links = []
        groups = [np.flatnonzero(label == name) for name in np.unique(label)]
        for i, a in enumerate(groups):
            for b in groups[i + 1 :]:
                if only is not None and only not in a and only not in b:
                    continue
                cost = _link_cost(xyz, present, lengths, a, b, fps)
                if cost is not None:
                    links.append((cost, a[0], b[0]))
        if not links:
            break
        _, a, b = min(links)
        label[label == b] = a
    return label


def _link_cost(
    xyz: np.ndarray, present: np.ndarray, lengths: np.ndarray, a: np.ndarray, b: np.ndarray, fps: float
) -> float | None:
    """Return the difference in build of two groups of tracks; None if they cannot belong to one person."""
    here, there = present[:, a].any(1), present[:, b].any(1)
    if not here.any() or not there.any() or (here & there).any():
        return None
    build = [median_over_frames(lengths[group]) for group in (a, b)]
    difference = median_over_frames(np.abs(build[0] - build[1]) / np.maximum(*build))
    if not difference < _LINK_BUILD:
        return None
    # Every change from one group to the other must be within reach.
    owner = np.where(here, 0, np.where(there, 1, -1))
    frames = np.flatnonzero(owner >= 0)
    for last, first in itertools.pairwise(frames):
        if owner[last] != owner[first]:
            ends = [
                median_known(xyz[frame][a if owner[frame] == 0 else b].reshape(-1, 3))[:2] for frame in (last, first)
            ]
            if np.linalg.norm(ends[0] - ends[1]) > _LINK_DISTANCE + _LINK_SPEED * (first - last) / fps:
                return None
    return float(difference)
