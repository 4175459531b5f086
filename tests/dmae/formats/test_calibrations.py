"""Calibrations of every format: read from files of other programs, written and read again."""

import json
from dataclasses import replace
from itertools import product
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Detections2D
from dmae.data.skeleton import BODY25
from dmae.data.store import save_clip
from dmae.formats.calibrations import (
    FOUND,
    CalibrationSource,
    CameraTable,
    calibration_format,
    find_calibration,
    read_calibration,
    recognise,
    write_calibration,
)
from dmae.formats.config import METRES, Convention, DataConfig, LengthUnit, UpDirection
from dmae.formats.reading import written_convention
from tests.support.calibrations import (
    CENTRE,
    POINT,
    TEXTS,
    K,
    R,
    intrinsics_text,
    opencv_text,
    pose2sim_text,
    write,
    write_storage,
)
from tests.support.clips import looking_at_origin, walkers

FORMATS = list(calibration_format)
WRITTEN = [name for name, each in calibration_format.items() if each.write]
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
    ("rational", "panoptic"): "beyond 5 coefficients",
    ("fisheyes", "easymocap"): "a fisheye",
    ("fisheyes", "panoptic"): "a fisheye",
}


def there_and_back(rig: CameraRig, folder: Path, format: str) -> CameraRig:
    path = folder / ("cameras" if format == "easymocap" else "cameras.txt")
    write_calibration(rig, path, format)
    return read_calibration(path / "extri.yml" if path.is_dir() else path)


def moved(rig: CameraRig, other: CameraRig) -> float:
    """By how many pixels points that a rig sees are elsewhere in another, at most."""
    rng = np.random.default_rng(0)
    pixels = rng.uniform(0.02, 0.98, (300, len(rig), 2)) * rig.size
    points = rig.centers + rig.rays(pixels) * rng.uniform(1, 8, (300, len(rig), 1))
    xy, inside = rig.project(points)[0], rig.inside(rig.project(points)[0])
    assert inside.sum() >= 300 * len(rig)
    return np.abs(other.project(points)[0] - xy)[inside].max()


@pytest.mark.parametrize("format", WRITTEN)
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


@pytest.mark.parametrize("format", WRITTEN)
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
    rig = FOUND.read(folder / "S00_P00_SingleParticipant" / "S00_P00_T01_BalancingTrial")
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


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("Calib.qca.txt", "<?xml version='1.0' encoding='ASCII'?>\n<calibration/>"),
        ("stereo.yml", "%YAML:1.0\n---\nK1: 1\n"),
    ],
)
def test_a_calibration_of_another_program_is_answered_with_what_converts_it(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(
        ValueError, match=rf"{name}: expected a calibration: .*EasyMocap.*Pose2Sim converts calibrations of"
    ):
        read_calibration(tmp_path / name)


def opencv_cameras() -> CameraRig:
    """Two cameras of the rational model, one of another size, as OpenCV calibrates them."""
    rig = rational()[:2]
    return replace(rig, names=("main", "wide_2"), size=[(1920, 1080), (1280, 720)])


def write_opencv(rig: CameraRig, folder: Path, suffix: str) -> None:
    folder.mkdir(parents=True)
    for view, name in enumerate(rig.names):
        pose = rig.cam_from_world[view]
        write_storage(
            folder / f"{name}{suffix}", rig.size[view], rig.K[view], rig.dist[view], pose[:3, :3], pose[:3, 3]
        )


@pytest.mark.parametrize("suffix", [".yml", ".yaml", ".xml", ".json"])
def test_files_that_opencv_writes_are_read_one_for_each_camera(suffix, tmp_path):
    rig = opencv_cameras()
    write_opencv(rig, tmp_path / "calibration", suffix)
    (tmp_path / "calibration" / f"board{suffix}").write_text('{"squares": 9}')
    for path in (tmp_path, tmp_path / "calibration", tmp_path / "calibration" / f"wide_2{suffix}"):
        again = read_calibration(path)
        assert again.names == rig.names
        assert moved(rig, again) < 1e-6
        np.testing.assert_array_equal(again.size, rig.size)


def test_plain_json_with_the_names_of_opencv_is_read_in_its_unit(tmp_path):
    rig = opencv_cameras()
    cameras = {
        name: {
            "width": int(rig.size[view, 0]), "height": int(rig.size[view, 1]), "K": rig.K[view].tolist(),
            "dist": rig.dist[view].tolist(), "R": rig.cam_from_world[view, :3, :3].tolist(),
            "t": (1000 * rig.cam_from_world[view, :3, 3]).tolist(),
        }
        for view, name in enumerate(rig.names)
    }  # fmt: skip
    (tmp_path / "cameras.json").write_text(json.dumps(cameras))
    assert moved(rig, read_calibration(tmp_path, unit=LengthUnit.mm)) < 1e-6
    (tmp_path / "cameras.json").write_text(json.dumps({"mine": cameras}))
    with pytest.raises(ValueError, match=r"expected a calibration: .*camera_matrix or K"):
        read_calibration(tmp_path / "cameras.json")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<opencv_storage><K>1</K>", "expected XML of OpenCV's FileStorage, no element found"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><opencv_storage><K>1</K></opencv_storage>', "it has a document type"),
        (
            # What is a comment only for who does not read instructions hides nothing.
            '<?x <!-- ?><!DOCTYPE a [<!ENTITY b "1">]><opencv_storage><K>&b;</K><R>1</R></opencv_storage><?y --> ?>',
            "it has a document type",
        ),
        ("<opencv_storage><K>1</K>" + 5000 * "<a>" + 5000 * "</a>" + "</opencv_storage>", "nested deeper than 32"),
        ("<opencv_storage><K>1</K><K>1</K></opencv_storage>", "an element twice in opencv_storage"),
        ("<opencv_storage><left><K>1</K><K>1</K></left></opencv_storage>", "an element twice in left"),
        ("<opencv_storage><K>1</K></opencv_storage>", r"expected a camera, or a table for each: K \(camera_matrix"),
    ],
)
def test_xml_that_opencv_did_not_write_is_refused(text, message, tmp_path):
    (tmp_path / "left.xml").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_calibration(tmp_path / "left.xml")


