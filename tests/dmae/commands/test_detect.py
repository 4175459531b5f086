"""`dmae detect` and `dmae run`, with a detector that finds bright dots, and BlazePose on real and rendered images."""

import inspect
import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import dmae as dmae_package
from dmae.cli import DMAE, compose
from dmae.commands import detect
from dmae.commands.config import DetectCommand, RunCommand
from dmae.commands.run import run
from dmae.data.clip import Clip
from dmae.data.images import Images, write_video
from dmae.data.skeleton import COCO17
from dmae.data.store import load_clip, save_clip, write_manifest
from dmae.detection.recording import recording_name
from dmae.detection.registry import PoseDetectorConfig
from dmae.formats.calibrations import write_calibration
from dmae.verbs import recordings
from tests.support.commands import dmae
from tests.support.detected_people import detected_clip, walk

DETECTOR = '''
import numpy as np
from dmae import get_skeleton

class Dots:
    """Joint j of COCO-17 is the dot of brightness 80 + 10 j."""
    skeleton = get_skeleton("coco17")
    def __call__(self, image):
        rows, columns = np.nonzero(image[..., 0])
        shades = image[rows, columns, 0].astype(int)
        xy = np.full((1, 17, 2), np.nan)
        for joint in range(17):
            dot = abs(shades - 80 - 10 * joint) <= 2
            if dot.sum() >= 9:
                xy[0, joint] = np.median(columns[dot]), np.median(rows[dot])
        return xy, np.where(np.isnan(xy[..., 0]), np.nan, 0.9)

def dots(config):
    return Dots()

def nothing(config):
    return 7

def without_options():
    return Dots()

def kind(config):
    return Dots

class Other(Dots):
    def __init__(self, change):
        self.change = change
    def __call__(self, image):
        return self.change(*super().__call__(image))

def shares(config):
    return Other(lambda xy, score: (xy / 1e4, score))

def places(config):
    return Other(lambda xy, score: xy)

def unsure(config):
    return Other(lambda xy, score: (xy, None))

def nobody(config):
    return Other(lambda xy, score: ([], []))

def mistaken(config):
    return Other(lambda xy, score: {}["heatmap"])

def unfinished(poses, clip, path):
    raise ValueError("no dots yet")
'''


@pytest.fixture(scope="module")
def filmed(tmp_path_factory) -> tuple[Clip, Path]:
    """A walker of dots, and the folder of images of each of three cameras."""
    clip = detected_clip(walk((-0.3, -0.2), (0.3, 0.2), frames=12)[:, None], 3, miss=0, noise=0)
    folder = tmp_path_factory.mktemp("filmed")
    for view, name in enumerate(clip.rig.names):
        write_images(folder / name, clip, view)
    return clip, folder


@pytest.fixture
def session(filmed: tuple[Clip, Path], tmp_path: Path) -> Clip:
    """Videos of a walker of dots in three cameras, its calibration, the detector; and the clip that they show."""
    clip, folder = filmed
    shutil.copytree(folder, tmp_path / "videos")
    (tmp_path / "my_dots.py").write_text(DETECTOR)
    write_calibration(clip.rig, tmp_path / "calibration.toml", "pose2sim")
    return clip


def write_images(folder: Path, clip: Clip, view: int) -> None:
    folder.mkdir(parents=True)
    joints = clip.detections.skeleton.index(*COCO17.joints)
    for frame in range(len(clip)):
        image = np.zeros((*clip.rig.size[view][::-1], 3), np.uint8)
        for number, (x, y) in enumerate(clip.detections.xy[frame, view, 0][joints]):
            if np.isfinite(x):
                cv2.rectangle(
                    image, (round(x) - 2, round(y) - 2), (round(x) + 2, round(y) + 2), (80 + 10 * number,) * 3, -1
                )
        cv2.imwrite(str(folder / f"{frame:05d}.png"), image)


ARGUMENTS = ("videos=videos", "calibration=calibration.toml", "detector=my_dots:dots", "fps=25")


