"""Files written for a clip: a sheet, a video and a recording, by the command and by Python."""

import json
import shutil
import sys
import types
from dataclasses import replace
from importlib import util
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

import dmae as verbs
from dmae.data.clip import Clip, Source
from dmae.data.labels import Visibility
from dmae.data.store import save_clip, write_manifest
from dmae.files.contents import written_whole
from dmae.viewing.config import LayersConfig
from dmae.viewing.overlay import COLOURS, DETECTED, RED, Layers, Overlay, chosen_layers, person_colour
from dmae.viewing.show import header, write_overlay_video, write_sheet
from tests.support.commands import dmae, synth
from tests.support.shown_clips import captured_clip, near, occluded_clip, with_images

PERSON, OBJECT = Visibility.HIDDEN_BY_PERSON, Visibility.HIDDEN_BY_OBJECT


def layers_of(clip: Clip, **options) -> Layers:
    return chosen_layers(clip, LayersConfig(**options))


def test_the_sheet_has_a_row_per_frame_and_a_column_per_view(tmp_path: Path):
    clip = occluded_clip()
    layers = layers_of(clip)
    write_sheet(clip, tmp_path / "a.png", layers, rows=2, width=320)
    write_sheet(with_images(clip, tmp_path / "images"), tmp_path / "b.png", layers, rows=2, width=320)
    plain, green = (cv2.imread(str(tmp_path / name))[..., ::-1] for name in ("a.png", "b.png"))
    assert plain.shape == green.shape
    assert plain.shape[1] == 2 * (320 + 6) + 6
    assert 2 * 240 < plain.shape[0] < 2 * 300 + 100
    assert near(green, (20, 120, 20)).mean() > 0.5
    assert not near(plain, (20, 120, 20)).any()
    # More rows than frames show every frame once.
    write_sheet(clip, tmp_path / "c.png", layers, rows=50, width=320)
    top = header(Overlay(clip, 320, layers), plain.shape[1]).shape[0]
    assert cv2.imread(str(tmp_path / "c.png")).shape[0] - top == (plain.shape[0] - top) * 3 // 2


def test_many_views_take_several_rows(tmp_path: Path):
    clip = occluded_clip(frames=2, views=7)
    layers = layers_of(clip)
    write_sheet(clip, tmp_path / "a.png", layers, rows=1, width=200)
    write_sheet(clip.select(views=slice(0, 6)), tmp_path / "b.png", layers, rows=1, width=200)
    seven, six = (cv2.imread(str(tmp_path / name)) for name in ("a.png", "b.png"))
    assert seven.shape[1] == six.shape[1] == 6 * 206 + 6
    top = header(Overlay(clip, 200, layers), 6 * 206 + 6).shape[0]
    assert seven.shape[0] - top == 2 * (six.shape[0] - top)


def test_the_video_shows_every_frame(tmp_path: Path):
    clip = with_images(occluded_clip(views=3), tmp_path)
    write_overlay_video(clip, tmp_path / "a.mp4", layers_of(clip), width=401)
    with av.open(str(tmp_path / "a.mp4")) as container:
        assert container.streams.video[0].codec_context.name == "h264"
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert len(frames) == 3
    assert all(side % 2 == 0 for side in frames[0].shape[:2])
    # In the last frame the second person is not there.
    pink = [near(frame[84:], COLOURS[PERSON]).sum() for frame in frames]
    assert pink[0] > 50 > pink[2]


def test_a_file_is_whole_or_not_there(tmp_path: Path):
    (tmp_path / "a.mp4").write_text("old")
    with pytest.raises(KeyboardInterrupt), written_whole(tmp_path / "a.mp4") as part:
        part.write_text("half")
        raise KeyboardInterrupt
    assert [path.name for path in tmp_path.iterdir()] == ["a.mp4"]
    assert (tmp_path / "a.mp4").read_text() == "old"


def test_the_command_draws_a_captured_clip_and_reports_what_it_lacks(tmp_path: Path):
    save_clip(captured_clip(), tmp_path / "walk")
    done = dmae(tmp_path, "show", "data=walk", "out=out", "frames=1", "width=200", "cameras=[c1]", "video=true")
    assert done.returncode == 0, done.stderr
    assert "clip shown: no images\n" in done.stdout
    assert {"clip.mp4", "sheet.png"} <= {path.name for path in (tmp_path / "out").iterdir()}
    assert near(cv2.imread(str(tmp_path / "out/sheet.png"))[80:, :, ::-1], RED).any()
    done = dmae(tmp_path, "show", "data=walk", "out=one", "layers.completed=false", "width=200", "frames=3")
    assert [path.name for path in (tmp_path / "one").glob("*.[mp]*")] == ["sheet.png"]
    assert not near(cv2.imread(str(tmp_path / "one/sheet.png"))[80:, :, ::-1], RED).any()


