"""Rigs: the presets are the published cameras, and MuJoCo's cameras are the rig's."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from omegaconf import OmegaConf

from dmae.cameras import CameraRig
from synth.rigs import CameraConfig, RigConfig, RingConfig, add_cameras, camera_name, make_rig, pinhole, warp

CONFIGS = Path(__file__).parents[2] / "configs" / "rig"


def preset(name: str) -> CameraRig:
    config = OmegaConf.merge(OmegaConf.structured(RigConfig), OmegaConf.load(CONFIGS / f"{name}.yaml"))
    return make_rig(OmegaConf.to_object(config), rng=np.random.default_rng(0))


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


@pytest.mark.parametrize("name", ["shelf", "campus", "ring"])
def test_every_preset_sees_a_person_in_the_middle(name):
    rig = preset(name)
    person = np.array([[[0, 0, 0.9]], [[0, 0, 1.2]]])
    assert rig.inside(rig.project(person)[0]).all()
    R = rig.cam_from_world[:, :3, :3]
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (len(rig), 1, 1)), atol=1e-12)


def test_a_ring_stands_upright_looks_at_the_middle_and_depends_on_its_seed_alone():
    config = RigConfig(ring=RingConfig(views=6, radius=[3, 5], height=[1, 3], target_height=1.1))
    rig, again, other = (make_rig(config, rng=np.random.default_rng(seed)) for seed in (4, 4, 5))
    np.testing.assert_array_equal(rig.cam_from_world, again.cam_from_world)
    assert not np.allclose(rig.cam_from_world, other.cam_from_world)
    assert ((rig.centers[:, 2] >= 1) & (rig.centers[:, 2] <= 3)).all()
    radius = np.hypot(*rig.centers[:, :2].T)
    assert ((radius >= 3) & (radius <= 5)).all()
    xy, _ = rig.project(np.array([[[0, 0, 1.1], [0, 0, 1.5]]]))
    np.testing.assert_allclose(xy[0, :, 0], (rig.size - 1) / 2, atol=1e-6)
    np.testing.assert_allclose(xy[0, :, 1, 0], xy[0, :, 0, 0], atol=1e-6)
    assert (xy[0, :, 1, 1] < xy[0, :, 0, 1]).all()


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"K": [1.0] * 8}, "expected 9 numbers of K, found 8"),
        ({"cam_from_world": [0.0] * 16}, "expected 12 numbers of cam_from_world, found 16"),
        ({"dist": [0.0] * 4}, "expected 5 or 6 or 7 or 8 numbers of dist, found 4"),
        ({"cam_from_world": [0.0] * 12}, "holds no rotation"),
    ],
)
def test_a_malformed_camera_is_named(change, complaint):
    pose = [1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]
    camera = {"name": "left", "size": [64, 48], "K": [50.0, 0, 32, 0, 50, 24, 0, 0, 1], "cam_from_world": pose}
    with pytest.raises(ValueError, match="'left'.*" + complaint):
        make_rig(RigConfig(name="mine", cameras=[CameraConfig(**camera | change)]), rng=np.random.default_rng(0))


def distorted(rig: CameraRig) -> CameraRig:
    dist = np.tile([-0.3, 0.1, 0.002, -0.001, 0.01], (len(rig), 1))
    return CameraRig(rig.names, rig.K, dist, rig.cam_from_world, rig.size)


def test_the_pinhole_image_holds_every_pixel_of_the_distorted_one():
    rig = distorted(preset("shelf"))
    wide = pinhole(rig)
    points = np.array([[[0.2, 0.3, 0.8], [0.5, -0.4, 1.6], [-0.1, -0.6, 0.2]]])
    seen, ideal = rig.project(points)[0][0], wide.project(points)[0][0]
    for view in range(len(rig)):
        pixels = warp(rig, view)
        assert (pixels >= 0).all()
        assert (pixels <= wide.size[view] - 1).all()
        # Where a distorted pixel is taken from is where the pinhole camera sees what the pixel shows.
        for xy, source in zip(seen[view], ideal[view], strict=True):
            if (xy >= 0).all() and (xy < rig.size[view] - 1).all():
                column, row = np.round(xy).astype(int)
                shown = rig[view : view + 1].undistort((xy - np.round(xy) + (column, row))[None, None])[0, 0]
                np.testing.assert_allclose(shown + wide.K[view, :2, 2] - rig.K[view, :2, 2], source, atol=1e-3)
                assert np.abs(pixels[row, column] - source).max() < 1.5
    assert warp(preset("shelf"), 0) is None


@pytest.mark.parametrize("k1", [-0.55, -5.0])
def test_a_lens_that_no_pinhole_can_follow_is_refused(k1):
    rig = preset("shelf")
    dist = np.zeros((5, 5))
    dist[2, 0] = k1
    with pytest.raises(ValueError, match=r"camera '2'.*cannot be rendered"):
        pinhole(CameraRig(rig.names, rig.K, dist, rig.cam_from_world, rig.size))


def test_mujoco_has_the_cameras_in_order_with_room_for_their_images():
    rig, spec = preset("shelf"), mujoco.MjSpec()
    add_cameras(spec, rig)
    model = spec.compile()
    assert [model.cam(view).name for view in range(5)] == [camera_name(name) for name in rig.names]
    assert (model.vis.global_.offwidth, model.vis.global_.offheight) == (1032, 776)
    np.testing.assert_allclose(model.cam_pos, rig.centers, atol=1e-12)


def test_skew_is_refused():
    rig = preset("shelf")
    K = rig.K.copy()
    K[3, 0, 1] = 2
    with pytest.raises(ValueError, match=r"camera '3'.*no skew"):
        add_cameras(mujoco.MjSpec(), CameraRig(rig.names, K, rig.dist, rig.cam_from_world, rig.size))
