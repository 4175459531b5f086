"""Calibrations of every format: read from files of other programs, written and read again."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from dmae.data.cameras import CameraRig
from dmae.formats.calibrations.conventions import LengthUnit, UpDirection
from dmae.formats.calibrations.files import (
    find_calibration,
    read_calibration,
    recognise,
    write_calibration,
)
from dmae.formats.calibrations.registry import calibration_format
from tests.support.calibrations import CENTRE, POINT, TEXTS, K, R, intrinsics_text, pose2sim_text, write
from tests.support.clips import looking_at_origin

FORMATS = list(calibration_format)
SHELF_SIZE, CAMPUS_SIZE = (1032, 776), (360, 288)
BENT = (-0.25, 0.09, 0.001, -0.002, -0.01)


def pinholes() -> CameraRig:
    """Four cameras that differ in focal lengths, principal point and image size."""
    rig = looking_at_origin(4)
    K, size = rig.K.copy(), rig.size.copy()
    K[:, 0, 0] += 10 * np.arange(4)
    K[:, 1, 1] += 13 * np.arange(4)
    K[:, 0, 2] += 5 * np.arange(4)
    size[2] = (800, 640)
    return replace(rig, K=K, size=size)


def distorted() -> CameraRig:
    return replace(pinholes(), dist=np.tile(BENT, (4, 1)))


def rational() -> CameraRig:
    return replace(pinholes(), dist=np.tile((*BENT, 0.01, 0.002, -0.001), (4, 1)))


def fisheyes() -> CameraRig:
    """Two fisheyes among lenses of the ordinary kind."""
    dist = np.tile(BENT, (4, 1))
    dist[1:3] = (0.02, -0.01, 0.003, -0.001, 0)
    return replace(pinholes(), dist=dist, fisheye=(False, True, True, False))


def skewed() -> CameraRig:
    return replace(pinholes(), K=pinholes().K + [[0, 1.5, 0], [0, 0, 0], [0, 0, 0]])


RIGS = {rig.__name__: rig for rig in (pinholes, distorted, rational, fisheyes, skewed)}
REFUSED = {
    ("distorted", "shelf"): "distortion",
    ("rational", "shelf"): "distortion",
    ("rational", "voxelpose"): "beyond 5 coefficients",
    ("rational", "panoptic"): "beyond 5 coefficients",
    ("fisheyes", "shelf"): "distortion",
    ("fisheyes", "voxelpose"): "a fisheye",
    ("fisheyes", "easymocap"): "a fisheye",
    ("fisheyes", "panoptic"): "a fisheye",
    ("skewed", "voxelpose"): "skew",
}


def there_and_back(rig: CameraRig, folder: Path, format: str, **options) -> CameraRig:
    path = folder / ("cameras" if format == "easymocap" else "cameras.txt")
    write_calibration(rig, path, format, **options)
    return read_calibration(path / "extri.yml" if path.is_dir() else path, **options)


def moved(rig: CameraRig, other: CameraRig) -> float:
    """By how many pixels points that a rig sees are elsewhere in another, at most."""
    rng = np.random.default_rng(0)
    pixels = rng.uniform(0.02, 0.98, (300, len(rig), 2)) * rig.size
    points = rig.centers + rig.rays(pixels) * rng.uniform(1, 8, (300, len(rig), 1))
    xy, inside = rig.project(points)[0], rig.inside(rig.project(points)[0])
    assert inside.sum() >= 300 * len(rig)
    return np.abs(other.project(points)[0] - xy)[inside].max()


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("name", RIGS)
def test_every_rig_survives_every_format_or_is_refused(name, format, tmp_path):
    rig, reason = RIGS[name](), REFUSED.get((name, format))
    if reason:
        with pytest.raises(ValueError, match=rf"camera '\w+': .* cannot hold .*{reason}"):
            there_and_back(rig, tmp_path, format)
        assert not list(tmp_path.rglob("*.*"))
        return
    again = there_and_back(rig, tmp_path, format)
    assert moved(rig, again) < 1e-6
    assert again.names == rig.names
    np.testing.assert_array_equal(again.size, rig.size)
    np.testing.assert_array_equal(again.fisheye, rig.fisheye)


@pytest.mark.parametrize("format", FORMATS)
def test_rigs_survive_in_other_units_and_worlds(format, tmp_path):
    options = {"unit": LengthUnit.mm, "up": UpDirection.y, "inverse": True}
    rig = pinholes()
    again = there_and_back(rig, tmp_path, format, **options)
    np.testing.assert_allclose(again.cam_from_world, rig.cam_from_world, atol=1e-9)
    as_usual = read_calibration(next(p for p in (tmp_path / "cameras", tmp_path / "cameras.txt") if p.exists()))
    assert np.abs(as_usual.centers - rig.centers).max() > 1


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize(
    "name", ["shelf/calibration.json", "rigs/calibration_shelf.json", "rigs/calibration_campus.json"]
)
def test_published_rigs_survive_every_format(name, format, data_folder, tmp_path):
    """Rotations of the Shelf calibrations are rounded to six decimals; Rodrigues vectors cannot hold that."""
    sizes = {"rigs/calibration_shelf.json": SHELF_SIZE, "rigs/calibration_campus.json": CAMPUS_SIZE}
    rig = read_calibration(data_folder / name, size=sizes.get(name))
    assert moved(rig, there_and_back(rig, tmp_path, format)) < 1e-3


def test_shelf_is_the_same_in_both_its_publications(data_folder):
    """One gives t in metres, the other the centre in millimetres."""
    rig = read_calibration(data_folder / "shelf" / "calibration.json")
    other = read_calibration(data_folder / "rigs" / "calibration_shelf.json", size=SHELF_SIZE)
    np.testing.assert_allclose(other.centers, rig.centers, atol=1e-5)
    np.testing.assert_allclose(other.cam_from_world, rig.cam_from_world, atol=1e-5)
    np.testing.assert_allclose(other.K, rig.K, atol=1e-4)
    assert (rig.centers[:, 2] > 0.5).all()


def test_campus_cameras_are_where_its_file_says(data_folder):
    rig = read_calibration(data_folder / "rigs" / "calibration_campus.json", size=CAMPUS_SIZE)
    np.testing.assert_allclose(rig.centers[0], (1.7748953, -5.0516959, 1.9233560), atol=1e-6)


def test_pose2sim_cameras_are_where_the_motion_capture_system_had_them(data_folder):
    """The TOML was made of Qualisys' own calibration, which gives centres, mm, and rows of axes in the world."""
    folder = data_folder / "pose2sim"
    rig = read_calibration(folder / "S00_P00_SingleParticipant" / "S00_P00_T01_BalancingTrial")
    cameras = ElementTree.parse(folder / "S00_Calibration" / "Calib.qca.txt").iter("camera")
    transforms = {camera.get("serial"): camera.find("transform") for camera in cameras}
    for view, name in enumerate(rig.names):
        centre = [float(transforms[name].get(key)) / 1000 for key in "xyz"]
        backward = [float(transforms[name].get(key)) for key in ("r31", "r32", "r33")]
        np.testing.assert_allclose(rig.centers[view], centre, atol=1e-4)
        np.testing.assert_allclose(-rig.cam_from_world[view, 2, :3], backward, atol=1e-4)
    assert rig.names == ("cam_01", "cam_02", "cam_03", "cam_04")
    np.testing.assert_array_equal(rig.size, [[1088, 1920]] * 4)
    np.testing.assert_array_equal(rig.dist[0], [-0.000721609375, 0.002187234375, 9.5e-06, 1.078125e-05, 0])


