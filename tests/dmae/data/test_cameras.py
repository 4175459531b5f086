import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dmae.data.cameras import CameraRig, camera_label

DISTORTIONS = {
    "pinhole": np.zeros(5),
    "five": np.array([-0.12, 0.05, 0.001, -0.002, 0.01]),
    "six": np.array([0.1, -0.05, 0.001, 0.001, 0.02, 0.03]),
    "eight": np.array([0.3, -0.1, 0.0005, 0.001, 0.02, 0.25, -0.05, 0.01]),
}


def make_rig(dist=DISTORTIONS["pinhole"], views=3, skew=0.0) -> CameraRig:
    """Cameras on a circle of 5 m, 1.5 m up, looking at the middle; principal points off centre."""
    angles = np.linspace(0, 2 * np.pi, views, endpoint=False)
    cam_from_world = np.tile(np.eye(4), (views, 1, 1))
    for view, angle in enumerate(angles):
        centre = np.array([5 * np.cos(angle), 5 * np.sin(angle), 1.5])
        forward = (0, 0, 1) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, (0, 0, 1.0))
        right /= np.linalg.norm(right)
        R = np.stack([right, np.cross(forward, right), forward])
        cam_from_world[view, :3, :3], cam_from_world[view, :3, 3] = R, -R @ centre
    K = np.array([[900, skew, 500], [0, 880, 410], [0, 0, 1.0]])
    return CameraRig(
        tuple(f"c{v}" for v in range(views)),
        np.tile(K, (views, 1, 1)),
        np.tile(dist, (views, 1)),
        cam_from_world,
        np.tile((1032, 776), (views, 1)),
    )


def points(shape=(4, 2, 6), seed=0) -> np.ndarray:
    """Somewhere in the middle of the circle."""
    return np.random.default_rng(seed).uniform((-1, -1, 0), (1, 1, 2), (*shape, 3))


@pytest.mark.parametrize("dist", DISTORTIONS.values(), ids=DISTORTIONS)
def test_projection_agrees_with_opencv(dist):
    rig, xyz = make_rig(dist), points()
    xy, depth = rig.project(xyz)
    assert xy.shape == (4, 3, 2, 6, 2)
    for view in range(3):
        T = rig.cam_from_world[view]
        padded = dist if len(dist) == 5 else np.pad(dist, (0, 8 - len(dist)))
        want, _ = cv2.projectPoints(xyz.reshape(-1, 1, 3), cv2.Rodrigues(T[:3, :3])[0], T[:3, 3], rig.K[view], padded)
        np.testing.assert_allclose(xy[:, view].reshape(-1, 2), want[:, 0], atol=1e-8)
        np.testing.assert_allclose(depth[:, view], (xyz @ T[:3, :3].T + T[:3, 3])[..., 2])


def test_four_coefficients_are_five_with_a_zero():
    four = np.tile([-0.2, 0.1, 0.001, -0.002], (3, 1))
    np.testing.assert_array_equal(replace(make_rig(), dist=four).dist, np.pad(four, ((0, 0), (0, 1))))


def fisheye(k=(0.05, -0.01, 0.003, -0.001), views=3) -> CameraRig:
    rig = make_rig(views=views)
    return replace(rig, dist=np.tile([*k, 0], (views, 1)), fisheye=np.ones(views, bool))


def test_fisheye_projection_agrees_with_opencv():
    rig, xyz = fisheye(), points()
    xy, _ = rig.project(xyz)
    for view, T in enumerate(rig.cam_from_world):
        want, _ = cv2.fisheye.projectPoints(
            xyz.reshape(-1, 1, 3), cv2.Rodrigues(T[:3, :3])[0], T[:3, 3], rig.K[view], rig.dist[view, :4]
        )
        np.testing.assert_allclose(xy[:, view].reshape(-1, 2), want[:, 0], atol=1e-8)
    one = xyz.reshape(-1, 3)
    np.testing.assert_allclose(rig.project(one)[0], rig.project(one[None])[0][0].swapaxes(0, 1), atol=1e-9)


@pytest.mark.parametrize("k", [(0.05, -0.01, 0.003, -0.001), (-0.2, 0.02, 0, 0), (0, 0, 0, 0), (0.9, 0, 0, 0)])
def test_fisheye_rays_undo_projection_up_to_the_edge_of_the_lens(k):
    rig = fisheye(k, views=1)
    angle = np.linspace(0, 1.5, 40)
    in_camera = 3 * np.stack([np.sin(angle) * np.cos(2.0), np.sin(angle) * np.sin(2.0), np.cos(angle)], -1)
    xyz = rig.centers + in_camera @ rig.cam_from_world[0, :3, :3]
    xy, _ = rig.project(xyz[None])
    seen = np.isfinite(xy[0, 0, :, 0])
    assert seen.sum() > 20
    # Where a polynomial turns back the lens ends, and nothing is folded into the image.
    growing = np.diff(np.linalg.norm(xy[0, 0, seen] - rig.K[0, :2, 2], axis=-1)) > 0
    assert growing.all()
    direction = rig.rays(xy)[0, 0, seen]
    np.testing.assert_allclose(direction, (in_camera / 3 @ rig.cam_from_world[0, :3, :3])[seen], atol=1e-6)


