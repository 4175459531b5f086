"""The corruptions: what hides joints, people who are added, errors of a detector, and what a recording lacks."""

from dataclasses import replace

import cv2
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import shortest_path

from dmae.data.clip import Clip
from dmae.data.skeleton import Skeleton
from dmae.evaluation.corruption.corrupt import (
    by_detection,
    detections_of_people,
    given_people,
    heights,
    limb_of_joint,
    middle,
    people_of_detections,
    pixels_of_people,
    redetected,
    share_of_time,
    taken,
    undetected,
    undetected_nearest,
)
from dmae.evaluation.corruption.registry import corruption
from dmae.formats.reading import shift_views
from dmae.numerics import noise

# What hides joints from cameras: objects, other people, the own body, edges of the image; and people who are added.

_PILLARS = 6
_CANDIDATES = 40  # Number of candidate places for pillars; the ones farthest from all people are used
_AROUND = 0.8  # m; distance of a passer-by from the person
_TURN = 8.0  # s; time in which a passer-by walks once around the person
_ADDED = 32
"""Number of people that are drawn for a crowd. The first ones are added, so that a higher level only adds people."""
_DISTANCE = (1.0, 2.0)  # m; distance of a person of the crowd from the copied person
_DELAY = (0.5, 2.0)  # s; delay of the motion of an added person
_POINTS = np.linspace(0, 1, 5)
"""Places along a bone, as shares of its length, at which its distance from a line of sight is taken."""
_TRUNK = ("hip", "shoulder", "neck")
_RADII = (0.05, 0.13)  # m; half the thickness of a limb or head, and of the trunk
_AHEAD = 0.15  # m; points that are nearer than this to a joint, along the line of sight, do not hide it
_APART = 3  # A bone hides a joint of the same body if it is this many bones away


