"""Images show objects where the cameras project them, by OpenGL and by ray casting."""

import os
import subprocess
import sys
from pathlib import Path

import cv2
import mujoco
import numpy as np
import pytest

from dmae.data.cameras import CameraRig
from dmae.data.labels import Visibility
from synth.labels.visibility import joint_visibility
from synth.rendering.config import ImageQuality
from synth.rendering.renderer import RenderedView, Renderer, render_images
from synth.rigs.lenses import add_cameras
from tests.support.rigs import PRESETS, distorted, preset, wide
from tests.support.standing_people import looking_along_x, scene

pytestmark = pytest.mark.slow

MARKERS = np.array([[0.0, 0.0, 1.0], [0.5, -0.2, 0.4], [-0.1, 0.4, 1.6], [0.6, 0.4, 0.9]])
RADIUS = 0.06
APART = np.array([[-0.3, 0.4, 0.4], [0.4, -0.3, 1.6]])


def markers(rig: CameraRig, radius: float = RADIUS, points: np.ndarray = MARKERS) -> tuple[mujoco.MjModel, np.ndarray]:
    """White spheres that shine in the dark, and their ids: an object each."""
    spheres = "".join(f'<geom type="sphere" size="{radius}" pos="{x} {y} {z}" material="shine"/>' for x, y, z in points)
    spec = mujoco.MjSpec.from_string(
        '<mujoco><visual><headlight active="0"/></visual><asset><material name="shine" rgba="1 1 1 1" emission="1"/>'
        f"</asset><worldbody>{spheres}</worldbody></mujoco>"
    )
    add_cameras(spec, rig)
    return spec.compile(), (256 + np.arange(len(points))).astype(np.uint16)


def outline_centroids(rig: CameraRig, points: np.ndarray, radius: float) -> np.ndarray:
    """(V, N, 2) centroids of the outlines of spheres in the images.

    The rays that touch a sphere do so on a circle, whose image is a polygon of many corners here.
    """
    towards = rig.centers[:, None] - points
    distance = np.linalg.norm(towards, axis=-1, keepdims=True)
    towards /= distance
    across = np.cross(towards, [0.1, 0.2, 1])
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)[:, None, None, None]
    around = across * np.cos(angle) + np.cross(towards, across) * np.sin(angle)
    circle = points + radius**2 / distance * towards + radius * np.sqrt(1 - (radius / distance) ** 2) * around
    x, y = np.stack([rig[v : v + 1].project(circle[:, v])[0][:, 0] for v in range(len(rig))], 1).T
    # Corners run along the last axis; the shoelace formula.
    cross = x * np.roll(y, -1, -1) - np.roll(x, -1, -1) * y
    centers = [((c + np.roll(c, -1, -1)) * cross).sum(-1) / (3 * cross.sum(-1)) for c in (x, y)]
    return np.stack(centers, -1).transpose(1, 0, 2)


def centroid(weights: np.ndarray) -> np.ndarray:
    rows, columns = np.indices(weights.shape)
    return np.array([(columns * weights).sum(), (rows * weights).sum()]) / weights.sum()


def in_sight(
    rig: CameraRig, view: int, ids: np.ndarray, radius: float = RADIUS, points: np.ndarray = MARKERS
) -> list[int]:
    """Markers in full view: inside the image with all their rim, and apart from all others."""
    xy, depth = rig.project(points[None])
    radius = rig.K[view, 0, 0] * radius / depth[0, view] + 3
    fits = ((xy[0, view] > radius[:, None]) & (xy[0, view] < rig.size[view] - radius[:, None])).all(-1)
    gaps = np.linalg.norm(xy[0, view, :, None] - xy[0, view], axis=-1) - radius - radius[:, None]
    apart = (gaps + 1e3 * np.eye(len(points)) > 0).all(-1)
    found = [int(i) for i in np.flatnonzero(fits & apart)]
    assert found, f"view {view} shows no marker"
    assert np.isin(256 + np.array(found), ids).all()
    return found


