"""Lenses: pinhole images hold all pixels of distorted ones, and MuJoCo's cameras are those of the rig."""

import mujoco
import numpy as np
import pytest

from dmae.data.cameras import CameraRig
from synth.rigs.lenses import add_cameras, camera_name, pinholes, warps
from tests.support.rigs import distorted, preset, wide


def test_the_pinhole_image_holds_every_pixel_of_the_distorted_one():
    rig = distorted(preset("shelf"))
    points = np.array([[[0.2, 0.3, 0.8], [0.5, -0.4, 1.6], [-0.1, -0.6, 0.2]]])
    seen = rig.project(points)[0][0]
    for view, pinhole in enumerate(pinholes(rig)):
        (pixels,) = warps(rig[view : view + 1])
        assert (pixels >= 0).all()
        assert (pixels <= pinhole.size[0] - 1).all()
        # A distorted pixel comes from the position at which the pinhole camera sees the same point.
        for xy, source in zip(seen[view], pinhole.project(points)[0][0, 0], strict=True):
            if (xy >= 0).all() and (xy < rig.size[view] - 1).all():
                column, row = np.round(xy).astype(int)
                shown = rig[view : view + 1].undistort((xy - np.round(xy) + (column, row))[None, None])[0, 0]
                np.testing.assert_allclose(shown + pinhole.K[0, :2, 2] - rig.K[view, :2, 2], source, atol=1e-3)
                assert np.abs(pixels[row, column] - source).max() < 1.5
    assert warps(preset("shelf")[:1]) is None


def test_each_pixel_of_a_wide_fisheye_comes_from_one_of_five_pinholes():
    rig = wide()
    (cameras,) = pinholes(rig)
    assert cameras.names == ("wide", "wide/right", "wide/left", "wide/down", "wide/up")
    grid = np.stack(np.meshgrid(np.arange(900.0), np.arange(900.0)), -1)[None, None]
    rays, maps = rig.rays(grid)[0, 0], warps(rig)
    taken = np.stack([pixels[..., 0] > -1 for pixels in maps])
    assert (taken.sum(0) == np.isfinite(rays[..., 0])).all()
    assert 0.75 < taken.any(0).mean() < 0.9, "the corners are dark"
    for view, pixels in enumerate(maps):
        own, inside = taken[view], pixels[taken[view]]
        assert own.mean() > 0.05
        assert (inside > 2).all()
        assert (inside < cameras.size[view] - 3).all()
        towards = cameras[view : view + 1].rays(inside[None, None].astype(float))[0, 0]
        np.testing.assert_allclose(towards, rays[own], atol=1e-6)


@pytest.mark.parametrize("k1", [-0.55, -5.0])
def test_a_lens_without_a_pinhole_image_is_refused(k1):
    rig = preset("shelf")
    dist = np.zeros((5, 5))
    dist[2, 0] = k1
    with pytest.raises(ValueError, match=r"camera '2'.*cannot be rendered"):
        pinholes(CameraRig(rig.names, rig.K, dist, rig.cam_from_world, rig.size))


def test_mujoco_has_the_cameras_in_order_with_a_large_enough_buffer():
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
