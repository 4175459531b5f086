"""Recordings as other programs write them, made without the project's own writers."""

import json
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip, Detections2D
from dmae.data.skeleton import Skeleton
from dmae.formats.calibrations import write_calibration
from tests.support.clips import looking_at_origin, walkers


def recording(skeleton: Skeleton, frames: int = 12, views: int = 4) -> Clip:
    """Two walkers, exactly projected, some joints unseen."""
    rig, truth = looking_at_origin(views), walkers(frames, skeleton=skeleton)
    xy, _ = rig.project(truth.xyz)
    rng = np.random.default_rng(0)
    score = np.where(rng.random(xy.shape[:-1]) < 0.1, np.nan, rng.uniform(0.3, 1, xy.shape[:-1]))
    xy[np.isnan(score)] = np.nan
    return Clip(id="walk", fps=25.0, rig=rig, detections=Detections2D(skeleton, xy, score))


def people(clip: Clip, frame: int, view: int) -> list[dict]:
    """As OpenPose writes them: 0, 0, 0 where a joint is missing."""
    values = np.concatenate([clip.detections.xy, clip.detections.score[..., None]], -1)[frame, view]
    found = [np.nan_to_num(person).ravel().tolist() for person in values if np.isfinite(person).any()]
    return [{"person_id": [-1], "pose_keypoints_2d": joints, "hand_left_keypoints_2d": []} for joints in found]


def write_frames(clip: Clip, folder: Path, name: str = "{camera}/{camera}_{frame:012d}_keypoints.json", first: int = 0):
    """A file for each camera and frame."""
    for frame in range(len(clip)):
        for view, camera in enumerate(clip.rig.names):
            file = folder / name.format(camera=camera, frame=first + frame)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(json.dumps({"version": 1.3, "people": people(clip, frame, view)}))


def write_openpose_recording(clip: Clip, folder: Path, **names) -> Path:
    """Frames and a calibration."""
    write_frames(clip, folder, **names)
    write_calibration(clip.rig, folder / "calibration.toml", "pose2sim")
    return folder


def same_detections(found: Detections2D, wanted: Detections2D, atol: float = 1e-3) -> None:
    """Assert that they are equal, but for their order within a view and for empty places."""
    assert found.skeleton == wanted.skeleton
    assert found.xy.shape[:2] == wanted.xy.shape[:2]
    for frame in range(len(wanted.xy)):
        for view in range(wanted.xy.shape[1]):
            rows = [np.concatenate([d.xy, d.score[..., None]], -1)[frame, view] for d in (found, wanted)]
            rows = [part[np.isfinite(part).any((1, 2))] for part in rows]
            rows = [part[np.argsort(np.nansum(part, (1, 2)))] for part in rows]
            np.testing.assert_allclose(*rows, atol=atol)