@pytest.mark.parametrize("number", ["1e999", "1" + "0" * 400])
@pytest.mark.parametrize("key", ["rows", "data"])
def test_numbers_that_are_none_are_refused_with_the_file(tmp_path, number, key):
    matrix = {"rows": "3", "cols": "1", "data": f"[1, 1, {number if key == 'data' else 1}]"}
    matrix |= {"rows": number} if key == "rows" else {}
    text = ", ".join(f'"{name}": {value}' for name, value in matrix.items())
    (tmp_path / "left.json").write_text(f'{{"K": {K.tolist()}, "R": [0, 0, 0], "t": {{{text}}}, "size": [640, 480]}}')
    with pytest.raises(ValueError, match=r"left\.json: .*expected t "):
        read_calibration(tmp_path / "left.json")


@pytest.mark.parametrize(("text", "fisheye"), [("false", False), ("0", False), ("true", True), ("1", True)])
def test_whether_a_lens_is_a_fisheye_is_read_from_texts(tmp_path, text, fisheye):
    given = opencv_text().replace("cols: 5", "cols: 4").replace(", -1.00000000e-01 ]", " ]") + f"fisheye: {text}\n"
    assert read_calibration(write(tmp_path, "opencv", **{"left.yml": given})).fisheye.tolist() == [fisheye]


def test_two_notations_of_a_rotation_must_agree(tmp_path):
    vector = "rvec: !!opencv-matrix\n   rows: 3\n   cols: 1\n   dt: d\n   data: [ {} ]\n"
    both = opencv_text() + vector.format("1.2, -0.7, 0.4")
    assert (
        moved(
            read_calibration(write(tmp_path, "opencv")),
            read_calibration(write(tmp_path, "opencv", **{"left.yml": both})),
        )
        < 1e-6
    )
    with pytest.raises(ValueError, match=r"left\.yml: rvec contradicts another R"):
        read_calibration(write(tmp_path, "opencv", **{"left.yml": opencv_text() + vector.format("0, 0, 0")}))


def test_a_damaged_file_of_a_camera_is_not_left_out(tmp_path):
    rig = opencv_cameras()
    write_opencv(rig, tmp_path / "calibration", ".yml")
    damaged = tmp_path / "calibration" / "wide_2.yml"
    damaged.write_text(damaged.read_text()[:-30])
    with pytest.raises(ValueError, match=r"wide_2\.yml: expected YAML"):
        read_calibration(tmp_path / "calibration" / "main.yml")


def test_a_bar_of_comments_does_not_stop_recognition(tmp_path):
    (tmp_path / "calib.toml").write_text(200 * "#" + "\n" + pose2sim_text())
    assert recognise(tmp_path / "calib.toml") == "pose2sim"


def test_a_lens_of_thin_prisms_is_refused(tmp_path):
    text = opencv_text().replace("cols: 5", "cols: 12").replace("-1.00000000e-01 ]", "0, 0, 0, 0, 0.1, 0, 0, 0 ]")
    with pytest.raises(ValueError, match="'left': expected dist of up to 8 coefficients, without thin prisms"):
        read_calibration(write(tmp_path, "opencv", **{"left.yml": text}))