def test_images_become_a_clip_that_is_captured(session: Clip, tmp_path: Path):
    exported = "export=[npz,coco,movement,openpose]"
    done = dmae(tmp_path, "run", *ARGUMENTS, "out=made", exported.replace("[", "[my_dots:unfinished,"))
    # The other formats are written.
    assert done.returncode == 1 and "ValueError: no dots yet (my_dots.py, line" in done.stderr
    clip = load_clip(tmp_path / "made/captured")
    assert clip.id == load_clip(tmp_path / "made/completed").id == "made"
    assert (clip.fps, len(clip), clip.detections.skeleton.name, clip.images.kinds) == (25, 12, "coco17", ("rgb",))
    assert clip.poses.xyz.shape[1] == 1 and np.isfinite(clip.poses.xyz).mean() > 0.6
    true = session.truth.xyz[:, :, session.truth.skeleton.index(*COCO17.joints)]
    assert np.nanmedian(np.linalg.norm(clip.poses.xyz - true, axis=-1)) < 0.02
    written = ["report.html", "poses.npz", "poses.json", "poses.nc", "poses_images", "poses_openpose"]
    assert all((tmp_path / "made" / name).exists() for name in written)
    earlier = tmp_path / "made/poses_openpose/of_other_options"
    earlier.touch()
    again = dmae(tmp_path, "run", *ARGUMENTS, "out=made", exported)
    assert again.returncode == 0 and "detected already" in again.stdout, again.stderr
    assert not earlier.exists()
    assert all((tmp_path / "made" / name).exists() for name in written)


def test_run_names_a_late_camera_and_says_each_note_once(session: Clip, tmp_path: Path):
    (tmp_path / "videos" / session.rig.names[1] / "00011.png").unlink()
    (tmp_path / "videos" / session.rig.names[0] / "00005.png").write_bytes(b"damaged")
    (tmp_path / "videos" / session.rig.names[2]).rename(tmp_path / "videos" / "CAM_2")
    done = dmae(tmp_path, "run", *ARGUMENTS, "offsets=[cam-2:3]", "out=made", "export=[npz]")
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("cameras end at different frames (cam0 12, cam1 11, cam2 15)") == 1
    assert done.stdout.count("1 of 12 images cannot be read") == 1
    wrong = dmae(tmp_path, "run", *ARGUMENTS, "offsets=[cam7:3]", "out=other")
    assert "offsets=['cam7:3']: expected a number for each camera, or entries as cam0:3 of some of" in wrong.stderr


def test_damaged_frames_a_shorter_and_a_missing_camera_lose_nothing_else(session: Clip, tmp_path: Path):
    names = session.rig.names
    for file in (tmp_path / "videos" / names[2]).iterdir():
        file.unlink()
    (tmp_path / "videos" / names[2]).rmdir()
    (tmp_path / "videos" / names[1] / "00011.png").unlink()
    (tmp_path / "videos" / names[0] / "00005.png").write_bytes(b"damaged")
    done = dmae(tmp_path, "detect", *ARGUMENTS, "out=found", "output.images=false")
    assert done.returncode == 0, done.stderr
    for said in (
        "1 calibrated camera has no images and is left out: cam2",
        "1 of 12 images cannot be read (5)",
        "cameras end at different frames",
    ):
        assert said in done.stdout
    seen = load_clip(tmp_path / "found").detections.observed.any((2, 3))
    assert seen.shape == (12, 2) and not seen[5, 0] and not seen[11, 1] and seen.sum() == 22


def test_no_people(session: Clip, tmp_path: Path):
    for file in (tmp_path / "videos").glob("*/*.png"):
        cv2.imwrite(str(file), np.zeros_like(cv2.imread(str(file))))
    done = dmae(tmp_path, "detect", *ARGUMENTS, "out=found", "output.images=false")
    assert done.returncode == 0 and done.stdout.count("no people detected") == 3
    assert not load_clip(tmp_path / "found").detections.observed.any()


@pytest.mark.parametrize("format", ["openpose", "coco"])
def test_without_a_calibration_keypoints_are_written(session: Clip, tmp_path: Path, format: str):
    done = dmae(tmp_path, "detect", ARGUMENTS[0], *ARGUMENTS[2:], "out=flat", f"output.format={format}")
    assert done.returncode == 0, done.stderr
    name = session.rig.names[0]
    if format == "openpose":
        assert len(list((tmp_path / "flat" / name).glob("*_keypoints.json"))) == 12
    else:
        written = json.loads((tmp_path / "flat" / f"{name}.json").read_text())
        assert len(written["images"]) == 12 and len(written["annotations"]) == 12


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "expected videos="),
        (("videos=nowhere",), "videos=nowhere: no such file"),
        (("videos=videos",), "expected fps="),
        (("videos=videos", "fps=25", "detector=my_dots:nothing"), "it returned int"),
        (("videos=videos", "fps=25", "detector=my_dots:without_options"), "expected a function of config"),
        (("videos=videos", "fps=25", "detector=my_dots:kind"), "it returned the class Dots itself"),
        (
            ("videos=videos", "fps=25", "calibration=cam.toml"),
            "calibration=cam.toml: no such file or folder",
        ),
        (("videos=videos", "fps=25", "detector=blasepose"), "did you mean blazepose"),
        (("videos=videos", "fps=25", "detector=onnx"), "expected detector.path"),
        (("videos=videos", "fps=25", "detector=my_dots:dots", "output.skeleton=shelf15"), "output.skeleton=shelf15"),
        (("clip=nowhere",), "clip=nowhere: no such file"),
        (("clip=nowhere", "fps=25"), "leave them out"),
        (("clip=nowhere", "world.unit=mm"), "leave them out"),
        (("videos=videos", "fps=25", "world.up=y"), "world.* are of calibration=..., and there is none"),
    ],
)
def test_bad_input_is_one_line(session: Clip, tmp_path: Path, arguments, said):
    done = dmae(tmp_path, "detect", *arguments, "out=found")
    assert done.returncode == 1 and said in done.stderr, done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "found/detect.json").exists()