def test_pixels_that_a_lens_shows_nothing_at_have_no_ray():
    """The polynomial turns back at a radius of 0.91 focal lengths, which is shown at 0.61."""
    rig = replace(make_rig(views=1), dist=np.array([[-0.4, 0, 0, 0, 0]]))
    radius = np.linspace(0.01, 0.9, 30)
    inside = rig.K[0, :2, 2] + 800 * np.stack([radius * (1 - 0.4 * radius**2), 0 * radius], -1)
    xy = np.concatenate([inside, rig.K[0, :2, 2] + [(500, 0), (-520, 300), (1000, 0), (0, 4000)]])[None, None]
    rig = replace(rig, K=np.array([[[800, 0, rig.K[0, 0, 2]], [0, 800, rig.K[0, 1, 2]], [0, 0, 1]]]))
    ideal = rig.undistort(xy)[0, 0]
    np.testing.assert_allclose((ideal[:30] - rig.K[0, :2, 2]) / 800, np.stack([radius, 0 * radius], -1), atol=1e-4)
    assert np.isnan(ideal[30:]).all() and np.isnan(rig.rays(xy)[0, 0, 30:]).all()


def test_fisheye_and_pinhole_cameras_share_a_rig():
    mixed = replace(fisheye(), fisheye=np.array([False, True, False]), dist=np.diag([0.0, 0.1, 0]) @ np.eye(3, 5))
    xy, _ = mixed.project(points())
    plain, _ = make_rig().project(points())
    assert np.abs(xy[:, 1] - plain[:, 1]).max() > 1
    np.testing.assert_array_equal(xy[:, [0, 2]], plain[:, [0, 2]])
    np.testing.assert_allclose(mixed.undistort(xy), plain, atol=1e-6)
    assert list(mixed.distorted) == [False, True, False]
    assert not mixed.undistorted.distorted.any()
    assert list(mixed[1:].fisheye) == [True, False]


def test_a_fisheye_has_four_coefficients():
    with pytest.raises(ValueError, match=r"'c0'.*four coefficients"):
        replace(make_rig(), dist=np.ones((3, 5)), fisheye=np.ones(3, bool))


@pytest.mark.parametrize("skew", [0.0, 25.0])
@pytest.mark.parametrize("dist", DISTORTIONS.values(), ids=DISTORTIONS)
def test_rays_pass_through_the_projected_points(dist, skew):
    rig, xyz = make_rig(dist, skew=skew), points()
    direction = rig.rays(rig.project(xyz)[0])
    want = xyz[:, None] - rig.centers[None, :, None, None]
    want /= np.linalg.norm(want, axis=-1, keepdims=True)
    np.testing.assert_allclose(direction, want, atol=1e-9)


def test_distortion_and_skew_go_together():
    """A distortion too small to see changes nothing, skewed or not."""
    xyz = points()
    straight, _ = make_rig(skew=25.0).project(xyz)
    bent, _ = make_rig(np.full(5, 1e-12), skew=25.0).project(xyz)
    np.testing.assert_allclose(bent, straight, atol=1e-6)


def test_undistorted_pixels_fit_the_projection_matrix():
    rig, xyz = make_rig(DISTORTIONS["five"]), points((5,))
    ideal = rig.undistort(rig.project(xyz)[0])
    homogeneous = np.einsum("vij,fj->fvi", rig.projections, np.c_[xyz, np.ones(5)])
    np.testing.assert_allclose(ideal, homogeneous[..., :2] / homogeneous[..., 2:], atol=1e-6)


def test_absent_points_and_points_behind_the_camera_have_no_pixel():
    rig = make_rig(DISTORTIONS["five"], views=1)
    away = rig.centers[0] - rig.cam_from_world[0, 2, :3]
    xy, depth = rig.project(np.stack([away, (np.nan, 0, 0), (0, 0, 1)]))
    assert np.isnan(xy[:2]).all()
    assert depth[0, 0] < 0
    assert np.isfinite(xy[2]).all()
    assert rig.inside(xy)[:, 0].tolist() == [False, False, True]
    assert np.isnan(rig.rays(xy)[:2]).all()


def test_points_beyond_a_barrel_distortion_have_no_pixel():
    """r (1 - 0.4 r^2) turns back at r = 0.91: without care, a point 58 degrees off axis lands near the middle."""
    rig = make_rig(np.array([-0.4, 0, 0, 0, 0]), views=1)
    R, centre = rig.cam_from_world[0, :3, :3], rig.centers[0]
    tangent = np.array([0.0, 0.5, 0.9, 1.0, 1.58, 3.0])
    in_camera = np.stack([tangent, 0 * tangent, 1 + 0 * tangent], -1)
    xy, _ = rig.project(in_camera @ R + centre)
    assert np.isfinite(xy[:3]).all()
    assert np.isnan(xy[3:]).all()


