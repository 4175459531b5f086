"""Adaptive Triangulation (Algorithm 1 of the paper): from the detections of a clip to its people in 3D."""

from functools import partial
from math import ceil

import numpy as np

from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.skeleton import Skeleton
from dmae.numerics.filling import fill_body_frame
from dmae.numerics.interpolation import pchip
from dmae.reconstruction.appearance import appearance_differs, has_appearance
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.evidence import Evidence
from dmae.reconstruction.false_positives import false_positives, well_measured
from dmae.reconstruction.merging import merge, same_person
from dmae.reconstruction.people.body_size import in_units_of_people
from dmae.reconstruction.people.disagreement import settle_disagreement
from dmae.reconstruction.people.sides import Sides, exchange, find_exchanged
from dmae.reconstruction.people.subjects import inside_volume, wanted_people
from dmae.reconstruction.pruning import prune
from dmae.reconstruction.rays import most_confident_rays
from dmae.reconstruction.reassignment import expected_paths, reassign
from dmae.reconstruction.tracking import track
from dmae.reconstruction.tracks import Tracks

_EXPECTED_BY = 2.0
"""s around a window of frames by which hidden joints are expected in it."""


def capture(clip: Clip, config: CaptureConfig) -> Poses3D:
    """Reconstruct the people of a clip from its detections, offline.

    1. Frame by frame, detections near the reprojection of a tracked person are assigned to that person (identity
       propagation). The others are matched between views by rays and clothes; they start a track or re-enter one
       (identity matching). Joints are triangulated from the views that agree.
    2. Tracks of one person are merged, false positives dropped, and the people chosen that are asked for.
    3. With the whole path of each person known, joints with left and right exchanged are put right, and each joint is
       assigned to detections again, triangulated and pruned. Where cameras disagree on a person by a constant, as
       after an inexact calibration, joints that four cameras or more see are made of those that agree.

    `dmae.online.capture` runs the same steps on frames as they come.

    Detections may have any defect. Joints with coordinates that are not finite are absent; confidences below 0 and
    above 1 count as 0 and 1; of duplicates in a view the nearer counts, joint by joint. Cameras that detect no one
    change nothing. Cameras that share no field of view, or stand too close to each other to measure depth, find no
    people. Zero people and zero frames are valid results.

    People are bodies of any skeleton. Lengths of the configuration are for bodies of a person's size: where a skeleton
    has another, they are multiplied by its `Skeleton.scale`.

    Args:
        clip: F frames of V cameras; only its rig, detections, frame rate and images are read.
        config: Thresholds.

    Returns:
        Tracks (F, P) in the order of their birth, one a person. A joint on which fewer than `th_v` views agree is NaN
        and `Source.ABSENT`; the others are `MEASURED`, with covariance and number of views. `rays` holds where the most
        confident camera saw each joint.

    Raises:
        ValueError: the clip has a single camera, or the subject that is asked for cannot be found.
    """
    if len(clip.rig) < 2:
        raise ValueError(f"clip {clip.id!r}: capture needs at least 2 cameras, found {len(clip.rig)}")
    return in_units_of_people(_capture, clip, config)


def _capture(clip: Clip, config: CaptureConfig) -> Poses3D:
    """Reconstruct bodies as large as people."""
    skeleton, fps, tracking = clip.detections.skeleton, clip.fps, config.tracking
    evidence = Evidence.of(clip, config.th_p, config)
    tracks = track(evidence, clip, config)
    differs = None
    if has_appearance(clip, config):
        differs = partial(appearance_differs, clip, tracks.assigned, tracking.reentry_colour_difference)
    tracks = merge(tracks, same_person(tracks.xyz, skeleton, fps, tracking.reentry_s, differs))
    tracks = inside_volume(tracks, config.volume)
    measured = well_measured(tracks, tracking.births(len(skeleton))).sum(0)
    tracks = tracks.select(~false_positives(tracks, measured, len(clip), fps, config))
    tracks = wanted_people(tracks, clip.rig, skeleton, fps, config)
    if config.reassignment.distance_m > 0:
        evidence = Evidence.of(clip, config.reassignment.th_p, config)
    before = np.empty((0, *tracks.xyz.shape[1:]))
    poses, _ = measure(evidence, tracks, slice(0, len(clip)), before, skeleton, fps, settle=True)
    return poses


def measure(
    evidence: Evidence,
    tracks: Tracks,
    window: slice,
    before: np.ndarray,
    skeleton: Skeleton,
    fps: float,
    settle: bool = False,
) -> tuple[Poses3D, np.ndarray]:
    """Measure the joints of known people in a window of frames: reassign, triangulate, prune, and select rays.

    Args:
        evidence: Detections of the F frames of the window.
        tracks: P people over N frames, from before the window to after it.
        window: The F frames among the N.
        before: (window.start, P, J, 3) m, joints triangulated in the frames before the window.
        settle: Triangulate people on which cameras disagree from those that agree, see `settle_disagreement`; for
            windows of whole recordings.

    Returns:
        poses: (F, P, J) of the window.
        xyz: (F, P, J, 3) m, joints of the window before pruning, as `before` of a later one.
    """
    config, first_pass = evidence.config, tracks.assigned[window]
    assigned, sides = first_pass, Sides.of(skeleton)
    paths = expected_paths(tracks.xyz, skeleton, fps, config.reassignment.max_gap_s)[window]
    wrong = find_exchanged(evidence, slice(0, len(assigned)), assigned, paths, sides)
    evidence = exchange(evidence, 0, *wrong, sides)
    if config.reassignment.distance_m > 0:
        assigned = reassign(evidence, first_pass, paths, config.reassignment.distance_m)
    points = evidence.triangulate(np.arange(len(assigned))[:, None, None, None], assigned)
    if settle:
        settle_disagreement(evidence, assigned, points)
    xyz = np.concatenate([before, points.xyz])
    if config.prune:
        xyz = prune(xyz, skeleton, fps)
    # What is expected is known by the frames around: a joint that is hidden for longer is expected nowhere.
    reach = ceil(_EXPECTED_BY * fps)
    around = slice(max(window.start - reach, 0), window.stop + reach)
    nearby = Poses3D(skeleton, np.concatenate([xyz, tracks.xyz[window.stop :]])[around])
    xyz = xyz[window]
    inside = slice(window.start - around.start, window.stop - around.start)
    expected = fill_body_frame(nearby, fps, pchip).xyz[inside]
    absent = np.isnan(xyz[..., 0])
    poses = Poses3D(
        skeleton,
        xyz,
        np.where(absent, Source.ABSENT, Source.MEASURED),
        np.where(absent[..., None, None], np.nan, points.cov),
        np.where(absent, 0, points.views),
        most_confident_rays(evidence, absent, expected, assigned, first_pass),
    )
    return poses, points.xyz
