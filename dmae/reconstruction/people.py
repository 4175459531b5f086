"""People: which tracks are one person, which are nobody, and which are wanted."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import pairwise, permutations

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from dmae.data.skeleton import Skeleton
from dmae.files.mapped import by_frames, frame_blocks
from dmae.numerics.body import bone_lengths, symmetric_bone_lengths
from dmae.numerics.statistics import evenly_spaced, median_known, median_over_frames
from dmae.reconstruction.appearance import appearance_differs, has_appearance
from dmae.reconstruction.association import NONE
from dmae.reconstruction.chance import passing_ghosts, resting_ghosts, surprise
from dmae.reconstruction.config import CaptureConfig, SubjectConfig
from dmae.reconstruction.evidence import Evidence
from dmae.reconstruction.noise import DetectionNoise
from dmae.reconstruction.tracking import Tracks

_DUPLICATE_TRACK_DISTANCE = 0.15  # m; two tracks with a smaller median distance of their joints are one person
_DISTANCE_FROM_EXIT, _WALKING_SPEED = 0.5, 1.5  # m and m/s: largest distance of a re-entry from the place of exit
_BUILD_DIFFERENCE, _BRIEF_S, _BRIEF_DIFFERENCE = 0.15, 1.0, 0.2
"""Relative difference of bone lengths above which two tracks belong to different people; s for which a track has to be
seen for that; and the difference for briefer ones, whose lengths are less certain."""


def steps_to_people(
    clip: Clip, tracks: Tracks, config: CaptureConfig, noise: DetectionNoise, alone: bool = False
) -> Iterator[tuple[str, Tracks]]:
    """Yield what is left of tracks after each step, by its name: people, volume, duration, chance, agreement, motion,
    wanted.

    Raises as `wanted_people`.

    Args:
        alone: All frames show the same still, so that frames after the first do not speak against chance, and a few
            joints do not show whether views agree.
    """
    skeleton, fps, tracking = clip.detections.skeleton, clip.fps, config.tracking
    differs = partial(appearance_differs, clip, tracks.assigned) if has_appearance(clip, config) else None
    tracks = merge(tracks, same_person(tracks.xyz, skeleton, fps, tracking.reentry_s, differs))
    yield "people", tracks
    if config.volume is not None:
        tracks = inside_volume(tracks, config.volume)
        tracks = tracks.select(np.any(known_joints(tracks.xyz) > 0, 0))
        yield "volume", tracks
    measured, surprises = well_measured(tracks, tracking.births(len(skeleton))).sum(1, dtype=float)
    lasting = ~too_brief(measured, len(clip), fps, tracking.min_duration_s)
    tracks = tracks.select(lasting)
    yield "duration", tracks
    if not alone:
        passing = passing_ghosts(measured[lasting], surprises[lasting], len(clip), tracking.max_by_chance)
        tracks = tracks.select(~passing)
        yield "chance", tracks
        tracks = tracks.select(~coincidental(clip, tracks, config, noise))
        yield "agreement", tracks
    tracks = tracks.select(~resting_ghosts(clip, tracks.assigned, tracks.xyz, config, noise))
    yield "motion", tracks
    yield "wanted", wanted_people(tracks, clip.rig, skeleton, fps, config)


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
    present = known_joints(xyz) > 0
    label = np.arange(xyz.shape[1])
    lengths = symmetric_bone_lengths(xyz, skeleton)
    reentries = []
    for a, b in permutations(np.flatnonzero(present.any(0)).tolist(), 2):
        both = present[:, a] & present[:, b]
        last, first = np.flatnonzero(present[:, a])[-1], np.flatnonzero(present[:, b])[0]
        if both.any():
            if a < b:
                apart = np.linalg.norm(xyz[both, a] - xyz[both, b], axis=-1)
                if median_over_frames(apart.ravel()) < _DUPLICATE_TRACK_DISTANCE:
                    _join(label, a, b)
        elif 0 < first - last <= reentry_s * fps:
            # Use the horizontal distance: the last visible joints may be feet, and the first ones a head.
            distance = np.linalg.norm(
                median_over_frames(xyz[last, a, :, :2]) - median_over_frames(xyz[first, b, :, :2])
            )
            reach = _DISTANCE_FROM_EXIT + _WALKING_SPEED * (first - last) / fps
            brief = present[:, [a, b]].sum(0).min() < _BRIEF_S * fps
            # Lengths that share no bone do not differ.
            differ = median_over_frames(np.abs(lengths[a] - lengths[b]) / np.maximum(lengths[a], lengths[b]))
            if distance < reach and not differ >= (_BRIEF_DIFFERENCE if brief else _BUILD_DIFFERENCE):
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
    assigned, xyz, chance = merged.assigned, merged.xyz, merged.chance
    for track in np.flatnonzero(label != np.arange(len(label))):
        person = np.searchsorted(persons, label[track])
        for part in frame_blocks(assigned, xyz, tracks.assigned, tracks.xyz):
            here, other = (part, person), (part, track)
            assigned[here] = np.where(assigned[here] == NONE, tracks.assigned[other], assigned[here])
            xyz[here] = np.where(np.isnan(xyz[here]), tracks.xyz[other], xyz[here])
        chance[:, person] = np.minimum(chance[:, person], tracks.chance[:, track])
    return merged


def _join(label: np.ndarray, a: int, b: int) -> None:
    low, high = sorted((label[a], label[b]))
    label[label == high] = low


_MIN_AGREEMENT = 0.75
"""Smallest share of joints on which the views agree, among the joints that enough views detected. People have
more than 0.9, ghosts that line up by coincidence about 0.5."""
_JUDGED_FRAMES = 50  # Largest number of frames in which doubtful tracks are triangulated again


def known_joints(xyz: np.ndarray) -> np.ndarray:
    """Return the number (F, P) of joints (F, P, J, 3) that are known."""
    return by_frames(lambda xyz: (~np.isnan(xyz[..., 0])).sum(-1), xyz)


def well_measured(tracks: Tracks, joints: int) -> np.ndarray:
    """Return (2, F, P) 1 where a person has at least this number of joints, and how little that looks like chance
    (`dmae.reconstruction.chance.surprise`); else 0."""
    measured = known_joints(tracks.xyz) >= joints
    return np.stack([measured, surprise(tracks.chance, measured)])


def too_brief(measured: np.ndarray, frames: int, fps: float, min_duration_s: float) -> np.ndarray:
    """Return (P,) True for tracks measured in fewer frames than the shortest duration or half the recording.

    Args:
        measured: (P,) numbers of frames in which each track was measured.
        frames: Number of frames of the recording.
    """
    return measured < min(min_duration_s * fps, frames / 2)


def coincidental(clip: Clip, tracks: Tracks, config: CaptureConfig, noise: DetectionNoise) -> np.ndarray:
    """Return (P,) True for tracks of detections that belong to different figures and line up by coincidence.

    Views agree on nearly all joints of a person that enough of them detect. Some of these joints may be absent because
    they are not precise enough, as of a person seen by two cameras whose calibration is off; so doubtful tracks are
    triangulated again, however imprecisely.
    """
    detected = by_frames(lambda assigned: ((assigned != NONE).sum(2) >= config.th_v).sum(-1), tracks.assigned).sum(0)
    doubtful = known_joints(tracks.xyz).sum(0) < _MIN_AGREEMENT * detected
    imprecise = replace(config, noise=replace(config.noise, max_error_m=np.inf))
    for person in np.flatnonzero(doubtful):
        enough = by_frames(
            lambda assigned: ((assigned != NONE).sum(1) >= config.th_v).sum(-1), tracks.assigned[:, person]
        )
        frames = np.flatnonzero(enough)
        frames = frames[evenly_spaced(len(frames), _JUDGED_FRAMES)]
        evidence = Evidence.of(clip, config.th_p, imprecise, frames, noise)
        agreed = known_joints(evidence.triangulate(tracks.assigned[frames, person][:, None]).xyz)
        doubtful[person] = agreed.sum() < _MIN_AGREEMENT * enough[frames].sum()
    return doubtful


_LINK_BUILD = 0.1  # Relative difference of bone lengths above which two tracks are never linked to one person
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
        np.where(outside, np.inf, tracks.chance),
    )


def wanted_people(tracks: Tracks, rig: CameraRig, skeleton: Skeleton, fps: float, config: CaptureConfig) -> Tracks:
    """Return the tracks of the people that `config.persons` and `config.subject` ask for, in the order of their births.

    The whole recording decides: the people measured most, by joints times frames, are kept. If there are more tracks
    than requested people, tracks that follow each other, of the same build and within reach, are linked first.

    Raises ValueError if the subject cannot be found; the message states the places of people.
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
    measured = known_joints(tracks.xyz).sum(0)
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
    assert subject.at is not None
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
    """Return (P,) for each track the lowest index of the tracks linked with it, until so many people are left.

    The link with the most similar bone lengths comes first; with `only`, links of that track's person alone.
    """
    label, present = np.arange(xyz.shape[1]), known_joints(xyz) > 0
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
    for last, first in pairwise(frames):
        if owner[last] != owner[first]:
            ends = [
                median_known(xyz[frame][a if owner[frame] == 0 else b].reshape(-1, 3))[:2] for frame in (last, first)
            ]
            if np.linalg.norm(ends[0] - ends[1]) > _LINK_DISTANCE + _LINK_SPEED * (first - last) / fps:
                return None
    return float(difference)