def test_zero_points_are_projected():
    for dist in DISTORTIONS.values():
        rig = make_rig(dist)
        xy, depth = rig.project(np.empty((4, 0, 6, 3)))
        assert xy.shape == (4, 3, 0, 6, 2)
        assert depth.shape == (4, 3, 0, 6)
        assert rig.rays(xy).shape == (4, 3, 0, 6, 3)


@given(st.integers(0, 2**32 - 1))
def test_pixels_stay_where_they_are_when_world_and_rig_move_together(seed):
    rng = np.random.default_rng(seed)
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    motion[:3, 3] = rng.normal(size=3)
    rig, xyz = make_rig(DISTORTIONS["five"]), points()
    moved = CameraRig(rig.names, rig.K, rig.dist, rig.cam_from_world @ np.linalg.inv(motion), rig.size)
    np.testing.assert_allclose(
        moved.project(xyz @ motion[:3, :3].T + motion[:3, 3])[0], rig.project(xyz)[0], rtol=0, atol=1e-6
    )


def test_views_are_projected_independently():
    rig, xyz = make_rig(DISTORTIONS["five"]), points()
    whole, _ = rig.project(xyz)
    np.testing.assert_array_equal(rig[[2, 0]].project(xyz)[0], whole[:, [2, 0]])
    np.testing.assert_array_equal(rig[1:2].project(xyz)[0], whole[:, 1:2])
    assert rig[[2, 0]].names == ("c2", "c0")
    for camera, written in ((1, r"\[\[1\]\]"), ("c1", r"\[\['c1'\]\]")):
        with pytest.raises(TypeError, match=f"for one camera use rig{written}$"):
            rig[camera]
        assert rig[[camera]].names == ("c1",)
    with pytest.raises(IndexError, match="cameras 'nope': expected a slice, or a list"):
        rig["nope"]


def test_inside_reaches_half_a_pixel_beyond_the_first_and_last_centre():
    rig = make_rig(views=1)
    xy = np.array([[-0.5, 0], [-0.51, 0], [1031.5, 775.5], [1031.51, 0], [np.nan, 0]])[:, None]
    assert rig.inside(xy)[:, 0].tolist() == [True, False, True, False, False]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"names": ("a", "a", "b")}, "unique"),
        ({"K": np.eye(3)}, r"CameraRig\.K: expected shape \(3, 3, 3\), found \(3, 3\)"),
        ({"dist": np.zeros((3, 3))}, r"CameraRig\.dist: expected shape \(3, 4\.\.8\)"),
        ({"cam_from_world": np.tile(np.diag([1, 1, -1, 1.0]), (3, 1, 1))}, "'c0'.*no rotation"),
        ({"cam_from_world": np.tile(2 * np.eye(4), (3, 1, 1))}, "'c0'.*last rows"),
        ({"K": np.tile(np.diag([-900, 900, 1.0]), (3, 1, 1))}, "focal lengths"),
        ({"K": np.full((3, 3, 3), np.nan)}, "not finite"),
        ({"size": [[0, 10]] * 3}, "size must be positive"),
    ],
)
def test_bad_calibration_is_refused(changes, message):
    rig = make_rig()
    fields = {name: getattr(rig, name) for name in ("names", "K", "dist", "cam_from_world", "size")}
    with pytest.raises(ValueError, match=message):
        CameraRig(**fields | changes)


def test_a_rig_without_distortion_is_of_pinholes():
    rig = make_rig()
    pinholes = CameraRig(rig.names, rig.K, None, rig.cam_from_world, rig.size)
    assert pinholes.dist.shape == (3, 5) and not pinholes.dist.any()


def test_rays_of_the_real_shelf_rig_invert_its_projection(data_folder):
    cameras = json.loads((data_folder / "shelf" / "calibration.json").read_text())
    T = np.tile(np.eye(4), (5, 1, 1))
    T[:, :3] = [np.reshape(camera["RT"], (3, 4)) for camera in cameras.values()]
    K = [np.reshape(camera["K"], (3, 3)) for camera in cameras.values()]
    rig = CameraRig(tuple(cameras), K, np.zeros((5, 5)), T, [camera["imgSize"] for camera in cameras.values()])
    xyz = points((3,))
    direction = rig.rays(rig.project(xyz)[0])
    along = ((xyz[:, None] - rig.centers) * direction).sum(-1, keepdims=True)
    # The published rotations are rounded, so the loop closes to their rounding only.
    np.testing.assert_allclose(rig.centers + along * direction, np.broadcast_to(xyz[:, None], (3, 5, 3)), atol=2e-3)


@pytest.mark.parametrize(("name", "label"), [("left", "camera left"), ("3", "camera 3"), ("Camera1", "Camera1")])
def test_a_name_that_says_camera_is_not_preceded_by_the_word(name, label):
    assert camera_label(name) == label
