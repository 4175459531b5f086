"""Exports are whole or absent, the same with any number of processes, and bad input is refused plainly."""

import json
import os
import shutil
import signal
import time
from dataclasses import replace
from pathlib import Path

import pytest
from pycocotools.coco import COCO

from dmae.data.skeleton import get_skeleton
from dmae.data.store import clip_folders, load_clip, save_clip, write_manifest
from dmae.formats.calibrations import read_calibration
from dmae.formats.labelled_images import file_part
from synth.commands import export as export_command
from synth.commands.config import ExportDataCommand
from synth.datasets.exporters import exporter
from synth.datasets.exporters.export import export
from tests.support.clips import full_clip, walkers
from tests.support.commands import start_command, synth
from tests.support.damages import contents
from tests.support.data_sets import image_set

_HANGS = 300
"""Seconds after which a command hangs; on a busy machine imports alone can take a minute."""


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    return image_set(tmp_path_factory.mktemp("data") / "set", clips=2)


@pytest.mark.parametrize(
    "format", sorted(set(exporter) - {"g1", "lerobot", "glb", "usd"})
)  # of bodies: test_robots, test_scenes
def test_an_export_is_the_same_from_any_number_of_processes(data, tmp_path, format):
    splits = tmp_path / "splits.json"
    splits.write_text(json.dumps({"format": 1, "splits": {"train": ["000001"], "validation": ["000000"]}}))
    one, two = (tmp_path / name for name in ("one", "two"))
    export(data, one, format, splits=splits)
    export(data, two, format, splits=splits, workers=2)
    assert contents(one) == contents(two)
    assert not [name for name in contents(one) if "/." in f"/{name}"]
    summary = json.loads((one / "export.json").read_text())
    # Layouts of images count who is seen in each; others count the two people of the clip.
    persons = 11 if exporter[format].images else 2
    assert summary["splits"]["train"]["names"] == ["000001"] and summary["splits"]["train"]["persons"] == persons
    hidden, masks = (" 1 |" * exporter[format].images, " 11 |" * (exporter[format].images and format != "yolo"))
    assert f"| {persons} |{hidden}{masks}\n" in (one / "README.md").read_text()


def test_the_command_writes_every_other_frame_of_a_clip(data, tmp_path, capsys):
    done = synth(tmp_path, "export", f"data={data / '000001'}", "every=2", "skeleton=body25", "out=out")
    assert done.returncode == 0, done.stderr
    assert "out: train: 1 clip, 4 images, 7 persons, 7 masks" in done.stdout
    content = json.loads((tmp_path / "out/annotations/person_keypoints_train.json").read_text())
    assert {image["frame"] for image in content["images"]} == {5, 7}
    save_clip(replace(load_clip(data / "000001"), images=None), tmp_path / "plain")
    export_command.run(ExportDataCommand(str(tmp_path / "plain"), format="npz"), tmp_path / "arrays")
    assert capsys.readouterr().out == f"{tmp_path / 'arrays'}: train: 1 clip, 2 persons\n"
    assert len(content["categories"][0]["keypoints"]) == 25


def test_without_images_of_ids_boxes_are_of_joints_and_the_card_says_so(data, tmp_path, capsys):
    clip = load_clip(data / "000000")
    save_clip(replace(clip, images=replace(clip.images, kinds=("rgb",))), tmp_path / "set/000000")
    export(tmp_path / "set/000000", tmp_path / "out")
    coco = COCO(tmp_path / "out/annotations/person_keypoints_train.json")
    assert {(each["bbox_of"], str(each["segmentation"])) for each in coco.anns.values()} == {("joints", "[]")}
    card = (tmp_path / "out/README.md").read_text()
    assert f"0 of {len(coco.anns)} boxes are of visible pixels" in card and "| masks |" not in card


@pytest.mark.parametrize(
    ("format", "written", "absent"),
    [
        ("npz", ["clips | images | persons |\n", "no images"], ["masks", "Boxes", "v = 2"]),
        ("panoptic", ["clips | images | persons |\n"], ["no images", "masks", "Boxes", "v = 2"]),
        ("coco", ["persons | persons hidden | masks |", "Boxes are of the visible", "v = 2"], ["no images"]),
    ],
)
def test_the_card_tells_of_what_the_layout_holds(format, written, absent, data, tmp_path):
    summary = export(data / "000001", tmp_path / "out", format)
    card = (tmp_path / "out/README.md").read_text()
    assert all(each in card for each in written) and not any(each in card for each in absent)
    sheet = (tmp_path / "out/DATASHEET.md").read_text()
    images = summary["splits"]["train"].get("images", 0)
    assert f"1 clip, {images} images" in sheet and bool(images) == bool(list((tmp_path / "out").rglob("*.jpg")))


def test_a_calibration_in_error_is_not_what_images_are_of(data, tmp_path):
    clip = load_clip(data / "000000")
    wrong = replace(clip.rig, K=clip.rig.K + [[0, 0, 9], [0, 0, 9], [0, 0, 0]])
    save_clip(replace(clip, true_rig=clip.rig, rig=wrong), tmp_path / "wrong/000000")
    written = []
    for number, folder in enumerate((data / "000000", tmp_path / "wrong/000000")):
        export(folder, tmp_path / f"out{number}")
        written.append(contents(tmp_path / f"out{number}"))
    assert written[0] == written[1]


