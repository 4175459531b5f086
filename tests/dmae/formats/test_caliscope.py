"""Projects of Caliscope, in the layouts of its versions."""

import numpy as np
import pytest

import dmae
from dmae.data.skeleton import BLAZEPOSE33, HALPE26
from dmae.formats.calibrations import read_calibration, recognise
from tests.support.calibrations import K, R, T
from tests.support.recordings import same_detections
from tests.support.tracked_recordings import one_person, write_caliscope


@pytest.mark.parametrize("place", ["", "recordings/walk", "recordings/walk/HOLISTIC"])
def test_a_project_is_read_from_any_of_its_folders(tmp_path, place):
    clip = write_caliscope(tmp_path)
    options = {"calibration": str(tmp_path / "camera_array.toml")} if place.endswith("HOLISTIC") else {}
    read = dmae.read(tmp_path / place, **options)
    same_detections(read.detections, clip.detections)
    assert read.detections.skeleton == BLAZEPOSE33
    assert read.fps == 25
    np.testing.assert_allclose(read.rig.cam_from_world, clip.rig.cam_from_world, atol=1e-9)


def test_the_tracker_tells_the_skeleton(tmp_path):
    clip = write_caliscope(tmp_path, one_person(HALPE26), "RTMPOSE_M_HALPE26")
    read = dmae.read(tmp_path)
    assert read.detections.skeleton == HALPE26
    same_detections(read.detections, clip.detections)


def test_older_projects_have_the_cameras_in_config_toml(tmp_path):
    table = f"port = 4\nsize = [1000, 600]\nmatrix = {K.tolist()}\ndistortions = [-0.2, 0.05, 0.01, -0.02, -0.1]\n"
    pose = f"translation = {T.tolist()}\nrotation = [1.2, -0.7, 0.4]\n"
    (tmp_path / "config.toml").write_text(f"fps_recording = 24\n\n[cam_4]\n{table}{pose}\n[charuco]\ncolumns = 4\n")
    assert recognise(tmp_path / "config.toml") == "caliscope"
    rig = read_calibration(tmp_path / "config.toml")
    assert rig.names == ("4",)
    np.testing.assert_allclose(rig.cam_from_world[0, :3, :3], R, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("port", "door"), "expected the columns sync_index, port"),
        (lambda text: text.replace(",1,", ",x,"), "line .*expected numbers"),
        (lambda text: text.splitlines()[0], "expected a row for each point, found none"),
        (lambda text: text + "1,2,3\n", "expected 9 cells, found 3"),
        (lambda text: text.replace("\n0,0,", "\n-1,0,"), "expected whole numbers of frames, cameras and points"),
    ],
)
def test_malformed_points_are_refused_by_name(tmp_path, change, message):
    write_caliscope(tmp_path)
    (file,) = tmp_path.glob("recordings/*/*/xy_*.csv")
    file.write_text(change(file.read_text()))
    with pytest.raises(ValueError, match=message) as caught:
        dmae.read(tmp_path)
    assert file.name in str(caught.value)


def test_several_recordings_and_unknown_trackers_are_answered_with_what_to_give(tmp_path):
    write_caliscope(tmp_path, tracker="FINGERS")
    with pytest.raises(ValueError, match=r"expected a tracker called .*skeleton=\.\.\."):
        dmae.read(tmp_path)
    assert dmae.read(tmp_path, skeleton="blazepose33").detections.observed.any()
    again = tmp_path / "recordings/run/POSE"
    again.mkdir(parents=True)
    (again / "xy_POSE.csv").write_text("sync_index\n")
    with pytest.raises(ValueError, match="expected the points of one recording and tracker"):
        dmae.read(tmp_path)
