"""Adaptive Triangulation (Algorithm 1 of the paper): from the detections of a clip to its people in 3D."""

from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from dmae.appearance import strangers
from dmae.associate import NONE
from dmae.baselines import fill_pchip_body
from dmae.clip import Clip, Poses3D, Source
from dmae.gaps import neighbours
from dmae.identify import Joints, identify, looks_matter
from dmae.prune import broken, by_chance, ghosts, jumps, merge, same_person
from dmae.seen import Seen, Unit
from dmae.skeleton import Skeleton
from dmae.triangulate import Noise

_NEAR = 0.3
"""m from where a joint is expected within which a single camera is believed to see it."""
_CHUNK = 16
"""Frames compared at once: some 50 MB for six people in five views."""


@dataclass(frozen=True)
class CaptureConfig:
    """How `capture` works. Lengths are of people, times in seconds: nothing depends on the rig."""

    th_p: float = 0.2
    """Joint-level filtering: a 2D joint counts from this confidence on."""
    th_v: int = 2
    """A 3D joint counts when this many views agree on it."""
    th_d: float = 0.25
    """Identity propagation: farther than this from a person's reprojection, a joint speaks against being theirs."""
    th_d_unit: Unit = Unit.metres
    noise: Noise = field(default_factory=Noise)
    """What triangulation expects of detections."""

    matching: Joints = Joints.all
    """Identity matching: the joints whose rays are compared."""
    half_ray: float = 0.1
    """Distance between rays at which their affinity is 1/2, m."""
    half_colour: float = 20.0
    """Difference of colour at which the affinity of looks is 1/2, CIELAB units."""
    colour_weight: float = 0.3
    """Share of looks in the affinity of two detections, where the clip has images; 0: the images are not read."""
    th_a: float = 0.5
    """Least affinity of detections of one person."""
    birth_joints: int = 4
    """Joints that two views or more must agree on for a new person."""

    inertia: float = 0.3
    """Share of each step that goes into the velocity by which the next is predicted; 0: people stand still."""
    coast: float = 0.5
    """How long a person is predicted without being measured, s."""
    seniority: float = 0.2
    """Time measured after which a person chooses detections before younger ones, s."""

    rejoin: float = 2.0
    """Longest absence after which someone of the same build coming back near by is the same person, s."""
    strange: float = 30.0
    """Difference of colour from which on nobody came back, CIELAB units; only where the clip has images."""
    least_life: float = 0.3
    """Who is measured with `birth_joints` for less is no person, s."""
    reach: float = 0.2
    """Second pass: each joint takes the detection nearest its own path, up to this far, m; 0: no second pass."""
    th_p_again: float = 0.1
    """Second pass: being where it is expected, a 2D joint counts from this confidence on."""
    bridge: float = 0.4
    """Gaps in that path are bridged up to this, s."""
    prune: bool = True
    """Drop joints that break bones, or that jump and return."""

    def __post_init__(self):
        if self.th_v < 2:
            raise ValueError(f"th_v={self.th_v}: a point needs at least 2 views")
        for name in ("th_d", "half_ray", "half_colour"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}={getattr(self, name)}: expected a positive length")


def capture(clip: Clip, config: CaptureConfig) -> Poses3D:
    """Reconstruct the people of a clip from its detections, offline.

    Frame by frame, detections are given to the people of the frame before on whose reprojection they lie
    (identity propagation); those left over are matched between views by rays and looks, and become new
    people or old ones come back (identity matching); joints are triangulated from the views that agree.
    Then tracks of one person are merged, ghosts dropped, and with the whole path of each person known,
    each joint chooses its detections again, of which the surest is handed on as its ray. (`dmae.online` is the
    same for frames as they come.)

    Detections need not be sound. Joints with coordinates that are not finite are absent; confidences below
    0 and above 1 count as 0 and 1; of doubles in a view the nearer counts, joint by joint. Cameras that see
    nothing change nothing. Cameras that share no view, or stand too close to tell depth, find nobody;
    nobody, as no frames, is a result like others.

    Returns:
        Tracks in the order of their birth, a row each for the whole clip. A joint that fewer than `th_v`
        views agree on is NaN and `Source.ABSENT`, anything else `MEASURED`, with covariance and views.

    Raises:
        ValueError: the clip has a single camera.
    """
    if len(clip.rig) < 2:
        raise ValueError(f"clip {clip.id!r}: capture needs at least 2 cameras, found {len(clip.rig)}")
    seen = Seen.of(clip, config.th_p, config)
    chosen, xyz = identify(seen, clip, config)
    skeleton, fps = clip.detections.skeleton, clip.fps
    differ = partial(strangers, clip, chosen, config.strange) if looks_matter(clip, config) else None
    chosen, xyz = merge(chosen, xyz, same_person(xyz, skeleton, fps, config.rejoin, differ))
    alive = ~ghosts(xyz, fps, config.birth_joints, config.least_life) & ~by_chance(xyz, chosen, config.th_v)
    chosen, xyz = chosen[:, alive], xyz[:, alive]
    first = chosen
    if config.reach > 0:
        seen = Seen.of(clip, config.th_p_again, config)
        chosen = choose_again(seen, chosen, paths(xyz, skeleton, fps, config), config.reach)
    points = seen.triangulate(np.arange(len(clip))[:, None, None, None], chosen)
    xyz = prune(points.xyz, skeleton, fps) if config.prune else points.xyz
    absent = np.isnan(xyz[..., 0])
    poses = Poses3D(
        skeleton,
        xyz,
        np.where(absent, Source.ABSENT, Source.MEASURED),
        np.where(absent[..., None, None], np.nan, points.cov),
        np.where(absent, 0, points.views),
    )
    return replace(poses, rays=sightings(seen, absent, fill_pchip_body(poses, fps).xyz, chosen, first))


