"""Diagnosis of a capture with few or no people: the result of each step, and suggested changes."""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from dmae.data.skeleton import Skeleton
from dmae.numerics.filling import are_stills
from dmae.numerics.statistics import evenly_spaced, median_known
from dmae.reconstruction.association import NONE, Candidates, count_pairs, find_groups
from dmae.reconstruction.body_size import as_people
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.evidence import Evidence
from dmae.reconstruction.people import leg_lengths, steps_to_people, well_measured
from dmae.reconstruction.tracking import MIN_JOINTS, Tracks, fewest_joints, longest_bone, track

_FRAMES = 10  # Number of frames in which detections are compared
_PAIRS = 300_000
"""Number of pairs of detections that are compared in these frames; of crowds, fewer frames are compared."""
_SHORTEST_BONE = 0.1  # m; a body has a bone that is longer than this
_UNIT = "lengths of the calibration are in {0}: data.unit={0} (of dmae run: world.unit), or {1} its translations by {2}"
_SCALES = {
    1.0: "",
    0.001: _UNIT.format("mm", "divide", 1000),
    0.01: _UNIT.format("cm", "divide", 100),
    1000.0: _UNIT.format("m", "multiply", 1000),
}
_INVERSES = {
    False: "",
    True: "extrinsics of the calibration are the other way round: data.inverse=true, or false where that is the "
    "default of its format, or invert them",
}
_ZOOMS = {
    1.0: "",
    2.0: "people were detected in images of half the size that was calibrated: multiply the pixels by 2, or divide fx, "
    "fy, cx, cy and the image size of the calibration by 2",
    0.5: "people were detected in images of twice the size that was calibrated: divide the pixels by 2, or multiply "
    "fx, fy, cx, cy and the image size of the calibration by 2",
}


@dataclass(frozen=True)
class Explanation:
    """The reasons for few or no people."""

    stages: tuple[tuple[str, int], ...]  # What remained after each step, in order: words and a number
    suggestions: tuple[str, ...]  # Suggested changes, the most likely first

    def __str__(self) -> str:
        width = max(len(f"{count:,}") for _, count in self.stages)
        lines = [f"  {count:>{width},} {words}" for words, count in self.stages]
        suggestions = [f"  suggestion: {suggestion}" for suggestion in self.suggestions]
        return "\n".join(["of the recording there are", *lines, *suggestions])


def explain_capture(clip: Clip, config: CaptureConfig) -> Explanation:
    """Repeat the steps of `dmae.reconstruction.pipeline.capture`, and count what remains after each step.

    If detections of different cameras do not fit each other, other units, inverted extrinsics and other image sizes are
    tried.
    """
    if clip.detections.skeleton.defined and clip.detections.observed.any():
        try:
            clip, config, _ = as_people(clip, config)
        except ValueError as error:
            return Explanation((("cameras", len(clip.rig)), ("frames", len(clip))), (str(error),))
    score, skeleton = clip.detections.score, clip.detections.skeleton
    observed = clip.detections.observed
    people, joints, sure = int(observed.any(-1).sum()), int(observed.sum()), int((score >= config.th_p).sum())
    stages = [
        ("cameras", len(clip.rig)),
        ("frames", len(clip)),
        ("detections of people in all cameras", people),
        ("detected joints", joints),
        (f"joints of a confidence of {config.th_p:g} or more (th_p)", sure),
    ]
    if not people:
        suggestion = (
            "there are no detections: the files hold no people, or only joints of confidence 0, which is absent"
        )
        return Explanation(tuple(stages), (suggestion,))
    if not sure:
        suggestion = f"the greatest confidence is {np.nanmax(score):.2g}: give a smaller capture.th_p"
        return Explanation(tuple(stages), (suggestion,))
    evidence = Evidence.of(clip, config.th_p, config)
    enough = (~np.isnan(evidence.confidence)).sum(-1) >= fewest_joints(len(skeleton))
    shared = np.flatnonzero(enough.any(-1).sum(1) >= max(2, config.th_v))
    stages += [(f"frames in which {max(2, config.th_v)} cameras or more detect people (th_v)", len(shared))]
    if not len(shared):
        return Explanation(tuple(stages), _suggestions_without_pairs(clip, config, enough))
    crowd = enough[shared].sum((1, 2)).mean()
    number = int(np.clip(_PAIRS / crowd**2, 1, _FRAMES))
    frames = shared[evenly_spaced(len(shared), number)]
    found = _bodies(evidence, evidence.rig, skeleton, frames, 1.0)
    stages += [
        (f"pairs of detections of two cameras, in {len(frames)} of these frames", found.pairs),
        (f"pairs that agree (affinity of {config.association.min_affinity:g} or more)", found.agreeing),
        (f"groups of them that make a body of {config.tracking.birth_joints} joints or more", found.bodies),
    ]
    suggestions = _other_readings(evidence, skeleton, frames, found)
    tracks = track(clip, config)
    stages.append(("tracks that were started", tracks.xyz.shape[1]))
    if tracks.xyz.shape[1]:
        for step, kept in steps_to_people(clip, tracks, config, evidence.noise, are_stills(clip.fps)):
            count = kept.xyz.shape[1]
            stages.append((_STEPS[step].format(config.tracking.min_duration_s), count))
            if not count:
                suggestions += _instead(step, tracks, clip, config)
                break
            tracks = kept
    elif not suggestions:
        suggestions = [
            "cameras do not agree: dmae doctor, with the same data=..., examines calibration and synchronisation"
        ]
    return Explanation(tuple(stages), tuple(suggestions))


