"""Malformed calibrations: the error names the file, the camera and the key."""

import json
from pathlib import Path

import numpy as np
import pytest

from dmae.formats.calibrations.entries import CameraTable
from dmae.formats.calibrations.files import find_calibration, read_calibration
from tests.support.calibrations import K, write


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
    "TOML: a matrix for a Rodrigues vector": (
        "pose2sim", "calib.toml", lambda t: t.replace("[1.2, -0.7, 0.4]", str(np.eye(3).tolist())),
        ["camera 'cam_1'", "expected rotation of 3 numbers", r"found \[\[1\.0"],
    ),
    "TOML: three coefficients": (
        "pose2sim", "calib.toml", lambda t: t.replace(", -0.02]", "]"),
        ["camera 'cam_1'", "expected distortions of 4 or 5 or 8 numbers"],
    ),
    "TOML: not finite": ("pose2sim", "calib.toml", lambda t: t.replace("1.2", "nan"), ["rotation of finite numbers"]),
    "TOML: text for numbers": ("pose2sim", "calib.toml", lambda t: t.replace("1.2", '"a"'), ["rotation of 3 numbers"]),
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
