"""From a seed to what another library reads: a generated data set, split, exported, and compared with its images."""

import numpy as np
import pytest
from pycocotools import mask as coco_mask
from pycocotools.coco import COCO

from dmae.data.store import load_clip
from dmae.datasets import FrameDataset
from tests.support.commands import synth

pytestmark = pytest.mark.slow

SMALL = ("rig=ring", "rig.ring.views=2", "rig.ring.size=[96,72]", "rig.ring.focal=90", "quality=draft", "images=all")


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
    pictures = persons = 0
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
            pictures, persons = pictures + 1, persons + len(annotations)
    assert pictures == 2 * 2 * 5 and persons > 20
    frames = FrameDataset(tmp_path / "set")
    assert len(frames) == pictures
    assert sum(len(frames[index][1]["boxes"]) for index in range(len(frames))) == persons