def test_names_of_clips_and_cameras_stay_in_the_folder(data, tmp_path):
    clip = load_clip(data / "000000")
    names = ("../up", "/root.d")
    renamed = replace(clip, id="../../up", rig=replace(clip.rig, names=names), images=None)
    save_clip(renamed, tmp_path / "set/000000")
    export(tmp_path / "set/000000", tmp_path / "deep/out", "panoptic")
    assert [file_part(name) for name in (*names, "", "..")] == ["%2E%2E%2Fup", "%2Froot%2Ed", "%", "%2E%2E"]
    assert {path.name for path in tmp_path.iterdir()} == {"set", "deep"}


def test_nodes_of_panoptic_are_different(data, tmp_path):
    clip = load_clip(data / "000000")
    save_clip(replace(clip, rig=replace(clip.rig, names=("left", "00_00")), images=None), tmp_path / "set/000000")
    export(tmp_path / "set/000000", tmp_path / "out", "panoptic")
    assert read_calibration(tmp_path / "out/train/000000").names == ("00_01", "00_00")


def test_poses_of_panoptic_are_of_the_frames_of_its_images(data, tmp_path):
    export(data, tmp_path / "out", "panoptic", every=2)
    for clip in (tmp_path / "out").glob("*/*"):
        poses, images = (sorted({each.stem[-8:] for each in clip.rglob(name)}) for name in ("body3D*", "*.jpg"))
        assert poses == images == ["00000005", "00000007"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["data=none"], "data=none: no such file"),
        (["data=set", "format=cocoo"], "did you mean coco"),
        (["data=set", "out=file"], "expected a folder, found a file"),
        (["data=set", "out=file/in"], "file is a file, not a folder"),
        (["data=set", "out=foreign"], "foreign: expected no such folder yet, or an empty one"),
        (["data=unpictured"], "needs images, and the clip has images of no kind; synth render data=... images=rgb"),
        (["data=untrue"], "the clip has no truth"),
        (["data=mixed"], "expected clips with truth of one skeleton, found body25 (clip 0) and shelf14 (clip 1)"),
        (["data=set", "skeleton=body26"], "skeleton=body26"),
        (["data=set", "format=panoptic", "skeleton=body25"], "format=panoptic is always of panoptic19"),
        (["data=set", "every=0"], "every: expected 1 or more"),
        (["data=set", "workers=0"], "workers: expected a number of processes"),
        (["data=set", "splits=nowhere.json"], "nowhere.json: no such file"),
        (["data=set", "splits=other.json"], "split train has clip '000009', which the data set does not have"),
        (["data=set", "splits=twice.json"], "clip 000000 is in train and again in test"),
        (["data=set", "splits=escape.json"], "expected lists of clips by name of split, found '../up'"),
        (["data=damaged"], "does not match the checksum"),
    ],
)  # fmt: skip
def test_bad_input_is_refused_and_leaves_nothing_behind(data, tmp_path, arguments, said):
    (tmp_path / "set").symlink_to(data)
    (tmp_path / "file").write_text("mine")
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign/letter.txt").write_text("mine")
    for name, splits in {
        "other": {"train": ["000009"]}, "twice": {"train": ["000000"], "test": ["000000"]},
        "escape": {"../up": ["000000"]},
    }.items():  # fmt: skip
        (tmp_path / f"{name}.json").write_text(json.dumps({"format": 1, "splits": splits}))
    clip = full_clip(3, 2)
    save_clip(clip, tmp_path / "unpictured")
    save_clip(replace(clip, truth=None, occlusion=None), tmp_path / "untrue")
    for number, skeleton in enumerate(("body25", "shelf14")):
        truth = clip.truth if skeleton == "body25" else walkers(3, 2, get_skeleton(skeleton))
        images = load_clip(data / "000000").images
        save_clip(replace(clip, truth=truth, occlusion=None, images=images), tmp_path / f"mixed/{number}")
    write_manifest(tmp_path / "mixed", [{"id": str(number), "status": "ok"} for number in (0, 1)])
    shutil.copytree(data / "000000", tmp_path / "damaged")
    (tmp_path / "damaged/arrays.safetensors").write_bytes(b"")
    before = contents(tmp_path)
    given = arguments if any(each.startswith("out=") for each in arguments) else [*arguments, "out=out"]
    done = synth(tmp_path, "export", *given)
    assert done.returncode == 1
    assert said in done.stderr and len(done.stderr.splitlines()) == 1
    assert contents(tmp_path) == before


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_an_interrupted_export_is_absent(data, tmp_path, workers):
    clips = [f"{number:06d}" for number in range(400)]
    (tmp_path / "set").mkdir()
    for name in clips:
        (tmp_path / "set" / name).symlink_to(clip_folders(data)[0])
    write_manifest(tmp_path / "set", [{"id": name, "status": "ok"} for name in clips])
    process = start_command(tmp_path, "synth", "export", "data=set", f"workers={workers}", "out=out")
    end = time.monotonic() + _HANGS
    while not list(tmp_path.glob(".out.partial/images/train/*/*/*.jpg")):
        assert process.poll() is None and time.monotonic() < end, process.communicate()
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)
    _, error = process.communicate(timeout=_HANGS)
    assert process.returncode == 130, error
    assert error.splitlines() == ["synth export: interrupted; nothing was written to out; run it again"]
    assert {path.name for path in tmp_path.iterdir()} == {"set"}
