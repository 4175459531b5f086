"""Adaptive Triangulation (Algorithm 1 of the paper): from the detections of a clip to its people in 3D."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial
from math import ceil

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import NOT_KNOWN, Clip, Poses3D, Source
from dmae.data.skeleton import Skeleton
from dmae.files.mapped import by_frames, empty, in_steps
from dmae.numerics.filling import STILLS, are_stills, fill_body_frame
from dmae.numerics.paths import pchip
from dmae.numerics.statistics import evenly_spaced
from dmae.progress import progress
from dmae.reconstruction.association import NONE
from dmae.reconstruction.body_size import as_people, in_units_of_people
from dmae.reconstruction.config import ADAPTIVE, AssociationConfig, CaptureConfig, capture_method
from dmae.reconstruction.evidence import Evidence, evidence_blocks
from dmae.reconstruction.noise import DetectionNoise, fit, residuals
from dmae.reconstruction.people import steps_to_people
from dmae.reconstruction.pruning import prune
from dmae.reconstruction.reassignment import expected_paths, most_confident_rays, reassign
from dmae.reconstruction.sides import Sides, correct_sides, find_turned, side_votes, turn
from dmae.reconstruction.tracking import MIN_JOINTS, Tracker, Tracks, count_figures, track
from dmae.registry import takes

_WIDE_PX, _WIDE_M = 0.006, 0.06
"""Noise that is assumed before anything is known: share of the width of the image, and m on the person."""
_ALTERNATIONS = 3  # Number of times that people are found and their residuals measured
_EXPECTED_BY, _EXPECTED_IN_CLIPS = 2.0, 10.0
"""s; time around a window, online or in a block of a long clip, from which unmeasured joints in it are predicted."""
_STILLS = 4000  # Frames of stills whose people are kept in memory
_SHOWN_FPS = 25.0  # Rate at which a still is shown twice
_STILL_AFFINITY = 0.9
"""Of `min_affinity`, what counts in stills: no other frame makes up for a person who is not matched."""
_COARSEST = 1e-3  # m; coordinates within 16 km of the origin are stored in smaller steps
_FEWEST_PX = 2.0  # People are larger; where no coordinate of a detected joint is, coordinates are not pixels
_MOST_ZEROS = 0.01  # Share of detected joints at pixel (0, 0); detectors put none there, but absent ones


def capture(clip: Clip, config: CaptureConfig, noise: DetectionNoise | None = None) -> Poses3D:
    """Reconstruct the people of a clip from its detections, offline.

    With `config.method` a published system does this, see `dmae.reconstruction.systems`. By default:

    0. How far detections scatter, and what their confidences say, is learned from frames of the clip (`learn_noise`).
    1. Frame by frame, detections near the reprojection of a tracked person are assigned to that person (identity
       propagation). The others are matched between views by rays and clothes; they start a track or re-enter one
       (identity matching). Joints are triangulated from the views that agree.
    2. Tracks of one person are merged, false positives are dropped, and the requested people are selected.
    3. With the whole path of each person known, joints with left and right exchanged are corrected, and each joint is
       assigned to detections again, triangulated and pruned.

    `dmae.online.capture` runs the same steps on frames as they come.

    Detections may have any defect. Joints with coordinates that are not finite are absent; confidences below 0 and
    above 1 count as 0 and 1; of duplicates in a view, the nearer one is used for each joint. Cameras without
    detections change nothing. Cameras without a common field of view, or too close to each other to measure depth,
    find no people. Zero people and zero frames are valid results.

    People are bodies of any skeleton. Lengths of the configuration are for bodies of human size. For skeletons of
    another size they are multiplied by `Skeleton.scale`.

    Raises ValueError if the clip has a single camera, its cameras are too far from the origin (`check_origin`), its
    coordinates are no pixels, the requested subject cannot be found, or a method of your own returns something else
    than poses of the clip.

    Args:
        clip: F frames of V cameras; only its rig, detections, frame rate and images are read.
        config: Thresholds.
        noise: How far detections scatter, as `learn_noise` returns it; by default it is learned.

    Returns:
        Tracks (F, P) in the order of their birth, one per person; of stills (`dmae.numerics.filling.STILLS`) the people
        of each frame, a column for another person in each. A joint on which fewer than `th_v` views agree is NaN and
        `Source.ABSENT`; the others are `MEASURED`, with covariance and number of views. `rays` contains the ray of the
        most confident camera to each joint.
    """
    if len(clip.rig) < 2:
        raise ValueError(f"clip {clip.id!r}: capture needs at least 2 cameras, found {len(clip.rig)}")
    check_origin(clip.rig, f"clip {clip.id!r}")
    some = clip.detections.xy[evenly_spaced(len(clip), _SAMPLED[1])]
    if np.isfinite(some).any() and np.nanmax(some) <= _FEWEST_PX:
        raise ValueError(
            f"clip {clip.id!r}: expected pixels, but no coordinate of a detected joint is above {np.nanmax(some):.3g}; "
            "multiply shares of the image by its width and height, or project metres with its calibration"
        )
    zeros, found = (some == 0).all(-1).sum(), np.isfinite(some).all(-1).sum()
    if zeros > _MOST_ZEROS * found:
        raise ValueError(
            f"clip {clip.id!r}: {zeros / found:.0%} of the detected joints are at pixel (0, 0), a place in the "
            "image; expected NaN where a detector found nothing, as by xy[(xy == 0).all(-1)] = np.nan"
        )
    if config.method == ADAPTIVE:
        return in_units_of_people(partial(_capture, noise=noise), clip, config)
    function = of_clip_and_config(capture_method.find(config.method).function, f"method={config.method}")
    # Its configuration does not name the function itself, so that it may capture by this and change the poses.
    poses = in_units_of_people(function, clip, replace(config, method=ADAPTIVE))
    if not isinstance(poses, Poses3D) or len(poses.xyz) != len(clip):
        found = f"Poses3D of {len(poses.xyz)} frames" if isinstance(poses, Poses3D) else type(poses).__name__
        raise ValueError(
            f"clip {clip.id!r}: method={config.method}: expected Poses3D of {len(clip)} frames, found {found}"
        )
    return poses


def of_clip_and_config(function: Callable, name: str) -> Callable[[Clip, CaptureConfig], Poses3D]:
    """Return a capture that takes a clip and a configuration; the function may take the clip alone.

    Raises ValueError, which begins with the name, if it takes other arguments.
    """
    if takes(function, "clip", "config"):
        return function
    if takes(function, "clip"):
        return lambda clip, config: function(clip)
    raise ValueError(f"{name}: expected a function of a clip, or of a clip and its dmae.CaptureConfig")


def check_origin(rig: CameraRig, where: str) -> None:
    """Raise ValueError, after `where`, if poses near the cameras would be stored with steps above `_COARSEST`."""
    place = np.median(rig.centers, 0)
    step = float(np.spacing(np.abs(place).max().astype(np.float32)))
    if step > _COARSEST:
        x, y, z = (round(float(each)) for each in place)
        raise ValueError(
            f"{where}: its cameras are {np.linalg.norm(place) / 1000:,.0f} km from the origin, where poses are stored "
            f"in steps of {1000 * step:.0f} mm (32 bits); move the origin in the calibration to the cameras: subtract "
            f"about ({x}, {y}, {z}) m from their places"
        )


def _capture(clip: Clip, config: CaptureConfig, noise: DetectionNoise | None) -> Poses3D:
    """Reconstruct bodies as large as people."""
    noise = noise or _learned(clip, config)
    if are_stills(clip.fps):
        return _captured_stills(clip, config, noise)
    return _people_of(clip, track(clip, config, noise), config, noise)


def _people_of(
    clip: Clip, tracks: Tracks, config: CaptureConfig, noise: DetectionNoise, alone: bool = False
) -> Poses3D:
    for _, kept in steps_to_people(clip, tracks, config, noise, alone):
        tracks = kept
    return _measured_people(clip, tracks, config, noise)


def _captured_stills(clip: Clip, config: CaptureConfig, noise: DetectionNoise) -> Poses3D:
    """Reconstruct the people of each frame by themselves."""
    if config.subject.at is not None and len(clip) > 1:
        raise ValueError(
            f"subject.at={config.subject.at}: clip {clip.id!r} has {clip.fps:g} frames/s; below {STILLS:g} each frame "
            "is captured by itself, and nobody is followed from one to the next"
        )
    least = _STILL_AFFINITY * config.association.min_affinity
    config = replace(config, association=replace(config.association, min_affinity=least))
    strangers = _strangers(clip, config, noise)
    blocks = [range(start, min(start + _STILLS, len(clip))) for start in range(0, len(clip), _STILLS)]
    return _joined(
        [
            _joined([_captured_still(clip, each, config, noise, strangers) for each in block])
            for block in in_steps(progress(blocks, "capturing stills"))
        ]
    )


def _strangers(clip: Clip, config: CaptureConfig, noise: DetectionNoise) -> np.ndarray:
    """Return the mean numbers (V,) of figures in stills that are of nobody whom another view shows, at least 1."""
    frames, strangers = _sampled_frames(clip), np.full(len(clip.rig), np.inf)
    evidence = Evidence.of(clip, config.th_p, config, frames, noise)
    for _ in range(_ALTERNATIONS):
        left = np.zeros(len(clip.rig))
        tracker = Tracker(clip.detections.skeleton, _SHOWN_FPS, config, strangers)
        for each in map(evidence.at, range(len(frames))):
            left += count_figures(each) - ((tracker.alone(each) != NONE).sum(-1) >= MIN_JOINTS).sum(0)
        strangers = np.maximum(left / max(len(frames), 1), 1)
    return strangers


def _captured_still(
    clip: Clip, frame: int, config: CaptureConfig, noise: DetectionNoise, strangers: np.ndarray
) -> Poses3D:
    """Reconstruct the people of a frame, shown twice: those found at first then take what was left over of them."""
    twice = replace(clip.select(frames=[frame, frame]), fps=_SHOWN_FPS)
    tracks = track(twice, config, noise, strangers)
    return _people_of(twice, tracks, config, noise, alone=True).select(slice(1, 2))


def _joined(parts: list[Poses3D]) -> Poses3D:
    """Return poses one after the other, with places for the people of the part that has most."""
    count, people = sum(len(part.xyz) for part in parts), max(part.xyz.shape[1] for part in parts)
    arrays = {}
    for name, first in parts[0].arrays.items():
        arrays[name], row = empty((count, people, *first.shape[2:]), first.dtype), 0
        for part in parts:
            array = part.arrays[name]
            arrays[name][row : row + len(array), : array.shape[1]] = array
            arrays[name][row : row + len(array), array.shape[1] :] = NOT_KNOWN[name]
            row += len(array)
    return Poses3D(parts[0].skeleton, **arrays)


_SAMPLED, _SAMPLED_DETECTIONS = (8, 100), 600
"""Numbers of frames from which noise is learned, least and greatest, and of detections in all cameras in them."""


def _sampled_frames(clip: Clip) -> np.ndarray:
    """Return frames that two cameras or more have detections in, fewer of crowds."""
    present = np.isfinite(clip.detections.score).any(-1)
    frames = np.flatnonzero(present.any(-1).sum(1) >= 2)
    if not len(frames):
        return frames
    crowd = present[frames].sum((1, 2)).mean()
    return frames[evenly_spaced(len(frames), int(np.clip(_SAMPLED_DETECTIONS / crowd, *_SAMPLED)))]


def learn_noise(clip: Clip, config: CaptureConfig) -> DetectionNoise:
    """Learn from frames of a recording how far its detections scatter, see `dmae.reconstruction.noise`.

    Raises ValueError if the skeleton states no size, and the detections do not determine it.
    """
    if not config.noise.learn or config.method != ADAPTIVE:
        return DetectionNoise.prior(config.noise, *clip.detections.score.shape[1::2])
    return _learned(*as_people(clip, config)[:2])


def _learned(clip: Clip, config: CaptureConfig) -> DetectionNoise:
    """Learn the noise of a clip of bodies as large as people, from people found in each frame alone."""
    skeleton, (views, joints) = clip.detections.skeleton, clip.detections.score.shape[1::2]
    prior = DetectionNoise.prior(config.noise, views, joints)
    if not config.noise.learn:
        return prior
    config = replace(config, association=AssociationConfig())
    noise = replace(
        prior,
        floor_px=_WIDE_PX * clip.rig.size[:, 0].astype(float),
        spread_m=np.full(joints, _WIDE_M),
        constant=np.ones(views, bool),
        usual_m=_WIDE_M,
    )
    frames = _sampled_frames(clip)
    if not len(frames):
        return prior
    for _ in range(_ALTERNATIONS):
        evidence = Evidence.of(clip, 0.0, config, frames, noise)
        tracker = Tracker(skeleton, clip.fps, config)
        people = [tracker.alone(evidence.at(frame)) for frame in range(len(frames))]
        assigned = np.full((len(frames), max(map(len, people)), views, joints), NONE)
        for row, each in zip(assigned, people, strict=True):
            row[: len(each)] = each
        points = evidence.triangulate(assigned)
        found = residuals(evidence.rig, noise, evidence.xy, clip.detections.score[frames], assigned, points)
        noise = fit(found, prior, noise, skeleton)
    return noise


def _measured_people(clip: Clip, tracks: Tracks, config: CaptureConfig, noise: DetectionNoise) -> Poses3D:
    """Measure the joints of the people of a whole clip, as `measure` does, in blocks of frames that fit in memory."""
    skeleton, fps, reassignment = clip.detections.skeleton, clip.fps, config.reassignment
    th_p = reassignment.th_p if reassignment.distance_m > 0 else config.th_p
    sides, blocks = Sides.of(skeleton), evidence_blocks(clip, tracks.assigned.shape[1])

    # If there is a single block, its evidence is computed only once.
    @lru_cache(maxsize=1)
    def detected_between(start: int, stop: int) -> Evidence:
        return Evidence.of(clip, th_p, config, slice(start, stop), noise)

    votes = np.zeros(tracks.xyz.shape[:2])
    for part in in_steps(blocks):
        evidence = detected_between(part.start, part.stop)
        votes[part] = side_votes(evidence, tracks.assigned[part], tracks.xyz[part], sides)
    turned, paths = _turned_and_paths(tracks, votes, skeleton, fps, noise.usual_m)

    @lru_cache(maxsize=1)
    def evidence_between(start: int, stop: int) -> Evidence:
        part = slice(start, stop)
        evidence = turn(detected_between(start, stop), tracks.assigned[part], turned[part], sides)
        return correct_sides(evidence, tracks.assigned[part], paths[part], sides)

    kinds = {"xyz": np.float32, "source": np.uint8, "cov": np.float32, "views": np.uint8, "rays": np.float32}
    inner = {"xyz": (3,), "cov": (3, 3), "rays": (2, 3)}
    made = {name: empty((*tracks.xyz.shape[:3], *inner.get(name, ())), kind) for name, kind in kinds.items()}
    assigned, xyz = empty(tracks.assigned.shape, np.int16), empty(tracks.xyz.shape, np.float64)
    for part in in_steps(blocks):
        evidence = evidence_between(part.start, part.stop)
        assigned[part] = reassign(evidence, tracks.assigned[part], paths[part], evidence.config.reassignment.distance_m)
        points = evidence.triangulate(assigned[part])
        xyz[part], made["cov"][part], made["views"][part] = points.xyz, points.cov, points.views
    if config.prune:
        xyz = prune(xyz, skeleton, fps, noise.usual_m)
    for part in in_steps(blocks):
        evidence, known = evidence_between(part.start, part.stop), (xyz[part], made["cov"][part], made["views"][part])
        expected = _expected(skeleton, fps, xyz, part, _EXPECTED_IN_CLIPS)
        poses = _poses(skeleton, known, evidence, expected, assigned[part], tracks.assigned[part])
        for name, array in poses.arrays.items():
            made[name][part] = array
    return Poses3D(skeleton, **made)


def _turned_and_paths(
    tracks: Tracks, votes: np.ndarray, skeleton: Skeleton, fps: float, deviation: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return where people were tracked with sides exchanged (F, P), and the paths of joints with them put right."""
    turned, xyz = find_turned(tracks.xyz, votes, Sides.of(skeleton), fps, deviation), tracks.xyz
    if turned.any():
        mirror = list(skeleton.mirror)
        xyz = by_frames(lambda xyz, turned: np.where(turned[..., None, None], xyz[:, :, mirror], xyz), xyz, turned)
    return turned, expected_paths(xyz, skeleton, fps, deviation)


