"""Recordings as Caliscope, FreeMoCap, MMPose, MediaPipe and the paper's code write them, made without our writers."""

import json
import pickle
from pathlib import Path

import numpy as np
import tomlkit

from dmae.data.clip import Clip, Detections2D
from dmae.data.skeleton import BLAZEPOSE33, BODY21, BODY25, COCO17, Skeleton
from dmae.files.structured import read_toml
from dmae.formats.calibrations import write_calibration
from dmae.formats.config import Convention, LengthUnit, UpDirection
from tests.support.recordings import recording


def one_person(skeleton: Skeleton = BLAZEPOSE33, frames: int = 6, views: int = 3) -> Clip:
    """A clip of one person, with confidences of 1."""
    clip = recording(skeleton, frames, views)
    xy = clip.detections.xy[:, :, :1]
    score = np.where(np.isnan(xy[..., 0]), np.nan, 1.0)
    return Clip(clip.id, 25.0, clip.rig, Detections2D(skeleton, xy, score))


def write_caliscope(folder: Path, clip: Clip | None = None, tracker: str = "HOLISTIC") -> Clip:
    """A project with one recording; points of hands follow those of the body."""
    clip = clip or one_person()
    cameras = folder / "camera_array.toml"
    write_calibration(clip.rig, cameras, "pose2sim")
    cameras.write_text(tomlkit.dumps({"cameras": read_toml(cameras)}))
    lines = ["sync_index,port,frame_index,frame_time,point_id,img_loc_x,img_loc_y,obj_loc_x,obj_loc_y"]
    for frame in range(len(clip)):
        for view in range(len(clip.rig)):
            start = f"{frame},{view},{frame + 3},{7000 + frame / 25 + view / 1000:.6f}"
            for point, (x, y) in enumerate(clip.detections.xy[frame, view, 0]):
                if np.isfinite(x):
                    lines.append(f"{start},{point},{x:.3f},{y:.3f},,")
            lines.append(f"{start},100,5,6,,")
    points = folder / f"recordings/walk/{tracker}/xy_{tracker}.csv"
    points.parent.mkdir(parents=True)
    points.write_text("\n".join(lines) + "\n")
    return clip


def write_freemocap(folder: Path, clip: Clip | None = None, depth: bool = False, corner: bool = False) -> Clip:
    """A recording with its calibration in mm, in the world of a camera for which y points down.

    Absent points are NaN, or at the `corner` of the image.
    """
    clip = clip or one_person()
    written = Convention(LengthUnit.mm, UpDirection.minus_y).written_rig(clip.rig)
    write_calibration(written, folder / "walk_camera_calibration.toml", "pose2sim")
    values = np.full((len(clip.rig), len(clip), 543, 3 if depth else 2), np.nan)
    values[:, :, :33, :2] = clip.detections.xy[:, :, 0].swapaxes(0, 1)
    if corner:
        values = np.nan_to_num(values)
    if depth:
        # In px, negative in front of the hips
        values[:, :, :33, 2] = np.linspace(-300, 300, 33)
    data = folder / "output_data/raw_data"
    data.mkdir(parents=True)
    np.save(data / "mediapipe_2dData_numCams_numFrames_numTrackedPoints_pixelXY.npy", values)
    return clip


def mmpose_frames(clip: Clip, view: int, arrays: bool = False) -> list[dict]:
    """The frames of a camera, with lists of numbers or with arrays."""
    frames = []
    for frame, (people, scores) in enumerate(
        zip(clip.detections.xy[:, view], clip.detections.score[:, view], strict=True)
    ):
        instances = []
        for xy, score in zip(np.nan_to_num(people), np.nan_to_num(scores), strict=True):
            values = {"keypoints": xy.astype(float), "keypoint_scores": score.astype(float)}
            instances.append(values if arrays else {name: each.tolist() for name, each in values.items()})
        frames.append({"frame_id": frame, "instances": instances})
    return frames


