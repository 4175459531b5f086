"""Shards as the library `webdataset` reads them."""

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.skeleton import COCO17
from dmae.data.store import load_clip
from dmae.formats.labelled_images import decode_mask
from synth.datasets.exporters import layouts as module
from synth.datasets.exporters.selection import PictureFormat
from tests.support.other_process import printed_lines

READ = """
import json, sys
import numpy as np
import webdataset
for number, sample in enumerate(webdataset.WebDataset(sys.argv[2:], shardshuffle=False).decode("rgb8")):
    picture = next(sample[suffix] for suffix in ("png", "jpg") if suffix in sample)
    np.save(f"{sys.argv[1]}/{number}.npy", picture)
    print(json.dumps({"key": sample["__key__"], "label": sample["json"]}))
"""


def read(shards, folder):
    """Each sample's key, label and picture."""
    folder.mkdir()
    lines = printed_lines(READ, folder, folder, *sorted(shards))
    return [line | {"picture": np.load(folder / f"{number}.npy")} for number, line in enumerate(lines)]


def test_samples_hold_picture_camera_and_persons(exported, data, tmp_path):
    out = exported("webdataset", pictures=PictureFormat.png)
    samples = read(out.glob("train-*.tar"), tmp_path / "train")
    assert len(samples) == 12 and len(read(out.glob("validation-*.tar"), tmp_path / "validation")) == 6
    for sample in samples:
        label = sample["label"]
        clip = load_clip(data / label["clip"])
        camera, frame = label["camera"], label["frame"] - 5
        assert sample["key"] == f"{label['clip']}/{camera['name']}/{label['frame']:06d}"
        np.testing.assert_array_equal(sample["picture"], list(clip.images.read("rgb", camera["name"]))[frame])
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


def test_a_new_shard_begins_when_one_is_full(exported, monkeypatch, tmp_path):
    monkeypatch.setattr(module, "SHARD_BYTES", 1000)
    out = exported("webdataset")
    assert sorted(path.name for path in out.glob("*.tar")) == [
        "train-000000.tar", "train-000001.tar", "validation-000000.tar",
    ]  # fmt: skip
    assert len(read(out.glob("train-*.tar"), tmp_path / "read")) == 12