def test_a_clip_that_was_copied_without_its_images_is_drawn_and_exported(tmp_path: Path, capsys):
    clip = with_images(captured_clip(), tmp_path / "images")
    shutil.rmtree(tmp_path / "images")
    verbs.draw(clip, frame=0)
    verbs.show(clip, tmp_path / "drawn", verbs.ShowConfig(frames=1, width=200))
    (file,) = verbs.export(clip, tmp_path / "a.json", "coco")
    assert json.loads(file.read_text())["info"]["images"] is False
    assert capsys.readouterr().err.count(f"no folder {tmp_path / 'images'} with its images; they are left out") == 3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["cameras=[c7]"], "cameras=[c7]: expected names of cameras of clip 'shown', each once; it has c0, c1"),
        (["frames=0"], "frames=0: expected 1 or more"),
        (["width=20"], "width=20: expected 160 or more"),
        (["layers.hidden=true"], "layers.hidden: no such option"),
    ],
)
def test_impossible_options_are_refused(tmp_path: Path, options: list[str], message: str):
    save_clip(captured_clip(), tmp_path / "walk")
    done = dmae(tmp_path, "show", "data=walk", "out=out", *options)
    assert done.returncode == 1 and message in done.stderr
    assert not (tmp_path / "out/sheet.png").exists()


def test_each_clip_of_a_data_set_has_a_folder(tmp_path: Path):
    for name in "ab":
        save_clip(replace(captured_clip(), id=name), tmp_path / "set" / name)
    write_manifest(tmp_path / "set", [{"id": name, "status": "ok"} for name in "ab"])
    done = dmae(tmp_path, "show", "data=set", "out=out", "frames=1", "width=160")
    assert done.returncode == 0, done.stderr
    assert all((tmp_path / "out" / name / "sheet.png").is_file() for name in "ab")


def test_both_commands_draw_the_same(tmp_path: Path):
    save_clip(occluded_clip(), tmp_path / "walk")
    done = synth(tmp_path, "show", "data=walk", "out=one", "frames=1", "width=200")
    assert done.returncode == 0, done.stderr
    assert "only the floor of the room is drawn: clip 'shown' has no scene in its provenance" in done.stdout
    assert dmae(tmp_path, "show", "data=walk", "out=other", "frames=1", "width=200").returncode == 0
    images = [cv2.imread(str(tmp_path / out / "sheet.png")) for out in ("one", "other")]
    np.testing.assert_array_equal(*images)


def test_rerun_that_is_not_installed_is_refused_before_any_work(tmp_path: Path, monkeypatch):
    find_spec = util.find_spec
    monkeypatch.setattr("dmae.viewing.show.util.find_spec", lambda name: None if name == "rerun" else find_spec(name))
    with pytest.raises(ValueError, match=r"rerun-sdk is not installed; pip install 'dmae-synth\[viz\]' adds it"):
        verbs.show(captured_clip(), tmp_path / "out", verbs.ShowConfig(rerun=True))
    assert not (tmp_path / "out").exists()


def test_real_shelf_without_images_shows_its_detections(data_folder: Path, tmp_path: Path):
    source = ("data=shelf", f"data.path={data_folder / 'shelf'}", "data.frames=[0,10]")
    done = dmae(tmp_path, "show", *source, "out=out", "frames=1", "width=200")
    assert done.returncode == 0, done.stderr
    assert "clip shelf: no images, no poses" in done.stdout
    sheet = cv2.imread(str(tmp_path / "out/sheet.png"))
    assert sheet.shape[1] == 5 * 206 + 6
    assert near(sheet[60:, :, ::-1], DETECTED).sum() > 100


def test_the_viewer_s_recording_holds_people_and_cameras(tmp_path: Path):
    pytest.importorskip("rerun")
    files = verbs.show(with_images(captured_clip(), tmp_path), tmp_path, verbs.ShowConfig(rerun=True, frames=1))
    data = files[-1].read_bytes()
    assert data.startswith(b"RRF")
    for entity in (b"P2", b"camera_c1"):
        assert entity in data