def write_mmpose(folder: Path, clip: Clip | None = None, kind: str = "json") -> Clip:
    """A file of predictions for each camera, JSON or pickle, or for each frame of a camera (`frames`)."""
    clip = clip or recording(COCO17, 3, 2)
    write_calibration(clip.rig, folder / "calibration.toml", "pose2sim")
    (folder / "predictions").mkdir()
    for view, name in enumerate(clip.rig.names):
        frames = mmpose_frames(clip, view, arrays=kind == "pkl")
        if kind == "json":
            content = {"meta_info": {"dataset_name": "coco"}, "instance_info": frames}
            (folder / f"predictions/{name}.json").write_text(json.dumps(content))
        elif kind == "frames":
            (folder / "predictions" / name).mkdir()
            for number, frame in enumerate(frames):
                (folder / f"predictions/{name}/{number:06d}.json").write_text(json.dumps(frame["instances"]))
        else:
            (folder / f"predictions/{name}.pkl").write_bytes(pickle.dumps(frames))
    return clip


def write_coco_results(folder: Path, clip: Clip | None = None) -> Clip:
    """A list of results for each camera, as top-down detectors write them, in no file of annotations."""
    clip = clip or recording(COCO17, 3, 2)
    write_calibration(clip.rig, folder / "Calib.toml", "pose2sim")
    (folder / "keypoints").mkdir()
    for view, name in enumerate(clip.rig.names):
        rows = np.concatenate([clip.detections.xy, clip.detections.score[..., None]], -1)[:, view]
        results = [
            {"image_id": frame, "category_id": 1, "keypoints": np.nan_to_num(person).ravel().tolist(), "score": 1.0}
            for frame, people in enumerate(rows)
            for person in people
            if np.isfinite(person).any()
        ]
        (folder / "keypoints" / f"{name}.json").write_text(json.dumps(results))
    return clip


def mediapipe_frames(clip: Clip, view: int) -> list[dict]:
    """The frames of a camera, with x and y as shares of the image; joints that are absent have visibility 0."""
    width, height = clip.rig.size[view]
    frames = []
    for frame, (people, scores) in enumerate(
        zip(clip.detections.xy[:, view].astype(float), clip.detections.score[:, view].astype(float), strict=True)
    ):
        landmarks = [
            [
                {"x": (x + 0.5) / width, "y": (y + 0.5) / height, "z": -0.1, "visibility": score}
                for (x, y), score in zip(np.nan_to_num(xy), np.nan_to_num(joints), strict=True)
            ]
            for xy, joints in zip(people, scores, strict=True)
        ]
        frames.append({"frame": frame, "landmarks": landmarks})
    return frames


def write_mediapipe(folder: Path, clip: Clip | None = None) -> Clip:
    """A file of landmarks for each camera."""
    clip = clip or recording(BLAZEPOSE33, 3, 2)
    write_calibration(clip.rig, folder / "calibration.toml", "pose2sim")
    (folder / "mediapipe").mkdir()
    for view, name in enumerate(clip.rig.names):
        (folder / f"mediapipe/{name}.json").write_text(json.dumps(mediapipe_frames(clip, view)))
    return clip


def write_released(folder: Path, clip: Clip | None = None, joints: str = "meta") -> Clip:
    """What the paper's scripts write of a recording: lists of dictionaries of arrays, in pickles."""
    clip = clip or recording(BODY25, 3, 2)
    rig = clip.rig
    cameras = [
        {"P": rig.projections[v].tolist(), "K": rig.K[v].tolist(), "R": rig.cam_from_world[v, :3, :3].tolist(),
         "T": rig.cam_from_world[v, :3, 3], "res": [960.0, 600.0], "id": v, "Pos": rig.centers[v][:, None]}
        for v in range(len(rig))
    ]  # fmt: skip
    np.save(folder / "camera_params.npy", cameras, allow_pickle=True)
    values = np.nan_to_num(np.concatenate([clip.detections.xy / (959, 599), clip.detections.score[..., None]], -1))
    if joints == "filtered_skel":
        values = values[..., [j for j, joint in enumerate(BODY25.joints) if joint in BODY21.joints], :]
    found = {
        f"img_{v}": {
            f"{300 + n:04d}": [{"identity": i, joints: person} for i, person in enumerate(values[n, v])]
            for n in range(len(clip))
        }
        for v in range(len(rig))
    }
    np.save(folder / "shelf_eval_2d_detection_dict.npy", found, allow_pickle=True)
    return clip
