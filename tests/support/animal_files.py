"""Recordings of animals as DeepLabCut, SLEAP and movement write them, made without the project's own readers."""

import json
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import xarray

from dmae.data.clip import Clip
from dmae.formats.calibrations import write_calibration
from dmae.formats.writing import write_poses
from tests.support.animals import dog_clip

SPIDER = """name: spider
size_m: 0.02
joints:
  body:
  head: body
  l_leg: body
  r_leg: body
mirror: [[l_leg, r_leg]]
torso: [body, head]
stretching: [head]
"""


def _calibrated(folder: Path, clip: Clip | None, animals: int) -> Clip:
    clip = clip or dog_clip(4, dogs=animals)
    write_calibration(clip.rig, folder / "calibration.toml", "pose2sim")
    return clip


def write_deeplabcut(folder: Path, clip: Clip | None = None, kind: str = "h5", animals: int = 1) -> Clip:
    """A file for each camera, `h5` (a table), `fixed` or `csv`; of several animals with a level for them."""
    clip = _calibrated(folder, clip, animals)
    joints, count = list(clip.detections.skeleton.joints), clip.detections.xy.shape[2]
    levels, names = [["DLC_resnet50_x"], joints, ["x", "y", "likelihood"]], ["scorer", "bodyparts", "coords"]
    if count > 1:
        levels.insert(1, [f"animal{number}" for number in range(count)])
        names.insert(1, "individuals")
    columns = pd.MultiIndex.from_product(levels, names=names)
    for view, camera in enumerate(clip.rig.names):
        xy, score = clip.detections.xy[:, view], clip.detections.score[:, view]
        values = np.concatenate([xy, score[..., None]], -1).astype(float).reshape(len(clip), -1)
        table, path = pd.DataFrame(values, columns=columns), folder / f"{camera}DLC_resnet50_x"
        if kind == "csv":
            table.to_csv(path.with_suffix(".csv"))
        else:
            options = {"format": "table"} if kind == "h5" else {}
            table.to_hdf(path.with_suffix(".h5"), key="df_with_missing", mode="w", **options)
    return clip


def write_sleap(folder: Path, clip: Clip | None = None, said: bool = False, animals: int = 1) -> Clip:
    """An analysis file for each camera; those of newer versions say their axes, in an order of their own."""
    clip = _calibrated(folder, clip, animals)
    skeleton = clip.detections.skeleton
    for view, camera in enumerate(clip.rig.names):
        xy = clip.detections.xy[:, view].astype(float)
        score = np.nan_to_num(clip.detections.score[:, view].astype(float))
        with h5py.File(folder / f"{camera}.analysis.h5", "w") as file:
            file["node_names"] = np.array(skeleton.joints, "S")
            file["edge_inds"] = np.array(skeleton.bones)
            file["track_names"] = np.array([f"animal{number}" for number in range(xy.shape[1])], "S")
            file["tracks"] = xy if said else xy.transpose(1, 3, 2, 0)
            file["point_scores"] = score if said else score.transpose(1, 2, 0)
            if said:
                file["tracks"].attrs["dims"] = json.dumps(["frame", "track", "node", "xy"])
                file["point_scores"].attrs["dims"] = json.dumps(["frame", "track", "node"])
    return clip


def write_movement(folder: Path, clip: Clip | None = None, animals: int = 1, **names: str) -> Clip:
    """A data set for each camera, with other names of axes."""
    clip = _calibrated(folder, clip, animals)
    for view, camera in enumerate(clip.rig.names):
        xy, score = clip.detections.xy[:, view].astype(float), clip.detections.score[:, view].astype(float)
        xarray.Dataset(
            {
                "position": (("time", "space", "keypoints", "individuals"), xy.transpose(0, 3, 2, 1)),
                "confidence": (("time", "keypoints", "individuals"), score.transpose(0, 2, 1)),
            },
            {
                "time": np.arange(len(clip)) / clip.fps,
                "space": ["x", "y"],
                "keypoints": list(clip.detections.skeleton.joints),
                "individuals": [f"animal{number}" for number in range(xy.shape[1])],
            },
            {"fps": float(clip.fps), "time_unit": "seconds", "ds_type": "poses"},
        ).rename(names).to_netcdf(folder / f"{camera}.nc", engine="h5netcdf")
    return clip


def write_dogs_nc(folder: Path) -> None:
    """Poses in 3D on a skeleton of its own, as `dmae export format=movement` writes them."""
    write_poses(dog_clip(3), folder / "poses", "movement")
