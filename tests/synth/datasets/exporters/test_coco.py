"""COCO's own library reads the files, and finds in the pictures what the images of ids show."""

import json

import cv2
import numpy as np
import pytest
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from dmae.data.skeleton import COCO17
from dmae.data.store import load_clip
from dmae.formats.labelled_images import joint_labels
from synth.datasets.exporters.selection import PictureFormat

SHOWN = {"train": 22, "validation": 11}
"""Persons of whom anything shows: twelve a clip but the one behind the box."""


@pytest.mark.parametrize("split", SHOWN)
def test_masks_boxes_areas_and_files_are_what_the_images_show(exported, data, split, capsys):
    out = exported("coco", pictures=PictureFormat.png)
    coco = COCO(out / f"annotations/person_keypoints_{split}.json")
    assert len(coco.anns) == SHOWN[split]
    for image in coco.loadImgs(coco.getImgIds()):
        clip = load_clip(data / image["clip"])
        frame, view = image["frame"] - 5, clip.rig.names.index(image["camera"])
        ids = list(clip.images.read("ids", image["camera"]))[frame]
        colour = list(clip.images.read("rgb", image["camera"]))[frame]
        np.testing.assert_array_equal(cv2.imread(str(out / "images" / split / image["file_name"]))[..., ::-1], colour)
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