def _expected(skeleton: Skeleton, fps: float, xyz: np.ndarray, window: slice, seconds: float) -> np.ndarray:
    """Return the expected places of joints in a window of frames, from the joints (F, P, J, 3) known around it."""
    # A joint that is hidden for a longer time has no expected place.
    reach = ceil(seconds * fps)
    around = slice(max(window.start - reach, 0), window.stop + reach)
    inside = slice(window.start - around.start, window.stop - around.start)
    return fill_body_frame(Poses3D(skeleton, xyz[around]), fps, pchip).xyz[inside]


def _poses(
    skeleton: Skeleton,
    known: tuple[np.ndarray, np.ndarray, np.ndarray],
    evidence: Evidence,
    expected: np.ndarray,
    assigned: np.ndarray,
    first_pass: np.ndarray,
) -> Poses3D:
    """Return joints as poses, with the rays of joints that were not measured.

    `known` are xyz, covariances and numbers of views of joints (F, P, J) after pruning; `expected` (F, P, J, 3) m are
    their expected places; `assigned` and `first_pass` (F, P, V, J) the detections that they were measured from, and
    that tracking assigned.
    """
    xyz, cov, views = known
    absent = np.isnan(xyz[..., 0])
    return Poses3D(
        skeleton,
        xyz,
        np.where(absent, Source.ABSENT, Source.MEASURED),
        np.where(absent[..., None, None], np.nan, cov),
        np.where(absent, 0, views),
        most_confident_rays(evidence, absent, expected, assigned, first_pass),
    )


