"""What is shown of a clip: a sheet, a video and a recording, in the colours of what hides each joint."""

import sys
import types
from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.images import Images, write_video
from dmae.data.labels import OcclusionLabels, Visibility
from dmae.data.skeleton import BODY25, get_skeleton
from dmae.data.store import save_clip
from synth.commands import show as command
from synth.commands.show import ShowCommand
from synth.datasets.clip import GenerateConfig, generate_clip
from synth.scene.spec import SceneConfig
from synth.viewing.overlay import COLOURS, Overlay
from synth.viewing.show import draw_rooms, write_overlay_video, write_sheet
from tests.support.standing_people import looking_along_x

VISIBLE, SELF, PERSON, OBJECT, OUTSIDE, BEHIND, ABSENT = Visibility


def a_clip(frames: int = 3, views: int = 2) -> Clip:
    """Return a clip of two people side by side. In the last frame the second is absent.

    Every joint of the second (at the right, y = -1) is hidden, each third by another kind of occluder.
    """
    rig = looking_along_x(*[(-4, 0.2 * view, 1.0) for view in range(views)])
    rng = np.random.default_rng(0)
    skeleton = get_skeleton("body25+shelf14")
    xyz = np.stack([rng.uniform(-0.4, 0.4, (39, 3)) + (0, y, 1) for y in (1, -1)])
    xyz = np.repeat(xyz[None], frames, 0)
    xyz[-1, 1] = np.nan
    visibility = np.full((frames, views, 2, 39), VISIBLE, np.uint8)
    visibility[:, :, 1] = np.array([SELF, PERSON, OBJECT])[np.arange(39) % 3]
    by = np.full(visibility.shape, -1)
    by[:, :, 1] = np.array([1, 0, 1])[np.arange(39) % 3]
    visibility[-1, :, 1], by[-1, :, 1] = ABSENT, -1
    nothing = np.zeros((frames, views, 0, 25))
    return Clip(
        "shown", 25.0, rig, Detections2D(BODY25, np.stack([nothing] * 2, -1), nothing),
        truth=Poses3D(skeleton, xyz), occlusion=OcclusionLabels(visibility, by, objects=("floor", "shelf")),
    )  # fmt: skip


def with_images(clip: Clip, folder: Path) -> Clip:
    """The clip with images that are plain green."""
    for name in clip.rig.names:
        write_video(
            folder / "rgb" / f"{name}.mp4", np.full((len(clip), 480, 640, 3), (20, 120, 20), np.uint8), clip.fps
        )
    return replace(clip, images=Images(folder, clip.rig.names, tuple(range(len(clip))), ("rgb",)))


def near(image: np.ndarray, colour) -> np.ndarray:
    """(H, W) True for the pixels of a colour."""
    return (np.abs(image.astype(int) - colour) < 30).all(-1)


def test_joints_are_drawn_at_their_places_in_the_colour_of_their_occlusion():
    clip = a_clip()
    overlay = Overlay(clip, 640)
    tile = overlay.tile(0, 0, np.zeros((480, 640, 3), np.uint8))
    xy, _ = clip.rig.project(clip.truth.xyz)
    right = 0
    for person in range(2):
        for joint in range(25):
            column, row = np.round(xy[0, 0, person, joint]).astype(int)
            right += near(tile, COLOURS[Visibility(clip.occlusion.visibility[0, 0, person, joint])])[row, column]
    # Marks may cover each other.
    assert right >= 42
    assert not near(tile[:480, :320], COLOURS[OBJECT]).any()
    # Nobody's joints of the second skeleton are drawn.
    assert overlay.joints == list(range(25))
    assert len(overlay.bones) == 24