def test_listed_cameras_have_a_place_and_a_target(tmp_path):
    """A file that is a preset of `synth` is a calibration of `dmae`; YAML takes 5e2 for a text."""
    camera = "{name: a, size: [640, 480], focal: 5e2, position: [3, 0, 2], target: [0, 0, 1]}"
    (tmp_path / "lab.yaml").write_text(f"# Mine\nname: lab\ncameras: [{camera}]\n")
    rig = read_calibration(tmp_path / "lab.yaml")
    np.testing.assert_allclose(rig.project(np.array([[0, 0, 1.0]]))[0], [[[319.5, 239.5]]])
    np.testing.assert_allclose(rig.centers, [[3, 0, 2]])
    (tmp_path / "lab.yaml").write_text(f"cameras: [{camera.replace('focal', 'foca')}]\n")
    with pytest.raises(ValueError, match=r"expected no other keys than name, size, .* found foca"):
        read_calibration(tmp_path / "lab.yaml")


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
        ValueError, match=r"calibration\.json: camera 'left': .* no image size; .*size = \[width, height\]"
    ):
        read_calibration(folder)
    folder = write(tmp_path, "pose2sim")
    (folder / "calibration.json").unlink()
    with pytest.raises(ValueError, match=r"calib\.toml: camera 'left': .* of 1000 x 600 px, .* the 9 x 9 px of"):
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
        assert FOUND.found(tmp_path / folder).resolve() == (tmp_path / file).resolve()


def test_a_folder_that_is_named_is_not_replaced_by_another_above_it(tmp_path):
    """As a folder of one day's calibration, in a format that is not read, beside the calibration of another day."""
    monday, tuesday = tmp_path / "calibration_monday", tmp_path / "calibration_tuesday"
    monday.mkdir()
    tuesday.mkdir()
    (monday / "Calib.toml").write_text(pose2sim_text())
    (tuesday / "Camera_0.pickle").touch()
    with pytest.raises(FileNotFoundError, match=r"tuesday: found no calibration; .*, OpenCap and"):
        CalibrationSource(str(tuesday)).read(tmp_path)
    assert FOUND.read(tuesday).names == ("left",)


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


ALL = [Convention(*values) for values in product(LengthUnit, UpDirection, (False, True))]


@pytest.mark.parametrize("convention", ALL, ids=str)
def test_there_and_back(convention):
    rig, xyz = looking_at_origin(), walkers().xyz
    written = convention.written_rig(rig)
    np.testing.assert_allclose(convention.rig(written).cam_from_world, rig.cam_from_world, atol=1e-12)
    np.testing.assert_allclose(convention.points(convention.written_points(xyz)), xyz, atol=1e-6)


@pytest.mark.parametrize("convention", [c for c in ALL if not c.inverse], ids=str)
def test_a_whole_file_in_another_convention_sees_the_same(convention):
    """Cameras and points written alike project alike, whatever the world is called."""
    rig, xyz = looking_at_origin(), walkers().xyz
    xy, depth = rig.project(xyz)
    in_file, far = convention.written_rig(rig).project(convention.written_points(xyz))
    np.testing.assert_allclose(in_file, xy, atol=1e-6)
    np.testing.assert_allclose(far * METRES[convention.unit], depth, atol=1e-6)


@pytest.mark.parametrize(
    ("up", "top"),
    [
        (UpDirection.x, (1, 0, 0)),
        (UpDirection.y, (0, 1, 0)),
        (UpDirection.z, (0, 0, 1)),
        (UpDirection.minus_y, (0, -1, 0)),
        (UpDirection.minus_z, (0, 0, -1)),
    ],
)
def test_up_becomes_z(up, top):
    np.testing.assert_array_equal(Convention(up=up).points(np.array(top)), (0, 0, 1))


def test_inverse_extrinsics_are_turned_round():
    rig = looking_at_origin()
    written = Convention(inverse=True).written_rig(rig)
    np.testing.assert_allclose(written.cam_from_world[:, :3, 3], rig.centers, atol=1e-12)


# Malformed calibrations: the error names the file, the camera and the key.


def without(text: str, key: str) -> str:
    """The only camera of a JSON file, less one key."""
    content = json.loads(text)
    camera = content["cameras"][0] if "cameras" in content else content["left"]
    del camera[key]
    return json.dumps(content)