def misplaced(painter: str, image: RenderedView, marker: int, expected: np.ndarray) -> float:
    """By how many pixels the centroid of a marker in an image is off."""
    covered = image.ids == 256 + marker
    # OpenGL's antialiased edges carry the part of the pixel that is covered; a ray hits or does not.
    around = cv2.dilate(covered.astype(np.uint8), np.ones((5, 5)))
    weights = around * image.rgb.mean(-1) if painter == "gl" else covered.astype(float)
    return np.hypot(*(centroid(weights) - expected))


def far(rig: CameraRig, pixels: float) -> float:
    """Radius of markers that are so many pixels large in every view, within reason, m."""
    return np.clip(pixels * (np.linalg.norm(rig.centers, axis=1) / rig.K[:, 0, 0]).max(), RADIUS, 0.3)


@pytest.mark.parametrize("name", PRESETS)
def test_a_marker_s_centroid_is_its_projection_in_every_rig(painter, name):
    # Of the many alike some will do.
    rig = preset(name)[{"dome": slice(None, None, 10), "studio5": slice(3)}.get(name, slice(None))]
    # Pixels that rays find in or out average out along a long outline; OpenGL's spheres have corners.
    radius = far(rig, 10 if painter == "gl" else 20)
    model, ids = markers(rig, radius, APART)
    expected = outline_centroids(rig, APART, radius)
    with Renderer(model, ids, rig, ImageQuality.high) as renderer:
        for view in range(len(rig)):
            image = renderer.image(model.qpos0, view)
            assert image.rgb.shape[:2] == tuple(rig.size[view][::-1])
            for marker in in_sight(rig, view, image.ids, radius, APART):
                assert misplaced(painter, image, marker, expected[view, marker]) < 0.1, (view, marker)


def test_a_fisheye_too_wide_for_any_pinhole_shows_markers_all_around_and_dark_corners(painter):
    rig, radius = wide(), 0.12
    # On the axis, on the borders between the images it is made of, and almost beside the camera.
    angle, turn = np.radians([0, 30, 45, 45, 60, 70, 80, 84]), np.radians([0, 10, 0, 90, 45, 225, 135, 315])
    x, y, z = np.cos(angle), np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn)
    points = rig.centers[0] + 1.5 * np.stack([x, -y, -z], -1)
    model, ids = markers(rig, radius, points)
    expected = outline_centroids(rig, points, radius)[0]
    with Renderer(model, ids, rig, ImageQuality.high) as renderer:
        image = renderer.image(model.qpos0, 0)
    for marker in range(len(points)):
        assert misplaced(painter, image, marker, expected[marker]) < 0.1, marker
        # The nearest point of a marker is on the ray to its centre; depth is along the axis of the whole image.
        column, row = np.round(expected[marker]).astype(int)
        assert abs(image.depth[row, column] - (1.5 - radius) * np.cos(angle[marker])) < 0.01, marker
    assert (image.ids[:60, :60] == 0).all()
    assert np.isnan(image.depth[:60, :60]).all()
    assert (image.rgb[:60, :60] == 0).all()


def test_depth_is_the_distance_along_the_axis(painter):
    rig = preset("shelf")
    model, ids = markers(rig)
    xy, depth = rig.project(MARKERS[None])
    with Renderer(model, ids, rig) as renderer:
        for view in range(len(rig)):
            image = renderer.image(model.qpos0, view)
            assert (np.isnan(image.depth) == (image.ids == 0)).all()
            for marker in in_sight(rig, view, image.ids):
                column, row = np.round(xy[0, view, marker]).astype(int)
                # The nearest point lies towards the camera, on the ray to the centre.
                ray = rig.rays(xy[:, :, marker : marker + 1])[0, view, 0] @ rig.cam_from_world[view, 2, :3]
                assert abs(image.depth[row, column] - (depth[0, view, marker] - RADIUS * ray)) < 2e-3