def measure(
    evidence: Evidence,
    tracks: Tracks,
    window: slice,
    before: np.ndarray,
    votes: np.ndarray,
    skeleton: Skeleton,
    fps: float,
) -> tuple[np.ndarray, np.ndarray, Callable[[int], Poses3D]]:
    """Measure the joints of known people in a window of frames: reassign, triangulate and prune.

    Args:
        evidence: Detections of the F frames of the window.
        tracks: P people over N frames, from before the window to after it.
        window: The F frames among the N.
        before: (window.start, P, J, 3) m, joints triangulated in the frames before the window.
        votes: (window.start, P) votes on sides in the frames before the window, see `side_votes`.

    Returns:
        The joints (F, P, J, 3), m, before pruning; the votes on sides (F, P) in the window; and a function that returns
        so many of the first frames as poses, with the rays of joints that were not measured, which takes about as long
        again.
    """
    first_pass, sides = tracks.assigned[window], Sides.of(skeleton)
    seen = side_votes(evidence, first_pass, tracks.xyz[window], sides)
    later = np.zeros((len(tracks.xyz) - window.stop, seen.shape[1]))
    all_votes = np.concatenate([votes, seen, later])
    turned, paths = (
        each[window] for each in _turned_and_paths(tracks, all_votes, skeleton, fps, evidence.noise.usual_m)
    )
    evidence = correct_sides(turn(evidence, first_pass, turned, sides), first_pass, paths, sides)
    assigned = reassign(evidence, first_pass, paths, evidence.config.reassignment.distance_m)
    points = evidence.triangulate(assigned)
    xyz = np.concatenate([before, points.xyz])
    if evidence.config.prune:
        xyz = prune(xyz, skeleton, fps, evidence.noise.usual_m)

    def poses(count: int) -> Poses3D:
        part = slice(window.start, window.start + count)
        expected = _expected(skeleton, fps, np.concatenate([xyz, tracks.xyz[window.stop :]]), part, _EXPECTED_BY)
        known = xyz[part], points.cov[:count], points.views[:count]
        return _poses(skeleton, known, evidence, expected, assigned[:count], first_pass[:count])

    return points.xyz, seen, poses