def prune(xyz: np.ndarray, skeleton: Skeleton, fps: float) -> np.ndarray:
    """Joints (F, P, J, 3) less those that cannot be right."""
    sound = np.where(broken(xyz, skeleton)[..., None], np.nan, xyz)
    return np.where(jumps(sound, fps)[..., None], np.nan, sound)


def paths(xyz: np.ndarray, skeleton: Skeleton, fps: float, config: CaptureConfig) -> np.ndarray:
    """Where joints (F, P, J, 3) are expected, by what came before and after."""
    return _bridge(prune(xyz, skeleton, fps), int(config.bridge * fps))


def _bridge(xyz: np.ndarray, longest: int) -> np.ndarray:
    """Paths (F, ..., 3) with a straight line through each gap of less than `longest` frames."""
    frames = len(xyz)
    known = ~np.isnan(xyz[..., 0])
    index = np.arange(frames).reshape(-1, *(1,) * (known.ndim - 1))
    before, after = neighbours(known)
    span = after - before
    inside = ~known & (before >= 0) & (after < frames) & (span <= longest)
    share = np.where(inside, (index - before) / np.maximum(span, 1), 0)[..., None]
    start = np.take_along_axis(xyz, np.where(inside, before, index)[..., None], 0)
    end = np.take_along_axis(xyz, np.where(inside, after, index)[..., None], 0)
    return start + share * (end - start)


def choose_again(seen: Seen, chosen: np.ndarray, path: np.ndarray, reach: float) -> np.ndarray:
    """For joints with a path, the detections nearest to it that are nearest to no other person.

    Mends what was assembled or matched wrongly: a neighbour's wrist, a forearm that hung on nobody.

    Args:
        chosen: (F, P, V, J) detections, or `NONE`.
        path: (F, P, J, 3) m, NaN where a joint has none and its choice stands.
        reach: Farthest, m.
    """
    if not chosen.size:
        return chosen
    people = np.arange(path.shape[1])[:, None]
    again = chosen.copy()
    for start in range(0, len(path), _CHUNK):
        frames = slice(start, start + _CHUNK)
        distance = seen.distance(frames, path[frames], Unit.metres)
        distance = np.where(distance < reach, distance, np.inf)
        nearest = distance.argmin(3)
        owner = np.take_along_axis(distance.argmin(2), nearest, 2)
        found = np.isfinite(distance.min(3)) & (owner == people)
        best = np.where(found, nearest, NONE).swapaxes(1, 2)
        has_path = ~np.isnan(path[frames, :, None, :, 0])
        again[frames] = np.where(has_path, best, chosen[frames])
    return again


def sightings(
    seen: Seen, absent: np.ndarray, expected: np.ndarray, chosen: np.ndarray, first: np.ndarray
) -> np.ndarray:
    """The surest sighting of each joint, (F, P, J, 2, 3), see `Poses3D.rays`.

    An absent joint is looked for where it is expected; where no camera saw it near there, the detections that its
    person was given say where they saw it.

    Args:
        seen: What the joints were measured from.
        absent: (F, P, J) True for those that were not measured.
        expected: (F, P, J, 3) m, where joints are, by interpolation if need be.
        chosen: (F, P, V, J) detections that they were measured from, or `NONE`.
        first: (F, P, V, J) those that their people were given.
    """
    near = choose_again(seen, chosen, expected.astype(np.float64), _NEAR)
    near = np.where((near == NONE).all(2, keepdims=True), first, near)
    near = np.where(absent[:, :, None], near, chosen).swapaxes(2, 3)
    frame, person, joint, views = np.ogrid[tuple(slice(n) for n in near.shape)]
    sure = np.where(near == NONE, np.nan, seen.confidence[frame, views, near, joint])
    view = np.nan_to_num(sure, nan=-1).argmax(-1)
    frame, person, joint = frame[..., 0], person[..., 0], joint[..., 0]
    directions = seen.rig.rays(seen.xy)[frame, view, near[frame, person, joint, view], joint]
    unknown = np.isnan(sure).all(-1)[..., None, None]
    return np.where(unknown, np.nan, np.stack([seen.rig.centers[view], directions], -2))