MALFORMED = {
    "TOML: cut short": ("pose2sim", "calib.toml", lambda t: t[:200], ["expected TOML", "end of document"]),
    "TOML: a key is missing": (
        "pose2sim", "calib.toml", lambda t: t.replace("translation", "position"),
        ["camera 'cam_1'", "expected translation of 3 numbers", "no such key among .*position"],
    ),
    "TOML: no cameras": ("pose2sim", "calib.toml", lambda t: "[metadata]\n", ["expected a calibration", "found"]),
    "TOML: no table": ("pose2sim", "calib.toml", lambda t: "cam_2 = 3\n" + t, ["camera 'cam_2'", "a table", "found 3"]),
    "TOML: a table twice": ("pose2sim", "calib.toml", lambda t: t + "[cam_1]\n", ["expected TOML", "cam_1.* twice"]),
    "TOML: a name twice": (
        "pose2sim", "calib.toml", lambda t: t + t[t.index("[cam_1]") :].replace("cam_1", "cam_2"),
        ["different names", "'left' twice"],
    ),
    "TOML: a matrix that is no rotation": (
        "pose2sim", "calib.toml", lambda t: t.replace("[1.2, -0.7, 0.4]", str((2 * np.eye(3)).tolist())),
        ["camera 'cam_1'", "expected rotation to be a right-handed rotation", r"determinant \+8"],
    ),
    "TOML: three coefficients": (
        "pose2sim", "calib.toml", lambda t: t.replace(", -0.02]", "]"),
        ["camera 'cam_1'", "expected distortions of 4 or 5 or 8 numbers"],
    ),
    "TOML: not finite": ("pose2sim", "calib.toml", lambda t: t.replace("1.2", "nan"), ["rotation of finite numbers"]),
    "TOML: text for numbers": (
        "pose2sim", "calib.toml", lambda t: t.replace("1.2", '"a"'), ["rotation of 3 or 9 numbers"],
    ),
    "TOML: half a pixel": ("pose2sim", "calib.toml", lambda t: t.replace("600.0", "600.5"), ["size to be a .* whole"]),
    "TOML: fisheye says maybe": ("pose2sim", "calib.toml", lambda t: t.replace("false", "1"), ["fisheye to be true"]),
    "TOML: negative focal length": (
        "pose2sim", "calib.toml", lambda t: t.replace("880.0", "-880.0"), ["'cam_1'", "matrix .*focal", "900, -880"],
    ),
    "TOML: matrix by columns": (
        "pose2sim", "calib.toml", lambda t: t.replace(str(K.tolist()), str(K.T.tolist())), ["a camera matrix", "found"],
    ),
    "JSON: cut short": ("shelf", "calibration.json", lambda t: t[:-9], ["expected JSON", "line 1"]),
    "JSON: another file": ("shelf", "calibration.json", lambda t: '{"version": 1.3, "people": []}', ["a calibration"]),
    "JSON: a list": ("shelf", "calibration.json", lambda t: "[]", ["expected a calibration", r"found '\[\]'"]),
    "JSON: a camera twice": (
        "shelf", "calibration.json", lambda t: t[:-1] + ", " + t[1:], ["expected JSON", "key 'left' twice"],
    ),
    "4DAssociation: no rotation": (
        "shelf", "calibration.json", lambda t: json.dumps({"a": json.loads(t)["left"] | {"RT": [1.0] * 12}}),
        ["camera 'a'", "expected RT to be a right-handed rotation", r"determinant \+0"],
    ),
    "4DAssociation: no size": ("shelf", "calibration.json", lambda t: without(t, "imgSize"), ["'left'", "imgSize"]),
    "VoxelPose: no centre": ("voxelpose", "calibration.json", lambda t: without(t, "T"), ["'left'", "expected T of 3"]),
    "VoxelPose: negative focal length": (
        "voxelpose", "calibration.json", lambda t: t.replace("900.0", "-900.0"), ["'left'", "fx", "found -900"],
    ),
    "VoxelPose: mirrored": (
        "voxelpose", "calibration.json",
        lambda t: json.dumps({"left": json.loads(t)["left"] | {"R": np.diag([1, 1, -1]).tolist()}}),
        ["'left'", "expected R to be a right-handed rotation", r"determinant -1"],
    ),
    "Panoptic: no name": ("panoptic", "calibration_x.json", lambda t: without(t, "name"), ["'number 0'", "name"]),
    "Panoptic: no distortion": (
        "panoptic", "calibration_x.json", lambda t: without(t, "distCoef"), ["'left'", "distCoef of 5 numbers"],
    ),
    "Panoptic: a camera twice": (
        "panoptic", "calibration_x.json", lambda t: json.dumps({"cameras": json.loads(t)["cameras"] * 2}),
        ["different names", "'left' twice"],
    ),
    "Panoptic: no cameras": ("panoptic", "calibration_x.json", lambda t: '{"cameras": []}', ["cameras, found none"]),
    "EasyMocap: cut short": ("easymocap", "intri.yml", lambda t: t[:150], ["expected YAML", "line"]),
    "EasyMocap: cut in a matrix": (
        "easymocap", "extri.yml", lambda t: t[: t.rindex(",")] + " ]", ["T_left to be a matrix", "'rows': '3'"],
    ),
    "EasyMocap: not YAML": ("easymocap", "intri.yml", lambda t: t.replace("names:", "names: : :"), ["YAML", "line"]),
    "EasyMocap: a camera less": (
        "easymocap", "extri.yml", lambda t: t.replace("_left:", "_right:"),
        ["camera 'left'", "expected R_left of 3 numbers", "no such key among .*R_right"],
    ),
    "EasyMocap: a key twice": (
        "easymocap", "extri.yml", lambda t: t + t[t.index("T_left") :], ["twice in a table", "T_left"],
    ),
    "EasyMocap: no list of names": (
        "easymocap", "extri.yml", lambda t: t.replace('names:\n   - "left"', "names: left"), ["names .* list"],
    ),
    "EasyMocap: a camera without intrinsics": (
        "easymocap", "intri.yml", lambda t: t.replace("_left:", "_right:"), ["'left'", "expected K_left of 9 numbers"],
    ),
    "EasyMocap: a name twice": (
        "easymocap", "extri.yml", lambda t: t.replace('- "left"', '- "left"\n   - "left"'), ["'left' twice"],
    ),
    "EasyMocap: vector and matrix disagree": (
        "easymocap", "extri.yml", lambda t: t.replace("1.2000", "1.2500"),
        ["camera 'left'", "expected Rot_left to be the matrix of R_left", "off by"],
    ),
    "EasyMocap: the matrix where the vector belongs": (
        "easymocap", "extri.yml", lambda t: t.replace("R_left", "X_left").replace("Rot_left", "R_left"),
        ["camera 'left'", "expected R_left of 3 numbers"],
    ),
    "EasyMocap: no height": (
        "easymocap", "intri.yml", lambda t: t.replace("H_left", "X_left"), ["expected H_left of 1 numbers"],
    ),
    "EasyMocap: half the pair": ("easymocap", "extri.yml", None, ["no such file", "side by side"]),
}  # fmt: skip


