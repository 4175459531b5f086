"""Normals, flow and amodal masks show the surfaces that the cameras project."""

import mujoco
import numpy as np
import pytest

from dmae.data.cameras import CameraRig
from synth.rendering.config import ImageQuality
from synth.rendering.renderer import Renderer
from synth.rigs.lenses import add_cameras
from tests.support.rigs import distorted, preset
from tests.support.standing_people import looking_along_x, scene

pytestmark = pytest.mark.slow


def moving(rig: CameraRig) -> tuple[mujoco.MjModel, np.ndarray]:
    """A floor, a ball and a box that move together."""
    spec = mujoco.MjSpec.from_string(
        '<mujoco><worldbody><light pos="0 0 3"/><geom type="plane" size="5 5 .1"/><body pos="0 0 1"><freejoint/>'
        '<geom type="sphere" size=".3"/><geom type="box" pos=".6 0 0" size=".1 .2 .2"/></body></worldbody></mujoco>'
    )
    add_cameras(spec, rig)
    return spec.compile(), (256 + np.arange(3)).astype(np.uint16)


def on_the_ball(rig: CameraRig, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows and columns of pixels that show the ball, away from its outline, and the points that they show."""
    row, column = np.nonzero(ids == 257)
    rays = rig[:1].rays(np.stack([column, row], -1).astype(float)[None, None])[0, 0]
    towards = rig.centers[0] - (0, 0, 1)
    along = rays @ towards
    inside = along**2 - (towards @ towards - 0.3**2)
    clear = inside > 0.02
    points = rig.centers[0] + rays * (-along - np.sqrt(np.maximum(inside, 0)))[:, None]
    return row[clear], column[clear], points[clear]


@pytest.mark.parametrize("lens", [lambda rig: rig, distorted], ids=["pinhole", "distorted"])
def test_normals_are_those_of_the_surface(painter, lens):
    rig = lens(preset("shelf")[1:3])
    model, ids = moving(rig)
    with Renderer(model, ids, rig, ImageQuality.high) as renderer:
        image = renderer.image(model.qpos0, 0, ("ids", "normals"))
    np.testing.assert_array_equal(np.isnan(image.normals).any(-1), image.ids == 0)
    np.testing.assert_allclose(np.linalg.norm(image.normals, axis=-1)[image.ids > 0], 1, atol=1e-5)
    floor = image.normals[image.ids == 256]
    np.testing.assert_allclose(floor, np.broadcast_to((0, 0, 1), floor.shape), atol=1e-5)
    row, column, points = on_the_ball(rig, image.ids)
    assert len(row) > 1000
    cosine = (image.normals[row, column] * (points - (0, 0, 1)) / 0.3).sum(-1)
    # OpenGL's ball has facets, and shades of 8 bits.
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean() < (2.0 if painter == "gl" else 0.05)


@pytest.mark.parametrize("lens", [lambda rig: rig, distorted], ids=["pinhole", "distorted"])
def test_flow_is_the_projected_motion_of_the_surface(painter, lens):
    rig = lens(preset("shelf")[1:3])
    model, ids = moving(rig)
    following, step, angle = model.qpos0.copy(), np.array([0.05, 0.1, -0.03]), 0.2
    following[:3] += step
    following[3:7] = (np.cos(angle / 2), 0, 0, np.sin(angle / 2))
    with Renderer(model, ids, rig, ImageQuality.high) as renderer:
        image = renderer.image(model.qpos0, 0, ("ids", "flow"), following)
        last = renderer.image(model.qpos0, 0, ("flow",))
    assert image.depth is None
    assert (image.flow[image.ids == 256] == 0).all(), "the floor does not move"
    assert np.isnan(image.flow[image.ids == 0]).all()
    assert np.isnan(last.flow).all(), "nothing follows"
    row, column, points = on_the_ball(rig, image.ids)
    turn = np.array([(np.cos(angle), -np.sin(angle), 0), (np.sin(angle), np.cos(angle), 0), (0, 0, 1)])
    moved = (points - (0, 0, 1)) @ turn.T + (0, 0, 1) + step
    expected = rig[:1].project(moved[None])[0][0, 0] - np.stack([column, row], -1)
    assert np.abs(expected).mean() > 10
    # OpenGL's ball has facets, which lie up to some millimetres under it.
    assert np.abs(image.flow[row, column] - expected).mean() < (0.2 if painter == "gl" else 1e-3)


def test_amodal_masks_show_persons_whole(painter):
    rig = looking_along_x((-4, 0, 1))
    wall = '<geom name="wall" type="box" pos="-2 1 1" size=".01 1 3"/>'
    model, ids, _ = scene(rig, [(0, 0), (2, -1.2)], wall)
    with Renderer(model, ids, rig, ImageQuality.draft) as renderer:
        image = renderer.image(model.qpos0, 0, ("ids", "amodal"))
        alone = [renderer.alone(model.qpos0, 0, person) for person in range(2)]
    for person in range(2):
        mask = image.amodal >> person & 1 > 0
        np.testing.assert_array_equal(mask, alone[person])
        assert mask[image.ids == 1 + person].all()
    hidden = (image.amodal & 1 > 0) & (image.ids == 256)
    assert hidden.sum() > 0.3 * alone[0].sum(), "half of the first man is behind the wall"