def test_occluders_are_named():
    overlay = Overlay(a_clip(), 640)
    assert [overlay.occluder_name(0, 0, 1, joint) for joint in range(3)] == ["itself", "person 0", "shelf"]
    assert overlay.occluder_name(0, 0, 0, 0) == ""
    summary = overlay._summary(0, 0, 1, overlay.clip.occlusion.visibility[0, 0, 1, :25])
    assert sorted(summary) == sorted(
        [("0 seen", COLOURS[VISIBLE]), ("9 behind itself", COLOURS[SELF]), ("8 behind person 0", COLOURS[PERSON]),
         ("8 behind shelf", COLOURS[OBJECT])]
    )  # fmt: skip
    assert overlay._summary(2, 0, 1, overlay.clip.occlusion.visibility[2, 0, 1, :25])[0][0] == "absent"


def test_the_sheet_has_a_row_per_frame_and_a_column_per_view(tmp_path):
    clip = a_clip()
    write_sheet(clip, tmp_path / "a.png", rows=2, width=320)
    write_sheet(with_images(clip, tmp_path / "images"), tmp_path / "b.png", rows=2, width=320)
    plain, green = (cv2.imread(str(tmp_path / name))[..., ::-1] for name in ("a.png", "b.png"))
    assert plain.shape == green.shape
    assert plain.shape[1] == 2 * (320 + 6) + 6
    assert 2 * 240 < plain.shape[0] < 2 * 300 + 100
    assert near(green, (20, 120, 20)).mean() > 0.5
    assert not near(plain, (20, 120, 20)).any()
    # More rows than frames show every frame once.
    write_sheet(clip, tmp_path / "c.png", rows=50, width=320)
    top = Overlay(clip, 320).header(plain.shape[1]).shape[0]
    assert cv2.imread(str(tmp_path / "c.png")).shape[0] - top == (plain.shape[0] - top) * 3 // 2


def test_many_views_take_several_rows(tmp_path):
    clip = a_clip(frames=2, views=7)
    write_sheet(clip, tmp_path / "a.png", rows=1, width=200)
    write_sheet(clip.select(views=slice(0, 6)), tmp_path / "b.png", rows=1, width=200)
    seven, six = (cv2.imread(str(tmp_path / name)) for name in ("a.png", "b.png"))
    assert seven.shape[1] == six.shape[1] == 6 * 206 + 6
    header = Overlay(clip, 200).header(6 * 206 + 6).shape[0]
    assert seven.shape[0] - header == 2 * (six.shape[0] - header)


def test_the_legend_is_complete_at_any_width():
    overlay = Overlay(a_clip(), 160)
    wide, narrow = overlay.header(1600), overlay.header(332)
    assert narrow.shape[0] > wide.shape[0]
    for colour in COLOURS.values():
        assert near(narrow, colour).sum() == pytest.approx(near(wide, colour).sum(), abs=20)


def test_the_video_shows_every_frame(tmp_path):
    write_overlay_video(with_images(a_clip(views=3), tmp_path), tmp_path / "a.mp4", width=401)
    with av.open(str(tmp_path / "a.mp4")) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert len(frames) == 3
    assert all(side % 2 == 0 for side in frames[0].shape[:2])
    # In the last frame the second person is not there.
    pink = [near(frame[84:], COLOURS[PERSON]).sum() for frame in frames]
    assert pink[0] > 50 > pink[2]


