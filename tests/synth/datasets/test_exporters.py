"""Each layout, read by the library that it is for, shows what the images of ids show."""

import json
import tarfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from pycocotools import mask as coco_mask
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from dmae.data.cameras import CameraRig
from dmae.data.conversion import convert
from dmae.data.skeleton import COCO17, PANOPTIC19
from dmae.data.store import load_clip, save_clip, write_manifest
from dmae.datasets import FrameDataset
from dmae.formats import panoptic
from dmae.formats.calibrations import read_calibration
from dmae.formats.labelled_images import joint_labels
from synth.datasets.config import SplitBy
from synth.datasets.exporters import layouts
from synth.datasets.exporters.export import export
from synth.datasets.splits import write_splits
from tests.support.commands import synth
from tests.support.data_sets import image_set
from tests.support.masks import decode_mask
from tests.support.other_process import printed_lines


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    return image_set(tmp_path_factory.mktemp("data") / "set", depth=True)


@pytest.fixture(scope="module")
def splits(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("data") / "splits.json"
    write_splits(path, {"train": ["000000", "000001"], "validation": ["000002"]}, SplitBy.person, 0)
    return path


@pytest.fixture
def exported(data, splits, tmp_path) -> Callable[..., Path]:
    def make(format: str, **options) -> Path:
        export(data, tmp_path / format, format, splits=splits, **options)
        return tmp_path / format

    return make


SHOWN = {"train": 22, "validation": 11}
"""Persons of whom anything shows: twelve a clip but the one behind the box."""


def check_millimetres(depth: np.ndarray, true: np.ndarray) -> None:
    """Depth of 16 bit, mm, is that of a clip, m: 0 where there is no surface."""
    assert depth.dtype == np.uint16 and np.isnan(true).any()
    np.testing.assert_array_equal(np.where(depth > 0, depth / np.float32(1000), np.nan), true)


@pytest.mark.parametrize("split", SHOWN)
def test_masks_boxes_areas_and_files_are_what_the_images_show(exported, data, split, capsys):
    out = exported("coco", images="png")
    coco = COCO(out / f"annotations/person_keypoints_{split}.json")
    assert len(coco.anns) == SHOWN[split]
    for image in coco.loadImgs(coco.getImgIds()):
        clip = load_clip(data / image["clip"])
        frame, view = image["frame"] - 5, clip.rig.names.index(image["camera"])
        ids = list(clip.images.read("ids", image["camera"]))[frame]
        colour = list(clip.images.read("rgb", image["camera"]))[frame]
        np.testing.assert_array_equal(cv2.imread(str(out / "images" / split / image["file_name"]))[..., ::-1], colour)
        depth = cv2.imread(str(out / "images" / split / image["depth_file_name"]), cv2.IMREAD_UNCHANGED)
        check_millimetres(depth, clip.images.at("depth", image["camera"], frame))
        labels = joint_labels(clip, clip.truth, COCO17)
        annotations = coco.loadAnns(coco.getAnnIds(image["id"]))
        assert {each["track_id"] for each in annotations} == set(np.unique(ids[(ids > 0) & (ids < 256)]) - 1)
        for annotation in annotations:
            person = annotation["track_id"]
            mask = ids == 1 + person
            np.testing.assert_array_equal(coco.annToMask(annotation), mask)
            rows, columns = np.nonzero(mask)
            size = [columns.max() - columns.min() + 1, rows.max() - rows.min() + 1]
            assert annotation["bbox"] == [columns.min(), rows.min(), *size]
            assert annotation["area"] == annotation["visible_pixels"] == mask.sum()
            joints = np.reshape(annotation["keypoints"], (17, 3))
            np.testing.assert_array_equal(joints[:, 2], labels.flags[frame, view, person])
            np.testing.assert_allclose(
                joints[joints[:, 2] > 0, :2], labels.xy[frame, view, person][joints[:, 2] > 0], atol=6e-4
            )
            np.testing.assert_array_equal(annotation["visibility"], labels.cause[frame, view, person])
            assert coco.dataset["info"]["clips"][image["clip"]]["objects"] == ["box"]
    assert (out / "SHA256SUMS").read_text().count(".depth.png") == 18


@pytest.mark.parametrize("kind", ["keypoints", "segm", "bbox"])
def test_the_truth_scores_full_marks(exported, kind, capsys):
    """The evaluation of COCO finds every person where the annotations are handed in as results."""
    coco = COCO(exported("coco") / "annotations/person_keypoints_train.json")
    found = coco.loadRes(
        [dict(annotation, score=1.0) for annotation in json.loads(json.dumps(coco.dataset["annotations"]))]
    )
    scores = COCOeval(coco, found, kind)
    scores.evaluate()
    scores.accumulate()
    scores.summarize()
    assert scores.stats[0] == pytest.approx(1)


# YOLO pose, read by the rules that Ultralytics documents; its package is too heavy to test with.


def test_labels_are_fractions_of_the_images(exported, data):
    out = exported("yolo")
    content = yaml.safe_load((out / "data.yaml").read_text())
    assert content["kpt_shape"] == [17, 3] and content["names"] == {0: "person"}
    assert [COCO17.joints[joint][:2] for joint in content["flip_idx"]][1:3] == ["r_", "l_"]
    people = 0
    for split in ("train", "val"):
        images = sorted((out / content[split]).rglob("*.jpg"))
        assert len(images) == {"train": 12, "val": 6}[split]
        for image in images:
            height, width = cv2.imread(str(image)).shape[:2]
            # As Ultralytics finds them: the last /images/ becomes /labels/.
            labels = "/labels/".join(str(image).rsplit("/images/", 1)).removesuffix("jpg") + "txt"
            lines = np.loadtxt(labels, ndmin=2)
            assert lines.shape[1] == 5 + 3 * 17
            assert (lines >= 0).all() and (lines[:, :5] <= 1).all() and (lines[:, 0] == 0).all()
            clip_name, camera, number = image.parts[-3:]
            clip = load_clip(data / clip_name)
            frame, view = int(number[:-4]) - 5, clip.rig.names.index(camera)
            ids = list(clip.images.read("ids", camera))[frame]
            found = joint_labels(clip, clip.truth, COCO17)
            for person, line in zip(np.unique(ids[(ids > 0) & (ids < 256)]) - 1, lines, strict=True):
                rows, columns = np.nonzero(ids == 1 + person)
                x, y, box_width, box_height = line[1:5] * (width, height, width, height)
                edges = [x - box_width / 2, y - box_height / 2, x + box_width / 2, y + box_height / 2]
                expected = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
                np.testing.assert_allclose(edges, expected, atol=1e-2)
                joints = line[5:].reshape(17, 3)
                seen = found.flags[frame, view, person] > 0
                np.testing.assert_array_equal(joints[:, 2], found.flags[frame, view, person])
                pixels = joints[seen, :2] * (width, height) - 0.5
                np.testing.assert_allclose(pixels, found.xy[frame, view, person][seen], atol=1e-2)
                people += 1
    assert people == 33


def test_readers_insist_on_a_split_for_validation(data, tmp_path):
    with pytest.raises(ValueError, match=r"format=yolo: .* there is no validation; make them by synth split"):
        export(data, tmp_path / "out", "yolo")
    assert not (tmp_path / "out").exists()


# Shards as the library `webdataset` reads them.

READ_SHARDS = """
import json, sys
import numpy as np
import webdataset
for number, sample in enumerate(webdataset.WebDataset(sys.argv[2:], shardshuffle=False).decode("rgb8")):
    image = next(sample[suffix] for suffix in ("png", "jpg") if suffix in sample)
    np.savez(f"{sys.argv[1]}/{number}", image=image, depth=sample["depth.npz"]["depth"])
    print(json.dumps({"shard": sample["__url__"], "key": sample["__key__"], "label": sample["json"]}))
"""


def test_samples_hold_image_camera_and_persons(exported, data, tmp_path):
    out = exported("webdataset", images="png")
    samples = printed_lines(READ_SHARDS, tmp_path, tmp_path, *sorted(out.glob("*.tar")))
    assert [Path(sample["shard"]).name.partition("-")[0] for sample in samples] == ["train"] * 12 + ["validation"] * 6
    assert ".depth.png" not in (out / "SHA256SUMS").read_text()
    for number, sample in enumerate(samples):
        label = sample["label"]
        clip = load_clip(data / label["clip"])
        camera, frame = label["camera"], label["frame"] - 5
        assert sample["key"] == f"{label['clip']}/{camera['name']}/{label['frame']:06d}"
        with np.load(tmp_path / f"{number}.npz") as read:
            np.testing.assert_array_equal(read["image"], list(clip.images.read("rgb", camera["name"]))[frame])
            np.testing.assert_array_equal(read["depth"], clip.images.at("depth", camera["name"], frame))
        ids = list(clip.images.read("ids", camera["name"]))[frame]
        own = [[camera[name]] for name in ("K", "dist", "cam_from_world", "size", "fisheye")]
        rig = CameraRig([camera["name"]], *own)
        for person in label["persons"]:
            mask = decode_mask(person["segmentation"])
            np.testing.assert_array_equal(mask, ids == 1 + person["track_id"])
            xyz = np.array(person["xyz"])
            true = clip.truth.xyz[frame, person["track_id"]][clip.truth.skeleton.index(*COCO17.joints)]
            np.testing.assert_allclose(xyz, true, atol=1e-4)
            joints = np.reshape(person["keypoints"], (17, 3))
            labelled = joints[:, 2] > 0
            projected, _ = rig.project(xyz[None])
            np.testing.assert_allclose(projected[0, 0][labelled], joints[labelled, :2], atol=0.05)


def test_a_new_shard_begins_when_one_is_full(exported, monkeypatch):
    monkeypatch.setattr(layouts, "SHARD_BYTES", 1000)
    out = exported("webdataset")
    assert sorted(path.name for path in out.glob("*.tar")) == [
        "train-000000.tar", "train-000001.tar", "validation-000000.tar",
    ]  # fmt: skip
    held = []
    for shard in sorted(out.glob("train-*.tar")):
        with tarfile.open(shard) as archive:
            held.append([Path(name).suffix for name in archive.getnames()])
    assert all(suffixes.count(".jpg") == suffixes.count(".json") > 0 for suffixes in held)
    assert sum(suffixes.count(".json") for suffixes in held) == 12


# Image folders as the library `datasets` reads them.

READ_FOLDERS = """
import json, sys
import numpy as np
from datasets import load_dataset
found = load_dataset(sys.argv[1])
for split in found:
    for number, row in enumerate(found[split]):
        image = row.pop("image")
        np.save(f"{split}{number}.npy", np.array(row.pop("depth")))
        print(json.dumps({"split": split, "number": number, "size": image.size, **row}))
"""


def test_rows_hold_image_camera_and_persons(exported, data, tmp_path):
    """Read in a process of its own: the library keeps what it read in a folder that the environment names."""
    out = exported("huggingface")
    offline = {"HF_HOME": str(tmp_path / "kept"), "HF_HUB_OFFLINE": "1", "HF_DATASETS_OFFLINE": "1"}
    rows = printed_lines(READ_FOLDERS, tmp_path, out, **offline)
    assert [row["split"] for row in rows] == ["train"] * 12 + ["validation"] * 6
    people = 0
    for row in rows:
        assert row["objects"] == ["box"] and row["fps"] == 25
        clip = load_clip(data / row["clip"])
        frame, persons = row["frame"] - 5, row["persons"]
        assert row["size"] == row["camera"]["size"] == [240, 150]
        depth = np.load(tmp_path / f"{row['split']}{row['number']}.npy")
        check_millimetres(depth, clip.images.at("depth", row["camera"]["name"], frame))
        ids = list(clip.images.read("ids", row["camera"]["name"]))[frame]
        assert [set(persons["track_id"])] == [set(np.unique(ids[(ids > 0) & (ids < 256)]) - 1)]
        for number, person in enumerate(persons["track_id"]):
            mask = decode_mask(persons["segmentation"][number])
            np.testing.assert_array_equal(mask, ids == 1 + person)
            assert persons["area"][number] == mask.sum()
            assert len(persons["keypoints"][number]) == 3 * 17
            people += 1
    assert people == 33
    assert (out / "SHA256SUMS").read_text().count(".depth.png") == 18


# Sequences of CMU Panoptic, read back by the reader of such recordings.


def test_poses_cameras_and_images_are_those_of_the_clip(exported, data):
    out = exported("panoptic", workers=2)
    for split, name in (("train", "000000"), ("train", "000001"), ("validation", "000002")):
        clip, folder = load_clip(data / name), out / split / name
        found = panoptic.read_poses(folder)
        assert sorted(found.xyz) == [5, 6, 7]
        np.testing.assert_allclose(np.stack(list(found.xyz.values())), convert(clip.truth, PANOPTIC19).xyz, atol=1e-5)
        rig = read_calibration(folder)
        assert rig.names == ("00_00", "00_01")
        np.testing.assert_allclose(rig.projections, clip.rig.projections, atol=1e-6)
        for view, camera in enumerate(rig.names):
            for frame, colour in enumerate(clip.images.read("rgb", clip.rig.names[view])):
                image = cv2.imread(str(folder / "hdImgs" / camera / f"{camera}_{5 + frame:08d}.jpg"))
                assert np.abs(image[..., ::-1].astype(int) - colour).mean() < 3


def test_a_fisheye_is_refused_by_the_name_of_its_camera(data, tmp_path):
    clip = load_clip(data / "000000")
    fisheyes = replace(clip.rig, fisheye=np.ones(len(clip.rig), bool))
    save_clip(replace(clip, rig=fisheyes, images=None), tmp_path / "set/000000")
    write_manifest(tmp_path / "set", [{"id": "000000", "status": "ok"}])
    with pytest.raises(ValueError, match=f"camera '{clip.rig.names[0]}': .* cannot hold a fisheye lens"):
        export(tmp_path / "set", tmp_path / "out", "panoptic")


# From a seed to what another library reads: a generated data set, split, exported, and compared with its images.

SMALL = ("rig=ring", "rig.ring.views=2", "rig.ring.size=[96,72]", "rig.ring.focal=90", "quality=draft", "images=all")


@pytest.mark.slow
def test_a_generated_set_is_split_exported_and_read(tmp_path, capsys):
    commands = (
        (
            "generate",
            "out=set",
            "clips=2",
            "seed=3",
            "scene.seconds=0.2",
            "scene.persons=[2,3]",
            "scene=office",
            *SMALL,
        ),
        ("split", "data=set", "train=0.5", "validation=0.5", "test=0", "out=splits.json"),
        ("split", "data=set", "by=motion", "check=splits.json"),
        ("stats", "data=set"),
        ("export", "data=set", "splits=splits.json", "out=coco"),
    )
    for command in commands:
        done = synth(tmp_path, *command)
        assert done.returncode == 0, done.stderr
    assert "| clips by arena | office: 2 |" in (tmp_path / "set/statistics/README.md").read_text()
    images = persons = 0
    for split in ("train", "validation"):
        coco = COCO(tmp_path / f"coco/annotations/person_keypoints_{split}.json")
        for image in coco.loadImgs(coco.getImgIds()):
            clip = load_clip(tmp_path / "set" / image["clip"])
            ids = list(clip.images.read("ids", image["camera"]))[image["frame"]]
            annotations = coco.loadAnns(coco.getAnnIds(image["id"]))
            shown = {int(value) - 1 for value in np.unique(ids) if 0 < value < 256}
            assert {each["track_id"] for each in annotations} == shown
            for each in annotations:
                true = coco_mask.encode(np.asfortranarray(ids == 1 + each["track_id"], np.uint8))
                runs = coco_mask.frPyObjects(each["segmentation"], *each["segmentation"]["size"])
                assert coco_mask.iou([runs], [true], [0]) == 1.0
                assert each["bbox"] == coco_mask.toBbox(true).tolist()
                assert each["area"] == coco_mask.area(true)
            images, persons = images + 1, persons + len(annotations)
    assert images == 2 * 2 * 5 and persons > 20
    frames = FrameDataset(tmp_path / "set")
    assert len(frames) == images
    assert sum(len(frames[index][1]["boxes"]) for index in range(len(frames))) == persons
