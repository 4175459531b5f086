"""Rigs: presets match the published cameras, files match lists, and faults are refused."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import synth
from dmae.cli import compose
from dmae.formats.calibrations import calibration_format, read_calibration, write_calibration
from dmae.formats.config import UpDirection
from synth.cli import SYNTH
from synth.errors import FailedSimulation
from synth.rigs.config import CameraConfig, JitterConfig, MiscalibrationConfig, RigConfig, RingConfig
from synth.rigs.coverage import Stage, area
from synth.rigs.rig import calibration_error, make_rig, miscalibrate
from tests.support.rigs import AHEAD, LEFT, PRESETS, config, preset

POINTS = area(Stage())[None]


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.mark.parametrize(("name", "moved"), [("shelf", (0, 0, 0)), ("campus", (1.85, 4.76, 0))])
def test_presets_are_the_published_calibrations(data_folder, name, moved):
    rig = preset(name)
    published = json.loads((data_folder / "rigs" / f"calibration_{name}.json").read_text())
    assert list(rig.names) == list(published)
    for view, camera in enumerate(published.values()):
        K = [[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1]]
        np.testing.assert_allclose(rig.K[view], K, atol=1e-4)
        np.testing.assert_allclose(rig.cam_from_world[view, :3, :3], camera["R"], atol=2e-6)
        np.testing.assert_allclose(rig.centers[view] + moved, np.ravel(camera["T"]) / 1000, atol=1e-5)


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_sees_a_person_in_the_middle(name):
    rig = preset(name)
    person = np.array([[[0, 0, 0.9]], [[0, 0, 1.2]]])
    assert rig.inside(rig.project(person)[0]).all()
    R = rig.cam_from_world[:, :3, :3]
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (len(rig), 1, 1)), atol=1e-12)


def test_all_documented_presets_exist():
    assert {"shelf", "campus", "studio5", "ring", "dome", "random"} <= set(PRESETS)
    assert {name: len(preset(name)) for name in ("shelf", "campus", "studio5", "dome")} == {
        "shelf": 5, "campus": 3, "studio5": 5, "dome": 31
    }  # fmt: skip
    assert preset("studio5").distorted.all()


def test_a_camera_has_its_position_and_looks_at_its_target_upright():
    camera = CameraConfig("a", [640, 480], focal=500.0, position=[2, -3, 1.5], target=[0.1, 0.2, 1], fisheye=True)
    rig = make_rig(RigConfig(cameras=[camera]), rng=rng())
    np.testing.assert_allclose(rig.centers, [[2, -3, 1.5]])
    xy, _ = rig.project(np.array([[[0.1, 0.2, 1], [0.1, 0.2, 1.5]]]))
    np.testing.assert_allclose(xy[0, 0, 0], (319.5, 239.5), atol=1e-9)
    assert abs(xy[0, 0, 1, 0] - 319.5) < 1e-9
    assert xy[0, 0, 1, 1] < 239.5
    assert rig.fisheye.all()


def test_four_coefficients_of_a_lens_are_enough():
    k = [-0.02, 0.005, -0.003, 0.001]
    rig = make_rig(RigConfig(cameras=[CameraConfig(**LEFT | {"dist": k, "fisheye": True})]), rng=rng())
    np.testing.assert_array_equal(rig.dist, [[*k, 0.0]])


def test_a_camera_may_look_straight_down():
    camera = CameraConfig("top", [640, 480], focal=300.0, position=[0, 0, 4], target=[0, 0, 0])
    rig = make_rig(RigConfig(cameras=[camera]), rng=rng())
    np.testing.assert_allclose(rig.project(np.zeros((1, 1, 3)))[0], [[[[319.5, 239.5]]]], atol=1e-9)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"K": [1.0] * 8}, r"expected K of 9 numbers, found \[1"),
        ({"K": []}, "expected K of 9 numbers, found no such key"),
        ({"cam_from_world": [0.0] * 16}, "expected cam_from_world to end with a row 0 0 0 1, found"),
        ({"cam_from_world": [0.0] * 13}, "expected cam_from_world of 12 or 16 numbers, found"),
        ({"dist": [0.0] * 3}, "expected dist of 4 or 5 or 6 or 7 or 8 numbers, found"),
        ({"cam_from_world": [0.0] * 12}, "to be a right-handed rotation"),
        ({"cam_from_world": [-x for x in AHEAD]}, "to be a right-handed rotation"),
        ({"K": [-50.0, 0, 32, 0, 50, 24, 0, 0, 1]}, "expected K of positive focal lengths"),
        ({"focal": 50.0}, "expected either K or focal, found both"),
        ({"K": [], "focal": -50.0}, "expected focal of positive focal lengths, found -50"),
        ({"size": [0, 48]}, "expected size to be a positive whole width and height"),
        ({"size": [64]}, "expected size of 2 numbers, found"),
        ({"cam_from_world": [], "position": [1.0, 2, 3]}, "expected target of 3 numbers, found no such key"),
        ({"position": [1.0, 2, 3], "target": [0.0] * 3}, "either cam_from_world or position, found both"),
        (
            {"cam_from_world": [], "position": [1.0] * 3, "target": [1.0] * 3},
            "target that is not the position",
        ),
        ({"fisheye": True, "dist": [0.0, 0, 0, 0, 1]}, "a fisheye has four coefficients"),
        ({"cam_from_world": [float("nan")] * 12}, "expected cam_from_world of finite numbers"),
    ],
)
def test_a_malformed_camera_is_named(change, complaint):
    with pytest.raises(ValueError, match="'mine'.*'left'.*" + complaint):
        make_rig(RigConfig(name="mine", cameras=[CameraConfig(**LEFT | change)]), rng=rng())


def test_a_preset_has_matrices_by_rows_as_the_page_on_calibration_writes_them(tmp_path):
    page = (Path(__file__).parents[3] / "docs" / "how-to" / "calibration.md").read_text()
    listed = next(part.partition("```")[0] for part in page.split("```yaml\n") if part.startswith("cameras:"))
    file = tmp_path / "rig" / "mine.yaml"
    file.parent.mkdir()
    file.write_text(listed)
    wanted = make_rig(RigConfig(path=str(file)), rng=rng())
    composed = compose(SYNTH.commands["generate"], [f"rig={file}"]).rig
    for found in (synth.preset("rig", str(file)), composed):
        rig = make_rig(found, rng=rng())
        np.testing.assert_array_equal(rig.K, wanted.K)
        np.testing.assert_array_equal(rig.cam_from_world, wanted.cam_from_world)


def test_two_cameras_of_one_name_are_refused():
    with pytest.raises(ValueError, match=r"'mine': expected cameras of different names, found 'left' twice"):
        make_rig(RigConfig(name="mine", cameras=[CameraConfig(**LEFT)] * 2), rng=rng())


@pytest.mark.parametrize("name", ["", "..", "a/b", "../../escape"])
def test_camera_names_must_be_file_names(name):
    with pytest.raises(ValueError, match=r"'mine', camera .*expected a file's name"):
        make_rig(RigConfig(name="mine", cameras=[CameraConfig(**LEFT | {"name": name})]), rng=rng())


@pytest.mark.parametrize("change", [{"origin": [0.0, 0]}, {"size": [640]}, {"size": [0, 480]}])
def test_malformed_rigs_are_refused(change):
    with pytest.raises(ValueError, match=r"rig\." + next(iter(change))):
        RigConfig(**change)


@pytest.mark.parametrize("format", [name for name, each in calibration_format.items() if each.write])
@pytest.mark.parametrize("name", PRESETS)
def test_every_calibration_format_keeps_every_pixel_of_every_rig(name, format, tmp_path):
    rig, path = preset(name), tmp_path / "calibration"
    if rig.fisheye.any() and format != "pose2sim":
        with pytest.raises(ValueError, match="camera"):
            write_calibration(rig, path, format)
        return
    write_calibration(rig, path, format)
    # Through the generator, as `rig.path=`; once with another origin.
    again = make_rig(RigConfig(path=str(path)), rng=rng())
    assert again.names == rig.names
    np.testing.assert_array_equal(again.size, rig.size)
    before, after = rig.project(POINTS)[0], again.project(POINTS)[0]
    np.testing.assert_array_equal(np.isnan(before), np.isnan(after))
    assert np.nanmax(np.abs(before - after)) < 1e-3
    moved = make_rig(RigConfig(path=str(path), origin=[0.2, 0.1, 0]), rng=rng())
    assert np.nanmax(np.abs(before - moved.project(POINTS - [0.2, 0.1, 0])[0])) < 1e-3


def test_published_calibration_files_make_rigs(data_folder):
    shelf = make_rig(RigConfig(path=str(data_folder / "rigs" / "calibration_shelf.json"), size=[1032, 776]), rng=rng())
    np.testing.assert_allclose(shelf.centers, preset("shelf").centers, atol=1e-4)
    campus = str(data_folder / "rigs" / "calibration_campus.json")
    moved = make_rig(RigConfig(path=campus, size=[360, 288], origin=[1.85, 4.76, 0]), rng=rng())
    np.testing.assert_allclose(moved.centers, preset("campus").centers, atol=1e-4)
    path = data_folder / "pose2sim" / "S00_Calibration" / "Calib_qualisys.toml"
    rig = make_rig(RigConfig(path=str(path)), rng=rng(), stage=Stage(radius=1.5))
    np.testing.assert_allclose(rig.centers, read_calibration(path).centers, atol=1e-9)
    assert len(rig) == 4


def test_a_file_without_a_valid_rig_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nowhere\.toml"):
        make_rig(RigConfig(path=str(tmp_path / "nowhere.toml")), rng=rng())
    path = tmp_path / "upside_down.toml"
    write_calibration(preset("shelf"), path, "pose2sim")
    # The origin sets the height of the floor.
    lifted = make_rig(RigConfig(path=str(path), origin=[0, 0, -0.5]), rng=rng())
    np.testing.assert_allclose(lifted.centers, preset("shelf").centers + [0, 0, 0.5], atol=1e-6)
    with pytest.raises(FailedSimulation, match=r"upside_down\.toml'.*camera '0'.*under the floor.*rig\.up"):
        make_rig(RigConfig(path=str(path), up=UpDirection.minus_z), rng=rng())


def test_jitter_displaces_each_camera_anew_for_each_clip():
    still, jitter = config("shelf"), JitterConfig(position=0.05, rotation=0.01)
    rig = make_rig(still, rng=rng())
    clips = [make_rig(replace(still, jitter=jitter), rng=np.random.default_rng(seed)) for seed in range(200)]
    again = make_rig(replace(still, jitter=jitter), rng=rng())
    np.testing.assert_array_equal(again.cam_from_world, clips[0].cam_from_world)
    shifts = np.stack([clip.centers - rig.centers for clip in clips])
    turned = [clip.cam_from_world[:, :3, :3] @ rig.cam_from_world[:, :3, :3].swapaxes(1, 2) for clip in clips]
    turns = np.stack([Rotation.from_matrix(turn).as_rotvec() for turn in turned])
    for found, wanted in ((shifts, 0.05), (turns, 0.01)):
        np.testing.assert_allclose(found.std((0, 1)), wanted, rtol=0.1)
        assert np.abs(found.mean((0, 1))).max() < 0.1 * wanted
    np.testing.assert_array_equal(clips[0].K, rig.K)


def test_jitter_does_not_change_other_draws():
    plain, jittered = (
        make_rig(replace(config("ring"), jitter=jitter), rng=rng()) for jitter in (JitterConfig(), JitterConfig(0.01))
    )
    assert 0 < np.linalg.norm(plain.centers - jittered.centers, axis=1).max() < 0.1


def test_without_miscalibration_there_is_one_rig():
    assert miscalibrate(preset("shelf"), MiscalibrationConfig(), rng=rng()) is None


@pytest.mark.parametrize("name", ["shelf", "studio5", "random"])
def test_miscalibration_has_the_given_standard_deviations(name):
    rig = preset(name)
    error = MiscalibrationConfig(focal=0.01, principal_point=3, distortion=0.002, rotation=0.004, translation=0.02)
    found = [miscalibrate(rig, error, rng=np.random.default_rng(seed)) for seed in range(300)]
    for values, wanted in (
        ([r.K[:, [0, 1], [0, 1]] / rig.K[:, [0, 1], [0, 1]] - 1 for r in found], 0.01),
        ([r.K[:, :2, 2] - rig.K[:, :2, 2] for r in found], 3),
        ([r.dist[:, 0] - rig.dist[:, 0] for r in found], 0.002),
        ([r.centers - rig.centers for r in found], 0.02),
    ):
        assert abs(np.std(values) / wanted - 1) < 0.1
        assert abs(np.mean(values)) < 0.1 * wanted
    turned = [r.cam_from_world[:, :3, :3] @ rig.cam_from_world[:, :3, :3].swapaxes(1, 2) for r in found]
    turns = np.stack([Rotation.from_matrix(turn).as_rotvec() for turn in turned])
    np.testing.assert_allclose(turns.std((0, 1)), 0.004, rtol=0.1)
    assert found[0].names == rig.names
    np.testing.assert_array_equal(found[0].size, rig.size)


def test_each_miscalibration_changes_its_own_numbers_only():
    rig = preset("shelf")
    for kind, changed in (
        ("focal", "K"), ("principal_point", "K"), ("distortion", "dist"),
        ("rotation", "cam_from_world"), ("translation", "cam_from_world"),
    ):  # fmt: skip
        reported = miscalibrate(rig, MiscalibrationConfig(**{kind: 1e-3}), rng=rng())
        for name in ("K", "dist", "cam_from_world"):
            same = np.allclose(getattr(rig, name), getattr(reported, name), rtol=0, atol=1e-12)
            assert same == (name != changed), (kind, name)


def test_the_calibration_error_is_in_pixels():
    rig = preset("shelf")
    K = rig.K.copy()
    K[1, :2, 2] += (3, 4)
    np.testing.assert_allclose(calibration_error(rig, replace(rig, K=K), Stage()), [0, 5, 0, 0, 0], atol=1e-3)


@pytest.mark.parametrize("kind", [JitterConfig, MiscalibrationConfig])
@pytest.mark.parametrize("value", [-0.1, float("nan"), float("inf")])
def test_invalid_standard_deviations_are_refused(kind, value):
    with pytest.raises(ValueError, match="rotation: expected 0 or more"):
        kind(rotation=value)


def test_places_of_cameras_are_refused_for_a_rig_that_lists_them():
    with pytest.raises(ValueError, match=r"rig\.ring: has no effect, as rig=shelf lists its cameras; choose rig=ring"):
        synth.preset("rig", "shelf", ring=RingConfig(views=3))
    assert synth.preset("rig", "ring", ring=RingConfig(views=3)).ring.views == 3
