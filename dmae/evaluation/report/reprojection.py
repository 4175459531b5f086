"""Reprojection errors: the distance between each joint, projected into each camera, and its detection there."""

from dataclasses import dataclass, fields

import numpy as np

from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.conversion import convert, scale_of
from dmae.evaluation.report.joint_groups import JointGroup, added, tally
from dmae.files.mapped import by_frames, release
from dmae.metrics.comparison import match, take_matched

GATE_M = 0.4
"""m, at the median depth of the people in a camera, for bodies of a person's size. A detection with a larger mean
distance shows another person."""
_CHUNK = 256


@dataclass(frozen=True)
class Reprojection:
    """Reprojection errors, px, of joints that were measured and of those that were completed.

    Attributes:
        measured: Tallies by breakdown ("camera", "person", "joint", and "all") and group.
        completed: The same for completed joints.
        worst: (F, P) largest error of a measured joint of each person in any camera; NaN where there is none.
        where: (F, P, 2) indices of its camera and joint.
    """

    measured: dict[str, dict[str, JointGroup]]
    completed: dict[str, dict[str, JointGroup]]
    worst: np.ndarray
    where: np.ndarray


def reprojection(clip: Clip) -> Reprojection:
    """Return the errors between poses and, in each frame and camera, the detections that fit them best."""
    poses = convert(clip.poses, clip.detections.skeleton)
    poses = poses.without(by_frames(lambda xyz: np.isinf(xyz).any(-1), poses.xyz))
    frames, persons, joints = poses.source.shape
    measured: dict[str, dict[str, JointGroup]] = {}
    completed: dict[str, dict[str, JointGroup]] = {}
    worst, where = np.full((frames, persons), np.nan), np.zeros((frames, persons, 2), int)
    for start in range(0, frames if persons else 0, _CHUNK):
        part = slice(start, start + _CHUNK)
        error = reprojection_errors(clip.select(frames=part), poses.select(part))
        source = np.broadcast_to(poses.source[part][:, None], error.shape)
        is_completed = source == Source.COMPLETED
        for kept, into in ((~is_completed, measured), (is_completed, completed)):
            for name, groups in _groups(clip, poses, np.where(kept, error, np.nan), source).items():
                into[name] = added(into.get(name, {}), groups)
        flat = np.where(is_completed, np.nan, error).transpose(0, 2, 1, 3).reshape(len(error), persons, -1)
        largest = np.where(np.isnan(flat), -1, flat).argmax(-1)
        worst[part] = np.take_along_axis(flat, largest[..., None], -1)[..., 0]
        where[part] = np.stack(np.divmod(largest, joints), -1)
        if frames > _CHUNK:
            release(clip.detections.xy, clip.detections.score, *(getattr(poses, f.name) for f in fields(poses)[1:]))
    return Reprojection(measured, completed, worst, where)


def reprojection_errors(clip: Clip, poses: Poses3D) -> np.ndarray:
    """Return the distances (F, V, P, J) between reprojected joints and those of the matched detection, px."""
    pixels, depth = clip.rig.project(poses.xyz)
    errors, scale = np.full(pixels.shape[:-1], np.nan), scale_of(poses)
    for view in range(len(clip.rig)):
        known = np.isfinite(pixels[:, view]).all(-1)
        if not known.any():
            continue
        gate = scale * GATE_M * clip.rig.K[view, 0, 0] / np.median(depth[:, view][known])
        found = clip.detections.xy[:, view]
        matched = take_matched(found, match(found, pixels[:, view], gate))
        errors[:, view] = np.linalg.norm(matched - pixels[:, view], axis=-1)
    return errors


def _groups(clip: Clip, poses: Poses3D, error: np.ndarray, source: np.ndarray) -> dict[str, dict[str, JointGroup]]:
    _, views, persons, joints = error.shape
    cuts = {
        "camera": {clip.rig.names[view]: np.s_[:, view] for view in range(views)},
        "person": {f"person {person}": np.s_[:, :, person] for person in range(persons)},
        "joint": {poses.skeleton.joints[joint]: np.s_[..., joint] for joint in range(joints)},
        "all": {"all": np.s_[:]},
    }
    return {
        name: {group: tally(error[cut], source[cut]) for group, cut in parts.items()} for name, parts in cuts.items()
    }
