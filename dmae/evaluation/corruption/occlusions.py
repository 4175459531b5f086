"""Occlusion by bodies: the distance between each camera's line of sight to a joint and the bones in front of it."""

import numpy as np

from dmae.data.clip import Clip
from dmae.data.skeleton import Skeleton
from dmae.evaluation.corruption.corrupt import (
    by_detection,
    detections_of_people,
    heights,
    limb_of_joint,
    pixels_of_people,
    redetected,
    share_of_time,
    undetected,
    undetected_nearest,
)
from dmae.evaluation.corruption.registry import corruption

_POINTS = np.linspace(0, 1, 5)
"""Places along a bone, as shares of its length, at which its distance from a line of sight is taken."""
_TRUNK = ("hip", "shoulder", "neck")
_RADII = (0.05, 0.13)
"""m; half the thickness of a limb or head, and of the trunk."""
_AHEAD = 0.15
"""m; points that are nearer than this to a joint, along the line of sight, do not hide it."""
_APART = 3
"""A bone hides a joint of the same body if it is this many bones away."""


def clearance(centres: np.ndarray, joints: np.ndarray, bodies: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return distances (F, V, P, J), m, from the line of sight to each joint to the surface of the nearest other body.

    It is negative where a body hides the joint, NaN where the joint is unknown, and infinite where no body is known.

    Args:
        centres: (V, 3) camera centres, m, world.
        joints: (F, P, J, 3) joints to be seen, m.
        bodies: (F, B, J, 3) bodies that hide them, m.
        skeleton: Skeleton of the bodies.
    """
    points, radii = _surface(bodies, skeleton)
    flat = points.reshape(len(points), -1, 3)
    return _clearance(centres, joints, flat, np.tile(radii.ravel(), bodies.shape[1]))


def clearance_of_others(centres: np.ndarray, joints: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return `clearance` of the joints of each person (F, P, J, 3) from all other persons."""
    people = np.arange(joints.shape[1])
    parts = [clearance(centres, joints[:, [p]], joints[:, people != p], skeleton) for p in people]
    return np.concatenate(parts, 2) if parts else np.empty((len(joints), len(centres), 0, len(skeleton)))


def clearance_of_self(centres: np.ndarray, joints: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return `clearance` of the joints of each person (F, P, J, 3) from far parts of the same body."""
    far = _bones_between(skeleton) >= _APART  # (J, bones)
    points, radii = _surface(joints, skeleton)  # (F, P, bones, points, 3)
    parts = np.full((len(joints), len(centres), *joints.shape[1:3]), np.inf)
    for person in range(joints.shape[1]):
        for joint in range(len(skeleton)):
            bones = points[:, person, far[joint]].reshape(len(points), -1, 3)
            sight = joints[:, person : person + 1, joint : joint + 1]
            parts[:, :, person, joint] = _clearance(centres, sight, bones, radii[far[joint]].ravel())[:, :, 0, 0]
    return parts


def _surface(bodies: np.ndarray, skeleton: Skeleton) -> tuple[np.ndarray, np.ndarray]:
    """Return points (F, B, bones, points, 3) along the bones of bodies, and radii (bones, points), m."""
    start, end = np.array(skeleton.bones, int).reshape(-1, 2).T
    along = _POINTS[:, None]
    points = bodies[:, :, start, None] * (1 - along) + bodies[:, :, end, None] * along
    trunk = [all(any(part in skeleton.joints[i] for part in _TRUNK) for i in bone) for bone in skeleton.bones]
    return points, np.repeat(np.where(trunk, _RADII[1], _RADII[0])[:, None], len(_POINTS), 1)


def _clearance(centres: np.ndarray, joints: np.ndarray, points: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Return distances (F, V, P, J) from lines of sight to joints (F, P, J, 3) to points (F, N, 3), less radii (N,).

    Frames are processed one at a time, as there are many pairs of a line and a point.
    """
    frames, people, skeleton = joints.shape[:3]
    found = np.full((frames, len(centres), people * skeleton), np.inf)
    for frame in range(frames):
        known = ~np.isnan(points[frame]).any(-1)
        sight = joints[frame].reshape(1, -1, 3) - centres[:, None]  # (V, P J, 3)
        length = np.linalg.norm(sight, axis=-1)
        found[frame][np.isnan(length)] = np.nan
        if not known.any():
            continue
        to_point = points[frame][known] - centres[:, None]  # (V, N, 3)
        along = (sight / length[..., None]) @ to_point.swapaxes(1, 2)  # (V, P J, N)
        before = np.clip(along, 0, np.maximum(length - _AHEAD, 0)[..., None])
        square = (to_point**2).sum(-1)[:, None] + before * (before - 2 * along)
        found[frame] = (np.sqrt(np.maximum(square, 0)) - radii[known]).min(-1)
    return found.reshape(frames, len(centres), people, skeleton)


def _bones_between(skeleton: Skeleton) -> np.ndarray:
    """Return the number of bones between each joint and each bone, (J, bones); 0 if the joint is an end of the bone."""
    steps = np.full((len(skeleton), len(skeleton)), np.inf)
    np.fill_diagonal(steps, 0)
    for a, b in skeleton.bones:
        steps[a, b] = steps[b, a] = 1
    for middle in range(len(skeleton)):
        steps = np.minimum(steps, steps[:, [middle]] + steps[[middle]])
    start, end = np.array(skeleton.bones, int).reshape(-1, 2).T
    return np.minimum(steps[:, start], steps[:, end])


# Joints hidden behind objects.

_PILLARS = 6
_DRAWN = 40
"""Number of candidate places for pillars; the ones farthest from all people are used."""


@corruption("objects", order=10, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100)
def objects(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Joints hidden behind pillars that stand in the scene, % of the detected joints.

    Six round pillars from floor to ceiling stand between cameras and people, where people leave most room. All are as
    thick as it takes to hide that share of the joints. What a pillar hides is not detected.
    """
    centres, people = (clip.true_rig or clip.rig).centers[:, :2], clip.poses.xyz[..., :2].astype(np.float64)
    places = _places(centres, people, rng)
    if not len(places):
        return clip
    sight = people[:, None] - centres[:, None, None]  # (F, V, P, J, 2)
    length2 = np.maximum((sight**2).sum(-1), 1e-9)
    margin = np.full(length2.shape, np.inf)
    for place in places:
        to_place = place - centres
        along = np.clip(np.einsum("fvpjk,vk->fvpj", sight, to_place) / length2, 0, 1)
        margin = np.minimum(margin, np.linalg.norm(to_place[:, None, None] - along[..., None] * sight, axis=-1))
    return undetected_nearest(clip, by_detection(clip, np.where(np.isnan(length2), np.nan, margin)), level)


def _places(centres: np.ndarray, people: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the places of pillars, (N, 2) m, between cameras (V, 2) and people (F, P, J, 2)."""
    known = people[~np.isnan(people).any(-1)]
    cameras, joints = rng.integers(len(centres), size=_DRAWN), rng.random(_DRAWN)
    along = rng.uniform(0.2, 0.8, (_DRAWN, 1))
    if not len(known):
        return np.empty((0, 2))
    places = centres[cameras] * (1 - along) + known[(joints * len(known)).astype(int)] * along
    room = [np.linalg.norm(known - place, axis=-1).min() for place in places]
    return places[np.argsort(room)[-_PILLARS:]]


# Joints hidden behind other people.

_DISTANCE = 0.8
"""m; distance of a passer-by from the person."""
_TURN = 8.0
"""s; time in which a passer-by walks once around the person."""


@corruption("persons", order=11, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100)
def persons(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Joints hidden behind other people, % of the detected joints.

    The other people are those of the clip, and for each person a passer-by who walks around at 0.8 m. All are as thick
    as it takes to hide that share of the joints. What a body hides is not detected, nor are passers-by.
    """
    people, skeleton = clip.poses.xyz.astype(np.float64), clip.poses.skeleton
    count = people.shape[1]
    angle = 2 * np.pi * (rng.random(count) + np.arange(len(clip))[:, None] / (clip.fps * _TURN))
    around = [companion(people, person, _DISTANCE, angle[:, person], 0) for person in range(count)]
    everyone = np.concatenate([people, *(body[:, None] for body in around)], 1)
    margin = clearance_of_others((clip.true_rig or clip.rig).centers, everyone, skeleton)[:, :, :count]
    return undetected_nearest(clip, by_detection(clip, margin), level)


# Joints hidden behind the person's own body.


@corruption("own_body", order=12, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100)
def own_body(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Joints hidden behind the person's own body, % of the detected joints.

    Limbs and trunk are as thick as it takes to hide that share of the joints. What they hide is not detected. Nothing
    is drawn at random.
    """
    centres, people = (clip.true_rig or clip.rig).centers, clip.poses.xyz.astype(np.float64)
    return undetected_nearest(clip, by_detection(clip, clearance_of_self(centres, people, clip.poses.skeleton)), level)


# Joints outside the image.


@corruption("edges", order=13, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100)
def edges(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Joints outside the image, % of the detected joints.

    The images of all cameras are cut on all four sides, by the same share of their size, until this share of joints is
    outside. Nothing is drawn at random.
    """
    half = clip.rig.size[:, None, None] / 2
    return undetected_nearest(clip, (1 - np.abs(clip.detections.xy - (half - 0.5)) / half).min(-1), level)


# Limbs that no camera sees for a while.

_TIMES = (1.0, 0.2)
"""s; correlation times of the bursts, mixed half and half."""


@corruption("bursts", order=14, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100)
def bursts(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Limbs that no camera detects, % of the time, in bursts of tenths of a second to seconds.

    An arm, a leg, the head or the trunk of a person is missed by all cameras at the same time.
    """
    limb = limb_of_joint(clip.poses.skeleton)
    shape = (clip.poses.xyz.shape[1], limb.max(initial=-1) + 1)
    events = share_of_time(clip, shape, level, _TIMES, rng=rng)[..., limb]
    everywhere = np.broadcast_to(events[:, None], (len(clip), len(clip.rig), *events.shape[1:]))
    return undetected(clip, by_detection(clip, everywhere, False))


# Copies of a clip's own people, moved in the world and in time.


def companion(people: np.ndarray, person: int, distance: float, angle: np.ndarray | float, delay: int) -> np.ndarray:
    """Return a copy (F, J, 3) of a person, at a constant distance from that person.

    Args:
        people: (F, P, J, 3) m, world, z up.
        person: Index of the copied person.
        distance: m, horizontal distance between the middles of both bodies.
        angle: rad, direction of the copy from the person, (F,) or constant.
        delay: Frames by which the copy is delayed; at the ends of the clip its motion is reversed.
    """
    copy = people[delayed(len(people), delay), person]
    to = np.stack([np.cos(angle), np.sin(angle)], -1) * distance
    copy = copy.copy()
    copy[..., :2] += (_middle(people[:, person]) - _middle(copy) + to)[:, None]
    return copy


def delayed(frames: int, delay: int) -> np.ndarray:
    """Return for each of F frames the index of the frame `delay` earlier, reflected at the ends."""
    period = max(2 * (frames - 1), 1)
    index = (np.arange(frames) - delay) % period
    return np.minimum(index, period - index)


def with_companions(clip: Clip, bodies: np.ndarray, copied: list[int], delays: list[int]) -> Clip:
    """Return the clip with detections of additional people, which hide others and are hidden by them.

    A joint of a copy is detected as the same joint of the copied person at the copied time: with the same error, in
    proportion to the height in the image, and the same confidence, or not at all. Joints behind any other body
    or outside the image are not detected.

    Args:
        bodies: (F, B, J, 3) the copies, m.
        copied: (B,) index of the person that each body copies.
        delays: (B,) frames by which each body is delayed.
    """
    rig, skeleton = clip.true_rig or clip.rig, clip.poses.skeleton
    people, count = clip.poses.xyz.astype(np.float64), clip.poses.xyz.shape[1]
    everyone = np.concatenate([people, bodies], 1)
    hidden = clearance_of_others(rig.centers, everyone, skeleton)[:, :, count:] < 0
    newly = by_detection(clip, clearance(rig.centers, people, bodies, skeleton) < 0, False)
    error, score = _errors(clip)
    pixels = rig.project(bodies)[0]
    frames = np.stack([delayed(len(clip), delay) for delay in delays], 1)  # (F, B)
    error, score = (np.stack([e[frames[:, b], :, p] for b, p in enumerate(copied)], 2) for e in (error, score))
    pixels = pixels + error * heights(pixels)[..., None, None]
    score = np.where(hidden | ~rig.inside(pixels), np.nan, score)
    found = clip.detections
    kept = np.where(newly, np.nan, found.score)
    return redetected(clip, np.concatenate([found.xy, pixels], 2), np.concatenate([kept, score], 2))


def _errors(clip: Clip) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors (F, V, P, J, 2) of the detections of people, in their heights, and confidences (F, V, P, J)."""
    shown, pixels = detections_of_people(clip), pixels_of_people(clip)
    taken = np.maximum(shown, 0)
    if not clip.detections.score.shape[2]:
        return np.full(pixels.shape, np.nan), np.full(pixels.shape[:-1], np.nan)
    xy = np.take_along_axis(clip.detections.xy, taken[..., None, None], 2)
    score = np.take_along_axis(clip.detections.score, taken[..., None], 2)
    height = heights(pixels)
    error = (xy - pixels) / np.where(height > 0, height, np.nan)[..., None, None]
    return error, np.where((shown < 0)[..., None], np.nan, score)


def _middle(body: np.ndarray) -> np.ndarray:
    """Return the middle (F, 2) of the box around a body (F, J, 3), seen from above, m; NaN where it is absent."""
    known = ~np.isnan(body[..., :2])
    low = np.where(known, body[..., :2], np.inf).min(1)
    high = np.where(known, body[..., :2], -np.inf).max(1)
    return np.where(known.any(1), (np.where(known.any(1), low, 0) + np.where(known.any(1), high, 0)) / 2, np.nan)


# Additional people, and people at a small distance from each other.

_crowd_DRAWN = 32
"""Number of people that are drawn. The first ones are added, so that a higher level only adds people."""
_crowd_DISTANCE = (1.0, 2.0)
"""m; distance of an added person from the copied person."""
_DELAY = (0.5, 2.0)
"""s; delay of the motion of an added person."""


@corruption("crowd", order=1, unit="people more", levels=(1, 2, 4, 8), small=(1, 4), most=32, whole=True)
def crowd(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """People added, who each keep 1 to 2 m from one of the clip's people.

    An added person is a copy of one of the clip's people, moved in the world and delayed in time. It is detected as
    well as the one copied was; what stands behind another body is not detected. Added people have no truth and are not
    scored.
    """
    angle, distance = rng.uniform(0, 2 * np.pi, _crowd_DRAWN), rng.uniform(*_crowd_DISTANCE, _crowd_DRAWN)
    delay = np.rint(rng.uniform(*_DELAY, _crowd_DRAWN) * clip.fps).astype(int)
    return _with_people(clip, distance[: int(level)], angle, delay)


@corruption("closeness", order=2, unit="1/m", levels=(0.5, 1, 2, 4), small=(1, 4))
def closeness(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """How close an added person keeps to each of the clip's people: 2 is half a metre, between the middles of bodies.

    People are added as with `crowd`.
    """
    people = clip.poses.xyz.shape[1]
    delay = np.rint(rng.uniform(*_DELAY, people) * clip.fps).astype(int)
    return _with_people(clip, np.full(people, 1 / level), rng.uniform(0, 2 * np.pi, people), delay)


def _with_people(clip: Clip, distance: np.ndarray, angle: np.ndarray, delay: np.ndarray) -> Clip:
    """Return the clip with additional copies of its people, one for each distance, m; the people are copied in turn."""
    people = clip.poses.xyz.astype(np.float64)
    if not people.shape[1]:
        return clip
    copied = [number % people.shape[1] for number in range(len(distance))]
    drawn = zip(copied, distance, angle, delay, strict=False)
    bodies = np.stack([companion(people, *each) for each in drawn], 1)
    return with_companions(clip, bodies, copied, delay[: len(copied)].tolist())
