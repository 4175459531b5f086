"""Recordings with impossible numbers: one clear line, through every way in."""

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

import dmae
from tests.support.commands import run_command
from tests.support.detected_people import crossing, detected_clip

RATES = "0", "-25", "1e-9", "NaN", "Infinity"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A captured clip, and its detections as files of OpenPose."""
    where = tmp_path_factory.mktemp("recordings")
    clip = detected_clip(crossing()[:6], 3)
    dmae.save(replace(clip, poses=dmae.capture(clip)), where / "clip")
    dmae.convert(clip, where / "files", "openpose")
    return where


@pytest.mark.parametrize("rate", RATES)
def test_impossible_rates_are_one_line(folder, rate):
    shutil.rmtree(folder / "broken", ignore_errors=True)
    shutil.copytree(folder / "clip", folder / "broken")
    text = (folder / "broken/clip.json").read_text()
    (folder / "broken/clip.json").write_text(re.sub(r'"fps": *[-+.e0-9]+', f'"fps": {rate}', text))
    options = "data=openpose", "data.path=files", f"data.fps={rate.replace('Infinity', 'inf')}", "out=made"
    for command in (
        ("capture", *options),
        ("convert", *options, "format=clip"),
        ("complete", "clip=broken", "out=made"),
    ):
        done = run_command(folder, "dmae", *command)
        assert done.returncode == 1
        assert "fps: expected frames per second from 0.0001 to 100000, found" in done.stderr
        assert done.stderr.count("\n") == 1
        assert not (folder / "made").exists()
    with pytest.raises(ValueError, match="expected frames per second"):
        replace(detected_clip(crossing()[:6], 3), fps=float(rate))


def rewritten(folder, name: str, change) -> str:
    """Files of OpenPose with other joints (25, 3) of each person, by the name of the camera."""
    shutil.copytree(folder / "files", folder / name)
    for file in (folder / name).rglob("*_keypoints.json"):
        content = json.loads(file.read_text())
        for person in content["people"]:
            joints = np.reshape(person["pose_keypoints_2d"], (25, 3)).astype(float)
            person["pose_keypoints_2d"] = change(joints, file.parent.name).ravel().tolist()
        file.write_text(json.dumps(content))
    return name


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda joints, _: joints * (1, 1, 0), "only joints of confidence 0, which is absent"),
        (lambda joints, _: np.where(joints[:, 2:] > 0, joints * (1, 1, 0) + (0, 0, -1), 0), "confidence 0, which is"),
        (lambda joints, camera: joints * (1, 1, camera != "cam0"), "no detections of cam0: the files hold no people"),
        (lambda joints, _: joints * (1, 1, 0) + (0, 0, 2 * (joints[0, 2] > -1)), "confidences say nothing"),
        (lambda joints, _: joints * (1, 1, 100), "most confidences are above 1, as percents are: capture.th_p=0.2"),
        (lambda joints, _: joints[:, [2, 0, 1]], "above 100: are x, y and the confidence of each joint in this order?"),
        (lambda joints, _: joints / (960, 960, 1), "expected pixels"),
        (lambda joints, _: joints / (500, 500, 1), "expected pixels"),
        (lambda joints, camera: joints * ((0.5, 0.5, 1) if camera == "cam2" else 1), "cam2: 0% of 410 detected joints"),
        (lambda joints, _: joints[:, :2], "expected x, y, confidence of each joint (1 if the detector states none)"),
    ],
    ids=[
        "0",
        "-1",
        "0 in one camera",
        "2",
        "percent",
        "order",
        "shares",
        "metres",
        "half in one camera",
        "no confidences",
    ],
)
def test_other_units_and_confidences_are_named(folder, change, line, request):
    name = rewritten(folder, re.sub(r"\W", "", request.node.callspec.id), change)
    done = run_command(folder, "dmae", "capture", "data=openpose", f"data.path={name}", "data.fps=25", f"out=of_{name}")
    assert line in done.stdout + done.stderr
    assert "Traceback" not in done.stderr


def test_image_sizes_of_height_and_width_are_named(folder):
    clip = dmae.load(folder / "clip")
    dmae.save(replace(clip, rig=replace(clip.rig, size=clip.rig.size[:, ::-1])), folder / "turned")
    turned, right = (
        run_command(folder, "dmae", "capture", f"data={each}", f"out={each}_3d") for each in ("turned", "clip")
    )
    assert re.search(r"cam1: \d+% of its detected joints are outside its image of 600 x 960 px", turned.stdout), turned
    assert "outside its image" not in right.stdout


def test_a_camera_that_is_not_chosen_needs_no_calibration(folder):
    """One of four cameras was not calibrated."""
    path = folder / rewritten(folder, "three_calibrated", lambda joints, _: joints)
    clip = detected_clip(crossing()[:6], 3)
    dmae.convert(clip.select(views=[0, 1]), folder / "two", "openpose")
    shutil.copy(folder / "two/calibration.toml", path)
    with pytest.raises(ValueError, match=r"cam2 has none.*cameras="):
        dmae.read(path, fps=25)
    assert dmae.read(path, fps=25, cameras=["cam0", "cam1"]).rig.names == ("cam0", "cam1")