def test_a_distorting_lens_shows_markers_where_it_projects_them(painter):
    rig = distorted(preset("shelf")[1:3])
    model, ids = markers(rig)
    expected = outline_centroids(rig, MARKERS, RADIUS)
    with Renderer(model, ids, rig, ImageQuality.high) as renderer:
        for view in range(len(rig)):
            image = renderer.image(model.qpos0, view)
            assert image.rgb.shape == (776, 1032, 3)
            for marker in in_sight(rig, view, image.ids):
                covered = image.ids == 256 + marker
                # OpenGL's ids are warped by nearest neighbour: what is near by moves together, by up to half a pixel.
                assert (np.abs(centroid(covered.astype(float)) - expected[view, marker]) < 0.5).all(), (view, marker)
                assert misplaced(painter, image, marker, expected[view, marker]) < 0.1, (view, marker)


def test_a_camera_outside_a_room_looks_into_it_as_in_visibility(painter):
    rig = looking_along_x((-4, 0, 1), (-4, 0.5, 1))
    wall = '<geom name="{}" type="plane" pos="{} 0 1" size="3 2 .1" zaxis="1 0 0"/>'
    model, ids, joints = scene(rig, [(0, 0)], wall.format("near", -2) + wall.format("far", -1).replace('"1 0', '"-1 0'))
    qpos, depth = model.qpos0[None], np.full(joints.shape[1:3], 0.2)
    with Renderer(model, ids, rig, ImageQuality.draft) as renderer:
        (xy, _), image = rig.project(joints), renderer.image(model.qpos0, 0)
    sight = joint_visibility(model, qpos, joints, depth, ids, rig)
    assert (sight.occluder == 1).all(), "the near wall is seen through, the far one is not"
    columns, rows = np.round(xy[0, 0, 0]).astype(int).T
    assert (image.ids[rows, columns] == 257).all()


def test_images_agree_with_visibility(painter):
    rng = np.random.default_rng(11)
    rig = preset("shelf")
    men = [(0, 0), (0.9, -0.5), (0.4, 0.9), (-0.7, -0.6)]
    model, ids, joints = scene(rig, men, '<geom name="box" type="box" pos="-.9 .6 .5" size=".4 .3 .5"/>')
    # Points on the skin, pushed in a little: what hides them is decided by the nearest surface.
    surface = joints[0][:, None] + rng.normal(0, 0.12, (1, 60, 6, 3))
    points = surface.reshape(1, len(men), -1, 3)
    qpos = model.qpos0[None]
    seen = joint_visibility(model, qpos, points, np.zeros(points.shape[1:3]), ids, rig)
    xy, depth = rig.project(points)
    agree, asked = 0, 0
    with Renderer(model, ids, rig, ImageQuality.draft) as renderer:
        for view in range(len(rig)):
            image = renderer.image(qpos[0], view)
            for person, point in zip(*np.nonzero(seen.visibility[0, view] <= Visibility.HIDDEN_BY_OBJECT), strict=True):
                column, row = np.round(xy[0, view, person, point]).astype(int)
                around = np.s_[max(row - 2, 0) : row + 3, max(column - 2, 0) : column + 3]
                near, owners = image.depth[around], np.unique(image.ids[around])
                # Away from silhouettes, and from surfaces that the point lies right at.
                if len(owners) > 1 or np.ptp(near) > 0.05 or np.abs(near - depth[0, view, person, point]).min() < 0.05:
                    continue
                asked += 1
                code, by = seen.visibility[0, view, person, point], seen.occluder[0, view, person, point]
                hidden = owners[0] > 0 and near.mean() < depth[0, view, person, point]
                said = {Visibility.VISIBLE: 0, Visibility.HIDDEN_BY_OBJECT: 256 + by}.get(code, 1 + by)
                agree += said == (owners[0] if hidden else 0)
    assert asked > 1000
    assert agree / asked >= 0.99, (agree, asked)