@pytest.mark.parametrize(("format", "name", "change", "message"), MALFORMED.values(), ids=MALFORMED)
def test_malformed_files_are_named_with_camera_and_key(format, name, change, message, tmp_path):
    folder = write(tmp_path, format)
    if change is None:
        (folder / name).unlink()
    else:
        text = (folder / name).read_text()
        assert change(text) != text
        (folder / name).write_text(change(text))
    with pytest.raises((ValueError, FileNotFoundError)) as error:
        read_calibration(find_calibration(folder))
    for part in [str(folder), *message]:
        error.match(part)


@pytest.mark.parametrize("name", ["intri.yml", "extri.yml"])
def test_yaml_cut_anywhere_is_an_error_or_whole(name, tmp_path):
    """OpenCV's reader of these files does not survive this."""
    folder = write(tmp_path, "easymocap")
    text = (folder / name).read_text().rstrip()
    last_number = len(text) - 1 if name == "extri.yml" else text.rindex(" ") + 1
    for length in range(0, last_number, 7):
        (folder / name).write_text(text[:length])
        with pytest.raises(ValueError, match=r"intri|extri"):
            read_calibration(folder)


def test_names_that_are_no_text_are_listed():
    with pytest.raises(ValueError, match=r"expected res of 2 numbers, found no such key among \['K', \"b'T'\"\]"):
        CameraTable(Path("camera_params.npy"), "1", {"K": 1, b"T": 2}).numbers("res", 2)


def test_a_clip_is_a_calibration_as_well(tmp_path):
    rig = pinholes()
    save_clip(Clip("walk", 25.0, rig, Detections2D(BODY25, np.zeros((1, 4, 0, 25, 2)))), tmp_path / "walk")
    found = read_calibration(tmp_path / "walk")
    assert found.names == rig.names
    np.testing.assert_array_equal(found.cam_from_world, rig.cam_from_world)
    assert written_convention(DataConfig("openpose", "rec", calibration=str(tmp_path / "walk"))) is None
    with pytest.raises(ValueError, match="walk: a clip says that itself; leave out unit, up"):
        read_calibration(tmp_path / "walk", unit=LengthUnit.mm, up=UpDirection.y)