def test_what_a_detector_returns_is_checked_and_a_mended_one_may_have_the_folder(session: Clip, tmp_path: Path):
    for name, said in (
        ("shares", "expected pixels"),
        ("places", "1 if the detector states none; found"),
        ("unsure", "1 if the detector states none; found [(1, 17, 2), None]"),
        ("mistaken", "error: detector=my_dots:mistaken: KeyError: 'heatmap' (my_dots.py, line "),
    ):
        done = dmae(tmp_path, "detect", *ARGUMENTS[:2], f"detector=my_dots:{name}", "fps=25", "out=found")
        assert done.returncode == 1 and said in done.stderr, done.stderr
        assert len(done.stderr.strip().splitlines()) == 1
    assert dmae(tmp_path, "detect", *ARGUMENTS, "out=found").returncode == 0


def test_empty_lists_are_nobody(session: Clip, tmp_path: Path):
    done = dmae(tmp_path, "detect", *ARGUMENTS[:2], "detector=my_dots:nobody", "fps=25", "out=found")
    assert done.returncode == 0, done.stderr
    assert "people per frame in each camera: 0.00, 0.00, 0.00" in done.stdout


def test_another_detector_rate_offset_or_calibration_is_refused_in_the_same_folder(session: Clip, tmp_path: Path):
    arguments = [*ARGUMENTS, "out=found", "output.images=false"]
    assert dmae(tmp_path, "detect", *arguments).returncode == 0
    said = "another configuration: detect.json differs in "
    done = dmae(tmp_path, "detect", *ARGUMENTS[:2], "fps=25", "out=found", "output.images=false")
    assert done.returncode == 1 and said in done.stderr
    done = dmae(tmp_path, "detect", *arguments[:3], "fps=50", "offsets=[0,1,0]", *arguments[4:])
    assert done.returncode == 1 and f"{said}fps, offsets." in done.stderr
    done = dmae(tmp_path, "detect", *arguments, "frames=[0,10]")
    assert done.returncode == 1 and f"{said}frames. Choose another" in done.stderr
    done = dmae(tmp_path, "detect", *arguments, f"offsets=[{session.rig.names[1]}:1]")
    assert done.returncode == 1 and f"{said}offsets." in done.stderr
    assert "dmae capture data=found data.offsets=[<camera>:<frames later than here>] uses" in done.stderr
    first = min((tmp_path / "videos" / session.rig.names[0]).iterdir())
    image = first.read_bytes()
    cv2.imwrite(str(first), 255 - cv2.imread(str(first)))
    done = dmae(tmp_path, "detect", *arguments)
    assert done.returncode == 1 and f"{said}videos." in done.stderr, done.stdout
    first.write_bytes(image)
    moved = session.rig.cam_from_world.copy()
    moved[:, 2, 3] += 0.01
    write_calibration(replace(session.rig, cam_from_world=moved), tmp_path / "other.toml", "pose2sim")
    done = dmae(tmp_path, "detect", "videos=videos", "calibration=other.toml", *arguments[2:])
    assert done.returncode == 1 and f"{said}calibration.cam_from_world." in done.stderr
    assert "dmae capture data=found data.calibration=other.toml uses these detections" in done.stderr
    done = dmae(tmp_path, "detect", "videos=videos", "calibration=other.toml", "world.unit=mm", *arguments[2:])
    assert "dmae capture data=found data.calibration=other.toml data.unit=mm uses these detections" in done.stderr
    done = dmae(tmp_path, "capture", "data=found", "data.calibration=other.toml", "out=captured")
    np.testing.assert_allclose(load_clip(tmp_path / "captured").rig.cam_from_world, moved, atol=1e-6)