@pytest.mark.gl
def test_opengl_and_ray_casting_agree(gl):
    rig = preset("shelf")
    model, ids, _ = scene(rig, [(0, 0), (0.9, -0.5)], '<geom name="box" type="box" pos="-.9 .6 .5" size=".4 .3 .5"/>')
    with Renderer(model, ids, rig, ImageQuality.high) as renderer:
        drawn = [renderer.image(model.qpos0, view) for view in range(5)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("synth.rendering.renderer.find_backend", lambda: None)
        with Renderer(model, ids, rig, ImageQuality.high) as renderer:
            cast = [renderer.image(model.qpos0, view) for view in range(5)]
    for a, b in zip(drawn, cast, strict=True):
        same = a.ids == b.ids
        assert same.mean() > 0.998
        assert np.nanmedian(np.abs(a.depth - b.depth)[same]) < 1e-3


def test_rays_cast_only_near_moving_geoms_find_all_of_them(monkeypatch):
    monkeypatch.setattr("synth.rendering.renderer.find_backend", lambda: None)
    rig = looking_along_x((-4, 0, 1), (-0.6, 0.1, 1.2), (1.2, 0, 1.5), (0.0, -0.7, 0.3))
    model, ids, _ = scene(
        rig, [(0, 0), (1, 0.5), (-1, -0.5)], '<geom name="box" type="box" pos="2 0 1" size=".4 .3 1"/>'
    )
    with Renderer(model, ids, rig, ImageQuality.standard) as renderer:
        images = [renderer.image(model.qpos0, view) for view in range(len(rig))]
    for view in range(len(rig)):
        with monkeypatch.context() as patch:
            everywhere = lambda painter, data, view, geoms: np.ones(painter._shape, bool).ravel()  # noqa: E731
            patch.setattr("synth.rendering.renderer.RayPainter._may_be_visible", everywhere)
            with Renderer(model, ids, rig, ImageQuality.standard) as renderer:
                whole = renderer.image(model.qpos0, view)
        np.testing.assert_array_equal(images[view].ids, whole.ids)
        np.testing.assert_array_equal(images[view].depth, whole.depth)


def test_images_are_written_and_read_back(painter, tmp_path):
    rig = preset("shelf")[:2]
    model, ids, _ = scene(rig, [(0, 0)])
    qpos = np.repeat(model.qpos0[None], 3, 0)
    qpos[:, 0] = (0, 0.1, 0.2)
    with Renderer(model, ids, rig, ImageQuality.draft) as renderer:
        images, _, _ = render_images(renderer, qpos, rig, tmp_path, 25)
        expected = [renderer.image(state, 1) for state in qpos]
    rgb, depth, found = (list(images.read(kind, "1")) for kind in ("rgb", "depth", "ids"))
    for frame, image in enumerate(expected):
        np.testing.assert_array_equal(found[frame], image.ids)
        np.testing.assert_allclose(depth[frame], np.where(image.depth < 65.5, image.depth, np.nan), atol=6e-4)
        assert np.abs(rgb[frame].astype(int) - image.rgb).mean() < 5


@pytest.mark.gl
def test_a_rig_without_its_cameras_in_the_scene_is_refused(gl):
    model, ids, _ = scene(looking_along_x((-4, 0, 1)), [(0, 0)])
    with pytest.raises(ValueError, match="lacks cameras"):
        Renderer(model, ids, preset("shelf"))


def test_without_opengl_rays_are_cast_after_one_warning():
    code = (
        "import warnings\n"
        "from synth.rendering import opengl\n"
        "opengl._works = lambda name: False\n"
        "with warnings.catch_warnings(record=True) as said:\n"
        "    warnings.simplefilter('always')\n"
        "    assert opengl.find_backend() is None and opengl.find_backend() is None\n"
        "print(len(said), said[0].message)\n"
        "import os; print(os.environ['MUJOCO_GL'])\n"
    )
    environment = {key: value for key, value in os.environ.items() if key != "MUJOCO_GL"}
    said = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment,
        cwd=Path(__file__).parents[3],
    ).stdout  # fmt: skip
    assert said.startswith("1 no OpenGL works here (tried egl, osmesa)")
    assert said.endswith("disable\n")
