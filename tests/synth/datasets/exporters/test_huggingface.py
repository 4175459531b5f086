"""Image folders as the library `datasets` reads them."""

import numpy as np

from dmae.data.store import load_clip
from dmae.formats.labelled_images import decode_mask
from tests.support.other_process import printed_lines

READ = """
import json, sys
from datasets import load_dataset
found = load_dataset(sys.argv[1])
for split in found:
    for row in found[split]:
        picture = row.pop("image")
        print(json.dumps({"split": split, "size": picture.size, **row}))
"""


def test_rows_hold_picture_camera_and_persons(exported, data, tmp_path):
    """Read in a process of its own: the library keeps what it read in a folder that the environment names."""
    out = exported("huggingface")
    offline = {"HF_HOME": str(tmp_path / "kept"), "HF_HUB_OFFLINE": "1", "HF_DATASETS_OFFLINE": "1"}
    rows = printed_lines(READ, tmp_path, out, **offline)
    assert [row["split"] for row in rows] == ["train"] * 12 + ["validation"] * 6
    people = 0
    for row in rows:
        assert row["objects"] == ["box"] and row["fps"] == 25
        clip = load_clip(data / row["clip"])
        frame, persons = row["frame"] - 5, row["persons"]
        assert row["size"] == row["camera"]["size"] == [240, 150]
        ids = list(clip.images.read("ids", row["camera"]["name"]))[frame]
        assert [set(persons["track_id"])] == [set(np.unique(ids[(ids > 0) & (ids < 256)]) - 1)]
        for number, person in enumerate(persons["track_id"]):
            mask = decode_mask(persons["segmentation"][number])
            np.testing.assert_array_equal(mask, ids == 1 + person)
            assert persons["area"][number] == mask.sum()
            assert len(persons["keypoints"][number]) == 3 * 17
            people += 1
    assert people == 33
