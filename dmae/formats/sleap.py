"""SLEAP: one analysis file for the video of each camera."""

import json
from pathlib import Path

import numpy as np

from dmae.data.skeleton import Skeleton
from dmae.files.hdf5 import Hdf5, open_hdf5
from dmae.formats.recordings import NumberedDetections, camera_files
from dmae.formats.registry import reader
from dmae.formats.skeletons import NamedDetections, named_detections

_WHAT = "an analysis file of SLEAP"
_SUFFIX = ".analysis.h5"
_AXES = ("frame", "track", "node", "xy")
_MATLAB = ("track", "xy", "node", "frame")  # Axes of `tracks` in files that do not state them


@reader("sleap", signs=[["*.analysis.h5"]], cameras=False)
def read_detections(path: Path, *, skeleton: Skeleton | None = None) -> NumberedDetections:
    """SLEAP's <camera>.analysis.h5 of each camera, with a calibration of any format.

    Read one file per camera, with the name of the camera.

    The score of a point is its confidence. Points that people placed have no score; their confidence is 1.

    Args:
        skeleton: By default a skeleton for the names of the nodes and the edges, see
            `dmae.formats.skeletons.named_skeleton`.

    Raises:
        FileNotFoundError: there are no such files.
        ValueError: a file is malformed, or its nodes are not the joints of the skeleton.
    """
    files = camera_files(Path(path), f"*{_SUFFIX}")
    return named_detections({file.name.removesuffix(_SUFFIX): file for file in files}, _read, skeleton)


def _read(file: Path) -> NamedDetections:
    with open_hdf5(file, _WHAT) as analysis:
        names = analysis.texts("node_names")
        xy = _in_order(file, analysis, "tracks", _MATLAB)
        if xy.shape[2:] != (len(names), 2):
            raise ValueError(f"{file}: expected tracks of {len(names)} nodes, found the shape {xy.shape}")
        score = np.ones(xy.shape[:-1])
        if "point_scores" in analysis:
            score = _in_order(file, analysis, "point_scores", tuple(axis for axis in _MATLAB if axis != "xy"))
            if score.shape != xy.shape[:-1]:
                raise ValueError(f"{file}: expected point_scores of shape {xy.shape[:-1]}, found {score.shape}")
            # Points that people placed have no score.
            score = np.where(np.isnan(score) | (score == 0), 1.0, score)
        edges = analysis.array("edge_inds") if "edge_inds" in analysis else np.empty((0, 2))
    animals = np.concatenate([xy, score[..., None]], -1)
    if edges.size == 0:
        return NamedDetections(names, animals)
    if edges.ndim != 2 or edges.shape[1] != 2 or not ((edges >= 0) & (edges < len(names))).all():
        raise ValueError(f"{file}: expected edge_inds, pairs of numbers of its {len(names)} nodes")
    return NamedDetections(names, animals, edges=[(int(parent), int(child)) for parent, child in edges])


def _in_order(file: Path, analysis: Hdf5, name: str, usual: tuple[str, ...]) -> np.ndarray:
    """Return an array with its axes in the order frame, track, node, xy."""
    values, said = analysis.array(name).astype(np.float64), analysis.attribute("dims", name)
    axes = usual
    if isinstance(said, str):
        try:
            axes = tuple(json.loads(said))
        except (ValueError, TypeError, RecursionError):
            axes = ()
    if sorted(axes) != sorted(usual) or values.ndim != len(axes):
        raise ValueError(f"{file}: expected {name} of the axes {', '.join(usual)}, found {said} and {values.shape}")
    return values.transpose([axes.index(axis) for axis in _AXES if axis in axes])