@corruption("objects", order=10, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100)
def objects(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Joints hidden behind pillars that stand in the scene, % of the detected joints.

    Six round pillars from floor to ceiling stand between cameras and people, where people leave most room. All are as
    thick as it takes to hide that share of the joints. What a pillar hides is not detected.
    """
    centres, people = clip.actual_rig.centers[:, :2], given_people(clip).xyz[..., :2].astype(np.float64)
    known = people[~np.isnan(people).any(-1)]
    if not len(known):
        return clip
    cameras, joints = rng.integers(len(centres), size=_CANDIDATES), rng.random(_CANDIDATES)
    along = rng.uniform(0.2, 0.8, (_CANDIDATES, 1))
    places = centres[cameras] * (1 - along) + known[(joints * len(known)).astype(int)] * along
    room = [np.linalg.norm(known - place, axis=-1).min() for place in places]
    sight = people[:, None] - centres[:, None, None]  # (F, V, P, J, 2)
    length2 = np.maximum((sight**2).sum(-1), 1e-9)
    margin = np.full(length2.shape, np.inf)
    for place in places[np.argsort(room)[-_PILLARS:]]:
        to_place = place - centres
        along = np.clip(np.einsum("fvpjk,vk->fvpj", sight, to_place) / length2, 0, 1)
        margin = np.minimum(margin, np.linalg.norm(to_place[:, None, None] - along[..., None] * sight, axis=-1))
    return undetected_nearest(clip, by_detection(clip, np.where(np.isnan(length2), np.nan, margin)), level)


@corruption("persons", order=11, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100)
def persons(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Joints hidden behind other people, % of the detected joints.

    They are people of the clip and, for each person, a passer-by who walks around at 0.8 m. All are as thick
    as it takes to hide that share of the joints. What a body hides is not detected, nor are passers-by.
    """
    people, skeleton = given_people(clip).xyz.astype(np.float64), given_people(clip).skeleton
    count = people.shape[1]
    angle = 2 * np.pi * (rng.random(count) + np.arange(len(clip))[:, None] / (clip.fps * _TURN))
    around = [companion(people, person, _AROUND, angle[:, person], 0) for person in range(count)]
    everyone = np.concatenate([people, *(body[:, None] for body in around)], 1)
    margin = clearance_of_others(clip.actual_rig.centers, everyone, skeleton)[:, :, :count]
    return undetected_nearest(clip, by_detection(clip, margin), level)


@corruption("own_body", order=12, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100)
def own_body(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Joints hidden behind the person's own body, % of the detected joints.

    Limbs and trunk are as thick as it takes to hide that share of the joints. What they hide is not detected. Nothing
    is drawn at random.
    """
    centres, people = clip.actual_rig.centers, given_people(clip).xyz.astype(np.float64)
    return undetected_nearest(
        clip, by_detection(clip, clearance_of_self(centres, people, given_people(clip).skeleton)), level
    )


@corruption("edges", order=13, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100)
def edges(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Joints outside the image, % of the detected joints.

    The images of all cameras are cut on all four sides, by the same share of their size, until this share of joints is
    outside. Nothing is drawn at random.
    """
    half = clip.rig.size[:, None, None] / 2
    return undetected_nearest(clip, (1 - np.abs(clip.detections.xy - (half - 0.5)) / half).min(-1), level)


@corruption("bursts", order=14, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100)
def bursts(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Limbs that no camera detects, % of the time, in bursts of tenths of a second to seconds.

    An arm, a leg, the head or the trunk of a person is missed by all cameras at the same time.
    """
    limb = limb_of_joint(given_people(clip).skeleton)
    shape = (given_people(clip).xyz.shape[1], limb.max(initial=-1) + 1)
    events = share_of_time(clip, shape, level, (1.0, 0.2), rng=rng)[..., limb]
    everywhere = np.broadcast_to(events[:, None], (len(clip), len(clip.rig), *events.shape[1:]))
    return undetected(clip, by_detection(clip, everywhere, False))


@corruption("crowd", order=1, unit="people more", levels=(1, 2, 4, 8), small=(1, 4), most=32, whole=True)
def crowd(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """People added, who each keep 1 to 2 m from one of the clip's people.

    An added person is a copy of one of the clip's people, moved in the world and delayed in time. It is detected as
    well as the one copied was; what stands behind another body is not detected. Added people have no truth and are not
    scored.
    """
    angle, distance = rng.uniform(0, 2 * np.pi, _ADDED), rng.uniform(*_DISTANCE, _ADDED)
    delay = np.rint(rng.uniform(*_DELAY, _ADDED) * clip.fps).astype(int)
    return _with_people(clip, distance[: int(level)], angle, delay)


@corruption("closeness", order=2, unit="1/m", levels=(0.5, 1, 2, 4), small=(1, 4))
def closeness(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """How close an added person keeps to each of the clip's people: 2 is half a metre, between the middles of bodies.

    People are added as with `crowd`.
    """
    people = given_people(clip).xyz.shape[1]
    delay = np.rint(rng.uniform(*_DELAY, people) * clip.fps).astype(int)
    return _with_people(clip, np.full(people, 1 / level), rng.uniform(0, 2 * np.pi, (people,)), delay)


def _with_people(clip: Clip, distance: np.ndarray, angle: np.ndarray, delay: np.ndarray) -> Clip:
    """Return the clip with detections of N additional people, which hide others and are hidden by them.

    They are copies of the clip's people in turn, moved by `distance` (N,) m at an `angle` (N or more,) rad, and delayed
    by frames (N or more,). Their joints have the error, scaled with the height in the image, and the confidence of the
    copied ones; none is detected behind another body or outside the image.
    """
    rig, skeleton, found = clip.actual_rig, given_people(clip).skeleton, clip.detections
    people, count = given_people(clip).xyz.astype(np.float64), given_people(clip).xyz.shape[1]
    if not count:
        return clip
    copied = [(number % count, int(frames)) for number, frames in enumerate(delay[: len(distance)])]
    moves = zip(copied, distance, angle, strict=False)
    bodies = np.stack([companion(people, person, far, to, frames) for (person, frames), far, to in moves], 1)
    hidden = clearance_of_others(rig.centers, np.concatenate([people, bodies], 1), skeleton)[:, :, count:] < 0
    newly = by_detection(clip, clearance(rig.centers, people, bodies, skeleton) < 0, False)

    shown, pixels = detections_of_people(clip), pixels_of_people(clip)
    error, score = np.full(pixels.shape, np.nan), np.full(pixels.shape[:-1], np.nan)
    if found.score.shape[2]:
        height = heights(pixels)
        off = taken(found.xy, np.maximum(shown, 0)) - pixels
        error = off / np.where(height > 0, height, np.nan)[..., None, None]
        score = np.where((shown < 0)[..., None], np.nan, taken(found.score, np.maximum(shown, 0)))
    error, score = (
        np.stack([values[delayed(len(clip), frames), :, person] for person, frames in copied], 2)
        for values in (error, score)
    )
    pixels = rig.project(bodies)[0]
    pixels = pixels + error * heights(pixels)[..., None, None]
    score = np.where(hidden | ~rig.inside(pixels), np.nan, score)
    kept = np.where(newly, np.nan, found.score)
    return redetected(clip, np.concatenate([found.xy, pixels], 2), np.concatenate([kept, score], 2))


# Copies of people, and the bodies that stand in a line of sight


def companion(people: np.ndarray, person: int, distance: float, angle: np.ndarray | float, delay: int) -> np.ndarray:
    """Return a copy (F, J, 3) of a person of `people` (F, P, J, 3) m, at a constant horizontal distance, m.

    The angle, rad, is the direction of the copy from the person, (F,) or constant. The copy is delayed by frames; at
    the ends of the clip its motion is reversed.
    """
    copy = people[delayed(len(people), delay), person]
    to = np.stack([np.cos(angle), np.sin(angle)], -1) * distance
    copy[..., :2] += (middle(people[:, person, :, :2]) - middle(copy[..., :2]) + to)[:, None]
    return copy


def delayed(frames: int, delay: int) -> np.ndarray:
    """Return for each of F frames the index of the frame `delay` earlier, reflected at the ends."""
    period = max(2 * (frames - 1), 1)
    index = (np.arange(frames) - delay) % period
    return np.minimum(index, period - index)


def clearance(centres: np.ndarray, joints: np.ndarray, bodies: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return distances (F, V, P, J), m, from the line of sight to each joint to the surface of the nearest other body.

    Lines go from camera centres (V, 3) to joints (F, P, J, 3), bodies are (F, B, J, 3) on a skeleton, m. A distance is
    negative where a body hides the joint, NaN where the joint is unknown, and infinite where no body is known.
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
    start, end = np.array(skeleton.bones, int).reshape(-1, 2).T
    bonds = coo_array((np.ones(len(start)), (start, end)), shape=(len(skeleton),) * 2)
    steps = shortest_path(bonds, directed=False, unweighted=True)
    far = np.minimum(steps[:, start], steps[:, end]) >= _APART  # (J, bones)
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
    """Return distances of lines of sight to joints (F, P, J, 3) from points (F, N, 3), less radii (N,), by frame."""
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


# Errors of a detector: joints missed or off, sides and people confused or merged, people where there are none.

_TIMES = (0.5, 0.1)  # s; correlation times of errors that come in bursts, mixed half and half
_GHOST_TIMES = [3.0, 0.3]  # s; correlation times of a ghost's presence, mixed half and half
_DUTY = 0.25  # Share of the time in which a ghost is detected
_PLACES = 64
"""Number of ghosts that are drawn for each view. The first ones are used, so that a higher level only adds ghosts. The
greatest level is this number times `_DUTY`."""
_JITTER = 0.01  # Standard deviation of a ghost's joints, as a share of its height


@corruption("misses", order=20, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100)
def misses(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Joints that the detector misses, % of the detected joints, in bursts, in each view on its own."""
    return undetected(clip, _events(clip, people_of_detections(clip), level, len(clip.detections.skeleton), rng=rng))


@corruption("jitter", order=21, unit="% of height", levels=(0.5, 1, 2, 4), small=(1, 3))
def jitter(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Noise of the detected joints, standard deviation along each axis as % of the person's height in the image.

    It is Gaussian, and independent from frame to frame.
    """
    found = clip.detections
    scale = heights(found.xy)[..., None, None] * level / 100
    return redetected(clip, found.xy + scale * rng.standard_normal(found.xy.shape), found.score)


@corruption("side_swaps", order=22, unit="%", levels=(5, 10, 20, 40), small=(10, 40), most=100)
def side_swaps(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Left and right of a person confused by the detector, % of the time, in bursts, in each view on its own."""
    swapped = _events(clip, people_of_detections(clip), level, rng=rng)[..., None]
    found, mirror = clip.detections, list(clip.detections.skeleton.mirror)
    xy = np.where(swapped[..., None], found.xy[..., mirror, :], found.xy)
    return redetected(clip, xy, np.where(swapped, found.score[..., mirror], found.score))


@corruption("person_swaps", order=23, unit="%", levels=(5, 10, 20, 40), small=(10, 40), most=100, people=2)
def person_swaps(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Limbs detected on the nearest other person in the image, % of the time, in bursts, in each view on its own."""
    limb = limb_of_joint(clip.detections.skeleton)
    swapped = _events(clip, people_of_detections(clip), level, limb.max(initial=-1) + 1, rng=rng)[..., limb]
    return redetected(clip, *_with_joints_of(clip, nearest_other(clip.detections.xy), swapped))


@corruption("ghosts", order=24, unit="ghosts", levels=(0.5, 1, 2, 4), small=(1, 4), most=16)
def ghosts(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """People detected where there are none, mean number of them in an image.

    Each has the shape and confidences of a detection of the clip, at a fixed place, and is there a quarter of the time.
    """
    found, number = clip.detections, int(np.ceil(level / _DUTY))
    shape = (len(clip), len(clip.rig), _PLACES)
    there = noise.bursts(level / number, noise.multiscale_noise(shape, clip.fps, _GHOST_TIMES, rng=rng)[:, :, :number])
    drawn, place, scale = rng.random(shape[1:]), rng.random((*shape[1:], 2)), rng.uniform(0.5, 1, shape[1:])
    xy = np.full((*there.shape, *found.xy.shape[3:]), np.nan)
    score = np.full(xy.shape[:-1], np.nan)
    wobble = rng.standard_normal((*shape, 1, 2))[:, :, :number]
    for view in range(shape[1]):
        frames, detections = np.nonzero(found.observed[:, view].sum(-1) > len(found.skeleton) // 2)
        if not len(frames):
            continue
        one = (drawn[view, :number] * len(frames)).astype(int)
        joints = found.xy[frames[one], view, detections[one]] * scale[view, :number, None, None]
        still = joints - np.nanmean(joints, 1, keepdims=True) + place[view, :number, None] * clip.rig.size[view]
        xy[:, view] = still + _JITTER * heights(still)[:, None, None] * wobble[:, view]
        score[:, view] = found.score[frames[one], view, detections[one]]
    score = np.where(there[..., None], score, np.nan)
    return redetected(clip, np.concatenate([found.xy, xy], 2), np.concatenate([found.score, score], 2))


@corruption("merges", order=25, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100, people=2)
def merges(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """People detected as one with the nearest other person in the image, % of the time, in bursts.

    One detection remains, with some limbs taken from the other person. The other detection is lost.
    """
    limb, persons = limb_of_joint(clip.detections.skeleton), people_of_detections(clip)
    other, detections = nearest_other(clip.detections.xy), range(persons.shape[2])
    merged = _events(clip, persons, level, rng=rng) & (other != np.array(detections, int))
    swapped = _events(clip, persons, 50, limb.max(initial=-1) + 1, rng=rng)[..., limb] & merged[..., None]
    xy, score = _with_joints_of(clip, other, swapped)
    lost = np.zeros(persons.shape, bool)
    for detection in detections:  # If two people are each merged with the other, one of them remains.
        frame, view = np.nonzero(merged[:, :, detection] & ~lost[:, :, detection])
        lost[frame, view, other[frame, view, detection]] = True
    return redetected(clip, xy, np.where(lost[..., None], np.nan, score))


def _events(clip: Clip, persons: np.ndarray, percent: float, *items: int, rng: np.random.Generator) -> np.ndarray:
    """Draw events (F, V, D, *items), True in `percent` of the time, for the persons (F, V, D) that detections show."""
    shape = (len(clip.rig), given_people(clip).xyz.shape[1] + 1, *items)
    return taken(share_of_time(clip, shape, percent, _TIMES, rng=rng), persons)


def _with_joints_of(clip: Clip, other: np.ndarray, swapped: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return places and scores with the joints of another detection (F, V, D) where `swapped` (F, V, D, J) is True."""
    xy, score = clip.detections.xy, clip.detections.score
    return np.where(swapped[..., None], taken(xy, other), xy), np.where(swapped, taken(score, other), score)


def nearest_other(xy: np.ndarray) -> np.ndarray:
    """Return the index (F, V, D) of the nearest other detection (F, V, D, J, 2) in the image, px; its own if alone."""
    here = np.arange(xy.shape[2])
    if not len(here):
        return np.zeros(xy.shape[:3], int)
    middles = middle(xy)
    distance = np.linalg.norm(middles[:, :, :, None] - middles[:, :, None], axis=-1)
    distance[:, :, here, here] = np.inf
    distance = np.where(np.isnan(distance), np.inf, distance)
    return np.where(np.isfinite(distance.min(-1)), distance.argmin(-1), here)


# What a recording lacks: cameras, frames, synchronisation, a right calibration.


@corruption(
    "cameras", order=90, unit="cameras fewer", levels=(1, 2, 3), small=(1, 2, 3), fewer_cameras=True, whole=True
)
def cameras(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Cameras left out, drawn at random: of five, one fewer is four."""
    kept = np.sort(rng.permutation(len(clip.rig))[int(level) :])
    return replace(clip.select(views=kept.tolist()), poses=clip.poses)


@corruption("frame_rate", order=91, unit="frames left out", levels=(1, 3, 7, 15), small=(3, 7), whole=True)
def frame_rate(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Frames left out after each frame that is kept: 1 halves the frame rate.

    Truth is left out with its frames. Nothing is drawn at random.
    """
    every = int(level) + 1
    return replace(clip.select(frames=slice(None, None, every)), fps=clip.fps / every)


@corruption("dropouts", order=31, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100)
def dropouts(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Cameras that deliver nothing, % of the time, in bursts, each on its own."""
    lost = share_of_time(clip, (len(clip.rig),), level, (1.0, 0.1), rng=rng)
    return undetected(clip, lost[..., None, None])


@corruption("offsets", order=32, unit="frames", levels=(2, 4, 8, 16), small=(4, 8), whole=True)
def offsets(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Frames by which half of the cameras, drawn at random, are late."""
    late = rng.permutation(len(clip.rig)) < len(clip.rig) // 2
    return shift_views(clip, (late * int(level)).tolist())


@corruption("calibration", order=33, unit="degrees", levels=(0.2, 0.5, 1, 2), small=(0.5, 1), most=45)
def calibration(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Degrees by which the calibrated direction of each camera is off; 0.1 is 1 cm at 6 m.

    The camera is turned about a random axis across its line of sight. The detections stay.
    """
    angle = rng.uniform(0, 2 * np.pi, len(clip.rig))
    axis = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], -1)
    turned = clip.rig.cam_from_world.copy()
    for view, vector in enumerate(axis * np.radians(level)):
        turned[view, :3] = cv2.Rodrigues(vector)[0] @ turned[view, :3]
    return replace(clip, rig=replace(clip.rig, cam_from_world=turned), true_rig=clip.actual_rig)