def textbook_pixel(k1, k2, p1, p2, k3) -> np.ndarray:
    """Where the camera above sees the point, by the distortion formula of Brown (1966)."""
    x, y, z = R @ (POINT - CENTRE)
    x, y = x / z, y / z
    r = x * x + y * y
    radial = 1 + k1 * r + k2 * r**2 + k3 * r**3
    bent = (
        x * radial + 2 * p1 * x * y + p2 * (r + 2 * x * x),
        y * radial + p1 * (r + 2 * y * y) + 2 * p2 * x * y,
    )
    return K[:2, :2] @ bent + K[:2, 2]


@pytest.mark.parametrize("format", FORMATS)
def test_each_format_means_what_its_authors_mean(format, tmp_path):
    """Units, up, order of coefficients, translation or centre, vector or matrix: a pixel shows them all."""
    folder = write(tmp_path, format)
    rig = read_calibration(folder, size=(1000, 600) if format == "voxelpose" else None)
    k3 = 0 if format == "pose2sim" else -0.1
    coefficients = (0,) * 5 if format == "shelf" else (-0.2, 0.05, 0.01, -0.02, k3)
    xy, depth = rig.project(POINT[None])
    rounding = 0.1 if format == "shelf" else 1e-4
    np.testing.assert_allclose(xy[0, 0], textbook_pixel(*coefficients), atol=rounding)
    np.testing.assert_allclose(depth[0, 0], (R @ (POINT - CENTRE))[2], atol=1e-3)
    np.testing.assert_allclose(rig.centers[0], CENTRE, atol=1e-3)
    np.testing.assert_array_equal(rig.size, [[1000, 600]])
    assert rig.names == ("left",)
    assert recognise(find_calibration(folder)) == format