def _suggestions_without_pairs(clip: Clip, config: CaptureConfig, enough: np.ndarray) -> tuple[str, ...]:
    detecting = [name for name, some in zip(clip.rig.names, np.any(enough, (0, 2)), strict=True) if some]
    if len(detecting) < max(2, config.th_v):
        return (
            f"people of {MIN_JOINTS} joints or more are detected by {len(detecting)} cameras only: "
            f"{', '.join(detecting) or 'none'}",
        )
    return (
        "cameras detect people in different frames: do their files number frames by one clock? "
        "data.offsets shifts them",
    )


@dataclass(frozen=True)
class _Compared:
    """Numbers of pairs of detections, of pairs that agree, of groups that form a body, and of joints that three views
    see."""

    pairs: int
    agreeing: int
    bodies: int
    joints: int


def _bodies(evidence: Evidence, rig: CameraRig, skeleton: Skeleton, frames: np.ndarray, zoom: float) -> _Compared:
    """Compare the detections of some frames, as seen by the cameras of another rig in images zoomed."""
    config = evidence.config
    pairs = agreeing = bodies = joints = 0
    part = Evidence(rig, evidence.xy[frames] * zoom, evidence.confidence[frames], config, evidence.noise)
    start, end = np.array(skeleton.bones, int).reshape(-1, 2).T
    all_rays = rig.rays(part.xy)
    for frame in range(len(frames)):
        confidence = part.confidence[frame]
        view, detection = np.nonzero((~np.isnan(confidence)).sum(-1) >= fewest_joints(len(skeleton)))
        weights = confidence[view, detection]
        candidates = Candidates.of(view, rig.centers, all_rays[frame, view, detection], weights)
        compared, agreed = count_pairs(candidates, config.association)
        pairs, agreeing = pairs + compared, agreeing + agreed
        if not compared:
            continue
        members = find_groups(candidates, config.association)
        absent = (members == NONE)[..., None] | np.isnan(weights[members])
        groups = np.where(absent, NONE, detection[members][..., None])
        if len(groups):
            points = part.at(frame).triangulate(groups[None], 2)
            xyz = points.xyz[0]
            known = (~np.isnan(xyz[..., 0])).sum(-1)
            length = np.linalg.norm(xyz[:, start] - xyz[:, end], axis=-1)
            whole = (known >= config.tracking.births(len(skeleton))) & ~(length > longest_bone(skeleton)).any(-1)
            # In a world that is too small, all rays meet and bones are too short.
            whole &= (length > _SHORTEST_BONE).any(-1) | (not len(start))
            bodies += int(whole.sum())
            views = points.views[0, whole]
            joints += int(views[views >= min(3, len(rig))].sum())
    return _Compared(pairs, agreeing, bodies, joints)


def _other_readings(evidence: Evidence, skeleton: Skeleton, frames: np.ndarray, found: _Compared) -> list[str]:
    """Return suggested changes that make the cameras agree, if a usual mistake explains the disagreement."""
    best, suggestions = max(2.0 * found.joints, 10.0 * len(frames)), []
    readings = sorted(product(_SCALES, _INVERSES, _ZOOMS), key=lambda r: (r[0] != 1) + r[1] + (r[2] != 1))
    for scale, inverse, zoom in readings[1:]:
        world = np.linalg.inv(evidence.rig.cam_from_world) if inverse else evidence.rig.cam_from_world.copy()
        world[:, :3, 3] *= scale
        joints = _bodies(evidence, replace(evidence.rig, cam_from_world=world), skeleton, frames, zoom).joints
        if joints > best:
            # A simpler explanation is preferred; one with more mistakes must explain clearly more.
            best = 1.3 * joints
            parts = [part for part in (_SCALES[scale], _INVERSES[inverse], _ZOOMS[zoom]) if part]
            suggestions = [f"{'; and '.join(parts)} ({joints:,} detected joints then agree, now {found.joints:,})"]
    return suggestions


_STEPS = {
    "people": "people that they are of",
    "volume": "of these inside capture.volume",
    "duration": "of these measured for {:g} s or more",
    "chance": "of these that agree better than passing ghosts would by chance",
    "agreement": "of these with views that agree on most joints",
    "motion": "of these that move, or agree better than ghosts at rest would by chance",
    "wanted": "of these asked for by capture.persons and capture.subject",
}


def _instead(step: str, tracks: Tracks, clip: Clip, config: CaptureConfig) -> list[str]:
    """Return suggested changes so that some of the tracks before a step remain."""
    skeleton = clip.detections.skeleton
    if step == "volume":
        places = median_known(tracks.xyz)
        low, high = np.nanmin(places, (0, 1)), np.nanmax(places, (0, 1))
        return [
            f"all people are outside capture.volume: x is {low[0]:.1f} to {high[0]:.1f} m, y {low[1]:.1f} to "
            f"{high[1]:.1f}, z {low[2]:.1f} to {high[2]:.1f}"
        ]
    if step == "duration":
        longest = well_measured(tracks, config.tracking.births(len(skeleton)))[0].sum(0).max(initial=0) / clip.fps
        return [
            f"the longest was measured for {longest:.2f} s: give a smaller capture.tracking.min_duration_s, or check "
            "that the cameras agree with dmae doctor"
        ]
    if step == "agreement":
        return ["cameras agree by coincidence only: dmae doctor examines calibration and synchronisation"]
    if step == "chance":
        return ["views agree no better than by chance: more cameras, or fewer ghosts, decide"]
    if step == "motion":
        return ["nobody moves, and views agree no better than by chance: more cameras, or fewer ghosts, decide"]
    if step == "wanted" and config.subject.leg_m is not None:
        legs = ", ".join(f"{leg:.2f}" for leg in leg_lengths(tracks.xyz, skeleton))
        return [f"legs are {legs} m long, which capture.subject.leg_m leaves out"]
    return []