def test_detections_are_of_one_content_of_the_model(tmp_path: Path):
    model = tmp_path / "model.onnx"
    model.write_bytes(b"one")
    config = DetectCommand(clip="clip", detector=PoseDetectorConfig(name="onnx", path=str(model)))
    before = detect._settings(config)
    model.write_bytes(b"two")
    assert detect._settings(config) != before
    model.write_bytes(b"one")
    assert detect._settings(config) == before


def test_detections_are_of_one_content_of_own_code_and_skeletons(session: Clip, tmp_path: Path):
    own = "name: seventeen\njoints: {" + ", ".join(f"{joint}: null" for joint in COCO17.joints) + "}\n"
    (tmp_path / "own.yaml").write_text(own)
    # A module of another name, as `my_dots` of other tests is loaded.
    (tmp_path / "changing_dots.py").write_text(DETECTOR)
    arguments = [
        *ARGUMENTS[:2],
        "detector=changing_dots:dots",
        ARGUMENTS[3],
        "output.skeleton=own.yaml",
        "out=found",
        "output.images=false",
    ]
    done = dmae(tmp_path, "detect", *arguments)
    assert done.returncode == 0, done.stderr
    assert "found: detected already" in dmae(tmp_path, "detect", *arguments).stdout
    for file, before, now, said in (
        ("own.yaml", "nose: null", "nose: l_eye", "output.skeleton."),
        ("changing_dots.py", "0.9", "0.8", "detector.code"),
    ):
        text = (tmp_path / file).read_text()
        (tmp_path / file).write_text(text.replace(before, now))
        done = dmae(tmp_path, "detect", *arguments)
        assert done.returncode == 1 and f"detect.json differs in {said}" in done.stderr, done.stdout
        (tmp_path / file).write_text(text)


def test_a_clip_with_images_keeps_its_truth(session: Clip, tmp_path: Path):
    for name in session.rig.names:
        images = (cv2.imread(str(file)) for file in sorted((tmp_path / "videos" / name).glob("*.png")))
        write_video(tmp_path / "seen/rgb" / f"{name}.mp4", images, 25)
    images = Images(tmp_path / "seen", session.rig.names, tuple(range(12)), ("rgb",))
    save_clip(replace(session, images=images), tmp_path / "seen")
    done = dmae(tmp_path, "detect", "clip=seen", "detector=my_dots:dots", "out=found")
    assert done.returncode == 0, done.stderr
    found = load_clip(tmp_path / "found")
    np.testing.assert_array_equal(found.truth.xyz, session.truth.xyz)
    assert found.detections.skeleton.name == "coco17" and found.images.path("rgb", session.rig.names[0]).is_file()
    assert dmae(tmp_path, "detect", "clip=seen", "out=seen").returncode == 1
    save_clip(replace(session, images=images, fps=50), tmp_path / "seen")
    done = dmae(tmp_path, "detect", "clip=seen", "detector=my_dots:dots", "out=found")
    assert done.returncode == 1 and "detect.json differs in clip." in done.stderr, done.stdout
    save_clip(replace(session, images=images).select(views=[0]), tmp_path / "one")
    with pytest.raises(ValueError, match="pictures of 1 camera; capture needs two or more"):
        run(RunCommand(clip=str(tmp_path / "one"), detector=PoseDetectorConfig(name="blazepose")), tmp_path / "all")
    assert not (tmp_path / "all/detected").exists()


