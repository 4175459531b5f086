"""YOLO pose, read by the rules that Ultralytics documents; its package is too heavy to test with."""

import cv2
import numpy as np
import pytest
import yaml

from dmae.data.skeleton import COCO17
from dmae.data.store import load_clip
from dmae.formats.labelled_images import joint_labels
from synth.datasets.exporters.export import export


def test_labels_are_fractions_of_the_pictures(exported, data):
    out = exported("yolo")
    content = yaml.safe_load((out / "data.yaml").read_text())
    assert content["kpt_shape"] == [17, 3] and content["names"] == {0: "person"}
    assert [COCO17.joints[joint][:2] for joint in content["flip_idx"]][1:3] == ["r_", "l_"]
    people = 0
    for split in ("train", "val"):
        pictures = sorted((out / content[split]).rglob("*.jpg"))
        assert len(pictures) == {"train": 12, "val": 6}[split]
        for picture in pictures:
            height, width = cv2.imread(str(picture)).shape[:2]
            # As Ultralytics finds them: the last /images/ becomes /labels/.
            labels = "/labels/".join(str(picture).rsplit("/images/", 1)).removesuffix("jpg") + "txt"
            lines = np.loadtxt(labels, ndmin=2)
            assert lines.shape[1] == 5 + 3 * 17
            assert (lines >= 0).all() and (lines[:, :5] <= 1).all() and (lines[:, 0] == 0).all()
            clip_name, camera, number = picture.parts[-3:]
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
