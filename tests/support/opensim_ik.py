"""OpenSim's scaling and inverse kinematics with Pose2Sim's models, on our TRC. Needs `opensim` and `pose2sim`."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip
from dmae.formats.writing import write_poses

_FILES = {
    "body25": "Body25",
    "body25b": "Body25b",
    "halpe26": "Halpe26",
    "coco17": "Coco17",
    "blazepose33": "Blazepose",
}
_MARKERS = _FILES | {"blazepose33": "BlazePose"}


def setup_folder() -> Path | None:
    """Return the folder with Pose2Sim's models and set-ups; None if `opensim` or `pose2sim` is not installed."""
    found = find_spec("Pose2Sim")
    if found is None or find_spec("opensim") is None:
        return None
    return Path(found.submodule_search_locations[0], "OpenSim_Setup")


def opensim_angles(clip: Clip, folder: Path) -> list[dict[str, np.ndarray]]:
    """Return the coordinates (F,) of each person in `clip.poses` by name: degrees, and m for `pelvis_tx` and so on.

    The model is scaled to the distances between markers over all frames, and its markers are not moved.

    Args:
        clip: Its poses are of one of Pose2Sim's skeletons.
        folder: For the files.
    """
    import opensim

    setup, name = setup_folder(), clip.poses.skeleton.name
    opensim.Logger.removeFileSink()
    opensim.Logger.setLevelString("off")
    opensim.ModelVisualizer.addDirToGeometrySearchPaths(str(setup / "Geometry"))
    folder.mkdir(parents=True, exist_ok=True)
    files = [file for file in write_poses(clip, folder / "a.trc", "trc").files if file.suffix == ".trc"]
    return [_angles(opensim, setup, name, file) for file in files]


def _angles(opensim, setup: Path, name: str, trc: Path) -> dict[str, np.ndarray]:
    times = list(opensim.TimeSeriesTableVec3(str(trc)).getIndependentColumn())
    unscaled, scaled, motion = (str(trc.with_suffix(suffix)) for suffix in (".unscaled.osim", ".osim", ".opensim.mot"))
    model = opensim.Model(str(setup / "Model_Pose2Sim_simple.osim"))
    model.updateMarkerSet(opensim.MarkerSet(str(setup / f"Markers_{_MARKERS[name]}.xml")))
    model.initSystem()
    model.printToXML(unscaled)
    scaling = opensim.ScaleTool(str(setup / f"Scaling_Setup_Pose2Sim_{_FILES[name]}.xml"))
    scaling.setPathToSubject("")
    scaling.getGenericModelMaker().setModelFileName(unscaled)
    scaler = scaling.getModelScaler()
    scaler.setMarkerFileName(str(trc))
    span = opensim.ArrayDouble()
    span.append(times[0])
    span.append(times[-1])
    scaler.setTimeRange(span)
    scaler.setOutputModelFileName(scaled)
    scaling.getMarkerPlacer().setApply(False)
    scaling.run()
    tool = opensim.InverseKinematicsTool(str(setup / f"IK_Setup_Pose2Sim_{_FILES[name]}.xml"))
    tool.set_model_file(scaled)
    tool.setMarkerDataFileName(str(trc))
    tool.setOutputMotionFileName(motion)
    tool.setResultsDir(str(trc.parent))
    tool.setStartTime(times[0])
    tool.setEndTime(times[-1])
    tool.run()
    lines = Path(motion).read_text().splitlines()
    start = lines.index("endheader") + 1
    rows = np.array([[float(cell) for cell in line.split()] for line in lines[start + 1 :]])
    # Frames without any marker have no row.
    frames = np.searchsorted(times, rows[:, 0] - 1e-6)
    found = np.full((len(times), rows.shape[1]), np.nan)
    found[frames] = rows
    return dict(zip(lines[start].split(), found.T, strict=True))