def test_a_clip_made_by_the_verb_is_that_of_the_command(session: Clip, tmp_path: Path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    given = {"source": tmp_path / "videos", "calibration": tmp_path / "calibration.toml", "detector": "my_dots:dots"}
    in_memory = dmae_package.run(**given, fps=25)
    on_disk = dmae_package.run(**given, fps=25, out=tmp_path / "run")
    np.testing.assert_array_equal(in_memory.detections.xy, on_disk.detections.xy)
    np.testing.assert_array_equal(in_memory.poses.xyz, on_disk.poses.xyz)
    assert in_memory.poses.xyz.shape[1] == 1 and (tmp_path / "run/poses.trc").is_file()


def test_some_frames_of_a_recording_keep_their_numbers(session: Clip, tmp_path: Path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    given = {"source": tmp_path / "videos", "calibration": tmp_path / "calibration.toml", "detector": "my_dots:dots"}
    whole = dmae_package.detect(**given, fps=25)
    part = dmae_package.run(**given, fps=25, frames=(4, 9), out=tmp_path / "run")
    np.testing.assert_array_equal(part.detections.xy, whole.detections.xy[4:9])
    rows = (tmp_path / "run/poses.trc").read_text().splitlines()[5:]
    assert [row.split("\t")[0] for row in rows if row] == ["4", "5", "6", "7", "8"]
    shown, filmed = part.images.at("rgb", part.rig.names[0], 0), cv2.imread(tmp_path / "videos" / "cam0/00004.png")
    assert np.abs(shown.astype(int) - filmed).mean() < 1
    with pytest.raises(ValueError, match=r"frames are of videos"):
        dmae_package.detect(part, frames=(0, 2))
    done = dmae(tmp_path, "run", "clip=run/completed", "frames=[0,2]", "out=other")
    assert "a shorter clip: dmae convert data=run/completed data.frames=[0,2] out=shorter" in done.stderr
    done = dmae(tmp_path, "run", *ARGUMENTS, "frames=[4,10]", "out=run")
    assert done.returncode == 1 and "frames" in done.stderr


def test_a_verb_given_a_clip_in_memory_writes_no_folder(session: Clip, tmp_path: Path):
    with pytest.raises(ValueError, match=r"dmae\.save"):
        dmae_package.run(session, out=tmp_path / "run")


def test_a_verb_refuses_a_data_set_and_one_camera_before_people_are_detected(
    session: Clip, tmp_path: Path, monkeypatch
):
    monkeypatch.setattr(recordings, "detect_recording", None)
    for name in ("000000", "000001"):
        save_clip(session, tmp_path / "set" / name)
    write_manifest(tmp_path / "set", [{"id": name, "status": "ok"} for name in ("000000", "000001")])
    with pytest.raises(FileNotFoundError, match="this is a data set, name the folder of one clip in it"):
        dmae_package.run(tmp_path / "set", out=tmp_path / "run")
    with pytest.raises(ValueError, match="capture needs at least 2 cameras, found 1"):
        dmae_package.run(session.select(views=[0]))
    for name in session.rig.names[1:]:
        shutil.rmtree(tmp_path / "videos" / name)
    for out in (None, tmp_path / "run"):
        with pytest.raises(ValueError, match="capture needs"):
            dmae_package.run(tmp_path / "videos", tmp_path / "calibration.toml", fps=25, out=out)


def test_options_of_the_verb_default_to_those_of_the_command():
    named = inspect.signature(dmae_package.run).parameters
    config = compose(DMAE.commands["run"], ["videos=a", "calibration=b"])
    for name in ("weights", "fps", "offsets", "frames", "workers"):
        assert named[name].default == getattr(config, name)
    assert named["detector"].default == config.detector.name
    # None tells formats that were asked for without a folder from the command's default, which the verb states, too.
    assert named["export"].default is None and config.export == ["trc"]


def test_videos_given_as_data_are_answered_with_the_command(session: Clip, tmp_path: Path):
    done = dmae(tmp_path, "capture", "data=videos", "out=captured")
    assert done.returncode == 1 and "use dmae run videos=videos" in done.stderr, done.stderr
    of_one = f"videos/{session.rig.names[0]}"
    for path in (of_one, f"{of_one}/00000.png"):
        done = dmae(tmp_path, "capture", f"data={path}", "out=captured")
        assert done.returncode == 1 and f"dmae detect photos={path} finds the people" in done.stderr, done.stderr


def test_one_camera_is_detected_and_named_as_too_few_for_capture(session: Clip, tmp_path: Path):
    for name in session.rig.names[1:]:
        shutil.rmtree(tmp_path / "videos" / name)
    done = dmae(tmp_path, "detect", *ARGUMENTS, "out=found", "output.images=false")
    assert done.returncode == 0 and "one camera: capture needs two or more" in done.stdout, done.stderr
    assert len(load_clip(tmp_path / "found").rig) == 1
    done = dmae(tmp_path, "run", *ARGUMENTS, "out=all")
    assert done.returncode == 1 and "all: pictures of 1 camera; capture needs two or more" in done.stderr
    assert not (tmp_path / "all/detected/clip.json").exists()
    # Called as the session that the folder `videos` is in, not as the step that made it.
    assert load_clip(tmp_path / "found").id == tmp_path.name


@pytest.mark.parametrize("folder", ["walk/videos", "walk/Images", "walk"])
def test_a_clip_has_the_name_of_its_recording(folder: str, tmp_path: Path):
    assert recording_name(tmp_path / folder) == "walk"