def test_the_command_writes_what_it_can_and_reports_the_rest(tmp_path, capsys, monkeypatch):
    save_clip(a_clip(), tmp_path / "clip")
    monkeypatch.setattr("synth.commands.show.util.find_spec", lambda name: None)
    config = ShowCommand(clip=str(tmp_path / "clip"), frames=1, width=200, views=["c1"])
    command.run(config, tmp_path / "out")
    said = capsys.readouterr().out
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["clip.mp4", "sheet.png"]
    assert "only the floor of the room is drawn: clip 'shown' has no scene in its provenance" in said
    assert "rerun-sdk is not installed (pip install 'dmae-synth[viz]' adds it)" in said
    with pytest.raises(ValueError, match=r"no camera \['c7'\]; it has \['c0', 'c1'\]"):
        command.run(replace(config, views=["c7"]), tmp_path / "out")
    for wrong in ({"frames": 0}, {"width": 20}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            ShowCommand(**wrong)


def test_a_clip_without_occluders_is_refused(tmp_path):
    with pytest.raises(ValueError, match="no visibility to show"):
        write_sheet(replace(a_clip(), occlusion=None), tmp_path / "a.png")
    assert not (tmp_path / "a.png").exists()


def test_the_viewer_s_recording_holds_people_and_cameras(tmp_path):
    pytest.importorskip("rerun")
    from synth.viewing.rerun import write_recording

    write_recording(with_images(a_clip(), tmp_path), tmp_path / "a.rrd")
    data = (tmp_path / "a.rrd").read_bytes()
    assert data.startswith(b"RRF")
    for entity in (b"person_1", b"camera_c1"):
        assert entity in data


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
        self.path = path

    def set_time(self, timeline, *, sequence=None, duration=None):
        self.time = sequence if duration is None else self.time

    def log(self, path, what, *, static=False):
        self.logged.append((path, what, "static" if static else self.time))


def test_the_room_is_drawn_from_the_clip_s_provenance():
    """A clip says where it was made, and so its room can be drawn without images."""
    config = GenerateConfig(seed=1, clips=1, scene=SceneConfig(arena="office", persons=[1, 1], seconds=0.1))
    clip = generate_clip(config, 0)
    rooms = draw_rooms(clip)
    assert [room.shape[:2] for room in rooms] == [tuple(size[::-1]) for size in clip.rig.size.tolist()]
    assert all(room.std() > 5 for room in rooms)
    tile, empty = (Overlay(clip, 480, shown).tile(0, 0, None) for shown in (rooms, None))
    assert (tile != empty).any(-1).mean() > 0.5


def test_joints_are_logged_for_the_viewer(tmp_path, monkeypatch):
    """The same without the viewer's package, which is optional."""
    rerun = types.ModuleType("rerun")
    rerun.RecordingStream = _Recorder
    rerun.ViewCoordinates = types.SimpleNamespace(RIGHT_HAND_Z_UP="up", RDF="rdf")
    for name in ("Transform3D", "Pinhole", "Points3D", "LineStrips3D", "Points2D", "EncodedImage"):
        setattr(rerun, name, lambda *a, _name=name, **k: types.SimpleNamespace(kind=_name, first=a, **k))
    monkeypatch.setitem(sys.modules, "rerun", rerun)
    monkeypatch.delitem(sys.modules, "synth.viewing.rerun", raising=False)
    from synth.viewing.rerun import write_recording

    clip = with_images(a_clip(), tmp_path)
    write_recording(clip, tmp_path / "a.rrd")
    monkeypatch.delitem(sys.modules, "synth.viewing.rerun")
    logged = {(path, when): what for path, what, when in _Recorder.last.logged}
    assert _Recorder.last.path == str(tmp_path / "a.rrd")
    np.testing.assert_allclose(logged["world/camera_c1", "static"].translation, clip.rig.centers[1])
    np.testing.assert_allclose(logged["world/camera_c1", "static"].mat3x3 @ (0, 0, 1), (1, 0, 0), atol=1e-12)
    assert logged["world/camera_c1/image", "static"].resolution == [640, 480]
    np.testing.assert_allclose(logged["world/person_1/joints", 0].first[0], clip.truth.xyz[0, 1, :25])
    assert len(logged["world/person_1/joints", 2].first[0]) == 0
    assert len(logged["world/person_0/bones", 2].first[0]) == 24
    marks = logged["world/camera_c0/image/joints", 1]
    assert marks.first[0].shape == (50, 2)
    assert marks.labels[27] == "person 1 r_shoulder, behind shelf"
    assert marks.colors[27] == COLOURS[OBJECT]
    assert logged["world/camera_c0/image", 1].contents[:2] == b"\xff\xd8"