def test_formats_are_recognised_whatever_the_file_is_called(tmp_path):
    for format in set(FORMATS) - {"easymocap"}:
        (tmp_path / "cameras").write_text(next(iter(TEXTS[format].values()))())
        assert recognise(tmp_path / "cameras") == format


def test_fisheye_of_a_toml(tmp_path):
    text = pose2sim_text().replace("fisheye = false", "fisheye = true")
    rig = read_calibration(write(tmp_path, "pose2sim", **{"calib.toml": text}))
    x, y, z = R @ (POINT - CENTRE)
    angle = np.arctan2(np.hypot(x, y), z)
    k = np.array([-0.2, 0.05, 0.01, -0.02])
    bent = angle * (1 + (k * angle ** np.array([2, 4, 6, 8])).sum()) / np.hypot(x, y)
    np.testing.assert_allclose(rig.project(POINT[None])[0][0, 0], K[:2, :2] @ (bent * x, bent * y) + K[:2, 2])
    assert rig.fisheye.all()


def test_sizes_may_be_given_where_a_file_has_none_and_must_not_contradict_it(tmp_path):
    folder = write(tmp_path, "voxelpose")
    with pytest.raises(
        ValueError, match=r"calibration\.json: camera 'left': .* no image size; .*size=\[width,height\]"
    ):
        read_calibration(folder)
    folder = write(tmp_path, "pose2sim")
    (folder / "calibration.json").unlink()
    with pytest.raises(ValueError, match=r"calib\.toml: camera 'left': .* \[1000, 600\] px, .* size=\[9, 9\]"):
        read_calibration(folder, size=(9, 9))
    assert read_calibration(folder, size=(1000, 600)).size.tolist() == [[1000, 600]]


def test_cameras_that_only_have_intrinsics_are_not_of_the_rig(tmp_path):
    text = intrinsics_text().replace('- "left"', '- "left"\n   - "spare"') + intrinsics_text().partition('"left"\n')[2]
    folder = write(tmp_path, "easymocap", **{"intri.yml": text.replace("_left", "_spare", 4)})
    assert read_calibration(folder).names == ("left",)


def test_cameras_may_differ_in_size_and_in_coefficients(tmp_path):
    """Pose2Sim's own files hold four, anipose's five."""
    other = pose2sim_text().partition("[cam_1]")[2].replace("left", "right").replace("-0.02]", "-0.02, -0.1]")
    text = pose2sim_text() + "\n[cam_2]" + other.replace("1000.0, 600.0", "640, 480")
    rig = read_calibration(write(tmp_path, "pose2sim", **{"calib.toml": text}))
    np.testing.assert_array_equal(rig.size, [[1000, 600], [640, 480]])
    np.testing.assert_array_equal(rig.dist[:, 4], [0, -0.1])


def test_a_calibration_is_found_where_projects_keep_it(tmp_path):
    places = {
        "pose2sim": ("session/calibration/Calib.toml", "session"),
        "pose2sim batch": ("batch/S00_Calibration/Calib_qualisys.toml", "batch/S00_P00/S00_P00_T01"),
        "anipose": ("anipose/calibration/calibration.toml", "anipose/calibration"),
        "freemocap": ("free/recording_camera_calibration.toml", "free"),
        "panoptic": ("171204_pose1/calibration_171204_pose1.json", "171204_pose1"),
        "4DAssociation": ("shelf/calibration.json", "shelf"),
        "easymocap": ("mocap/intri.yml", "mocap"),
        "easymocap apart": ("apart/cameras/intri.yml", "apart"),
    }
    for file, folder in places.values():
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / folder).mkdir(parents=True, exist_ok=True)
        (tmp_path / file).touch()
        assert find_calibration(tmp_path / folder).resolve() == (tmp_path / file).resolve()


def test_none_and_several_calibrations_are_errors(tmp_path):
    folder = tmp_path / "a" / "b" / "c"
    folder.mkdir(parents=True)
    (folder / "Config.toml").touch()
    with pytest.raises(FileNotFoundError, match=r"no calibration; looked for .*alib.*\.toml.*intri\.yml"):
        find_calibration(folder)
    with pytest.raises(FileNotFoundError, match="no such folder"):
        find_calibration(folder / "d")
    for name in ("calib_old.toml", "calibration.json"):
        (folder / name).touch()
    with pytest.raises(ValueError, match=r"one calibration, found .*calib_old\.toml, .*calibration\.json; name"):
        find_calibration(folder)