def test_the_viewer_takes_the_names_of_cameras_as_they_are(tmp_path: Path, capfd):
    """A path with a space, a dot or a bracket is one that Rerun corrects, with a warning for each frame and layer."""
    pytest.importorskip("rerun")
    clip = captured_clip()
    names = ("cam 1", "left[a]", "b.c", "d/e")[: len(clip.rig)]
    clip = replace(clip, rig=replace(clip.rig, names=names), true_rig=None)
    verbs.show(clip, tmp_path, verbs.ShowConfig(rerun=True, frames=1))
    assert "WARN" not in capfd.readouterr().err


class _Recorder:
    """Stands in for a `rerun.RecordingStream`: notes what is logged."""

    def __init__(self, *arguments, **named):
        self.logged = []
        _Recorder.last = self

    def __enter__(self):
        return self

    def __exit__(self, *failure):
        pass

    def save(self, path):
        Path(path).touch()

    def set_time(self, timeline, *, sequence=None, duration=None):
        self.time = sequence if duration is None else self.time

    def log(self, path, what, *, static=False):
        path = path if isinstance(path, str) else "/".join(path)
        self.logged.append((path, what, "static" if static else self.time))


@pytest.fixture
def logged(tmp_path: Path, monkeypatch):
    """Write a recording without the viewer's package, which is optional; what was logged, by entity and frame."""
    rerun = types.ModuleType("rerun")
    rerun.RecordingStream = _Recorder
    rerun.ViewCoordinates = types.SimpleNamespace(RIGHT_HAND_Z_UP="up", RDF="rdf")
    for name in ("Transform3D", "Pinhole", "Points3D", "LineStrips3D", "Points2D", "EncodedImage"):
        setattr(rerun, name, lambda *a, _name=name, **k: types.SimpleNamespace(kind=_name, first=a, **k))
    monkeypatch.setitem(sys.modules, "rerun", rerun)
    monkeypatch.delitem(sys.modules, "dmae.viewing.rerun", raising=False)
    from dmae.viewing.rerun import write_recording

    monkeypatch.delitem(sys.modules, "dmae.viewing.rerun")

    def write(clip: Clip, **options) -> dict:
        write_recording(clip, tmp_path / "a.rrd", layers_of(clip, **options))
        assert (tmp_path / "a.rrd").is_file()
        return {(path, when): what for path, what, when in _Recorder.last.logged}

    return write


def test_true_joints_are_logged_with_their_occluders(tmp_path: Path, logged):
    clip = with_images(occluded_clip(), tmp_path)
    found = logged(clip)
    np.testing.assert_allclose(found["world/camera_c1", "static"].translation, clip.rig.centers[1])
    np.testing.assert_allclose(found["world/camera_c1", "static"].mat3x3 @ (0, 0, 1), (1, 0, 0), atol=1e-12)
    assert found["world/camera_c1/image", "static"].resolution == [640, 480]
    np.testing.assert_allclose(found["world/truth/P2/joints", 0].first[0], clip.truth.xyz[0, 1, :25])
    assert len(found["world/truth/P2/joints", 2].first[0]) == 0
    assert len(found["world/truth/P1/bones", 2].first[0]) == 24
    marks = found["world/camera_c0/image/truth", 1]
    assert marks.first[0].shape == (50, 2)
    assert marks.labels[27] == "P2 r_shoulder, behind shelf"
    assert marks.colors[27] == COLOURS[OBJECT]
    assert found["world/camera_c0/image", 1].contents[:2] == b"\xff\xd8"


def test_poses_and_detections_are_logged_as_layers(logged):
    clip = captured_clip()
    completed = clip.poses.source[0, 0] == Source.COMPLETED
    found = logged(clip)
    assert found["world/P1/completed", 0].colors == [RED]
    np.testing.assert_allclose(found["world/P1/completed", 0].first[0], clip.poses.xyz[0, 0, completed])
    assert found["world/P2/measured", 2].colors == [person_colour(1)]
    assert len(found["world/camera_c1/image/measured", 0].first[0]) == 2 * (~completed).sum()
    assert found["world/camera_c1/image/detections", 0].first[0].shape == (50, 2)
    assert not any("truth" in path for path, _ in found)
    without = logged(clip, completed=False, detections=False, truth=True)
    assert not any("completed" in path or "detections" in path for path, _ in without)
    assert ("world/camera_c0/image/truth", 0) in without
