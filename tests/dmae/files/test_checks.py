"""A name that comes from a file becomes a path in one place, and stays in its folder."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dmae.data.images import Images
from dmae.data.store import clip_folders, save_clip
from dmae.files.checks import child
from dmae.files.structured import read_json
from dmae.formats.writing import write_poses, write_recording
from tests.support.clips import full_clip

BAD = [
    "", ".", "..", "...", "../x", "../../x", "/abs/x", "a/b", "a\\b", "..\\x", "C:", "C:\\x", "x\0y", "x\ny",
    "x\x1b[2J", "x\u202egpj", "\ud800", "con", "NUL", "com1.txt", "lpt9", " x", "x ", "x.", "x" * 300, "é" * 200, "a:b",
    "a*b", 'a"b',
    "a|b", "a<b", "a?b",
]  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_names_that_lead_elsewhere_are_refused(name):
    with pytest.raises(ValueError, match=r"camera .*cannot be the name of a file"):
        child(Path("out"), name, "camera")


@pytest.mark.parametrize("name", [None, 3, b"x"])
def test_names_that_are_no_texts_are_refused(name):
    with pytest.raises(ValueError, match="it is no text"):
        child(Path("out"), name, "camera")


@pytest.mark.parametrize(
    "name", ["0", "cam 1", "Camera_02", "00_16", "Kamera-Süd", "左", ".hidden", "a..b", "x.mp4", "contour"]
)
def test_other_names_are_taken(name):
    assert child(Path("out"), name, "camera") == Path("out") / name


@given(st.text())
def test_no_name_leaves_its_folder(name):
    try:
        path = child(Path("/out"), name, "camera")
    except ValueError:
        return
    assert path.parent == Path("/out") and path.name == name
    assert path.resolve().parent == Path("/out").resolve()


def with_cameras(clip, *names):
    """Return the clip with other names of its first cameras."""
    names = (*names, *clip.rig.names[len(names) :])
    return replace(clip, rig=replace(clip.rig, names=names), true_rig=None, images=None)


def tree(folder):
    return sorted(path.relative_to(folder) for path in folder.rglob("*"))


@pytest.mark.parametrize("format", ["openpose", "easymocap"])
@pytest.mark.parametrize("name", ["ABSOLUTE", "..", "../../x", "../x"])
def test_cameras_stay_in_the_folder_of_a_recording(tmp_path, format, name):
    clip = with_cameras(full_clip(), name.replace("ABSOLUTE", str(tmp_path / "abs")))
    (tmp_path / "in/here").mkdir(parents=True)
    with pytest.raises(ValueError, match="camera "):
        write_recording(clip, tmp_path / "in/here/out", format)
    written = [path for path in tree(tmp_path) if (tmp_path / path).is_file()]
    assert written == []


def test_cameras_stay_in_the_folder_of_exported_poses(tmp_path):
    for name in (str(tmp_path / "abs"), "..", "../../x"):
        with pytest.raises(ValueError, match="camera "):
            write_poses(with_cameras(full_clip(), name), tmp_path / "in/out", "openpose")
    assert [path for path in tree(tmp_path) if (tmp_path / path).is_file()] == []


def test_the_clip_s_id_stays_in_the_folder_of_an_export(tmp_path):
    clip = replace(full_clip(), id="x/../../../harm")
    with pytest.raises(ValueError, match="cannot be the name of a file"):
        write_poses(clip, tmp_path / "in/out", "panoptic", skeleton="panoptic19")
    assert [path for path in tree(tmp_path) if (tmp_path / path).is_file()] == []


@pytest.mark.parametrize("name", ['".."', '"../../x"', '"/etc"', "3", "null", '""'])
def test_clips_of_a_manifest_lie_in_its_folder(tmp_path, name):
    save_clip(full_clip(), tmp_path / "set/000000")
    (tmp_path / "set/manifest.jsonl").write_text(f'{{"id": {name}, "status": "ok"}}\n')
    with pytest.raises(ValueError, match=r"manifest\.jsonl, line 1.*clip .*cannot be the name of a file"):
        clip_folders(tmp_path / "set")


def test_images_of_a_camera_lie_in_the_folder_of_the_clip(tmp_path):
    for kind in ("rgb", "depth"):
        images = Images(tmp_path / "images", ("../../secret",), (0,), (kind,))
        with pytest.raises(ValueError, match="cannot be the name of a file"):
            next(images.read(kind, "../../secret"))


def test_a_byte_order_mark_is_no_text(tmp_path):
    (tmp_path / "a.json").write_text('{"fps": 25}', encoding="utf-8-sig")
    assert read_json(tmp_path / "a.json") == {"fps": 25}
