"""Labels that are added to existing clips: the rest does not change, and exports contain the labels."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from dmae.data.store import load_clip
from synth.datasets.config import GenerateConfig
from synth.datasets.exporters.export import export
from synth.datasets.exporters.layouts import KEYS
from synth.datasets.generate import generate
from synth.datasets.physical_labels import label, make_labels
from synth.datasets.verify import verify
from synth.labels.physical_labels import FILE, physical_labels
from synth.labels.surfaces import NAMES
from synth.rendering.config import ImageQuality
from synth.rigs.config import RigConfig, RingConfig
from synth.scene.config import SceneConfig
from tests.support.damages import contents

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore:no OpenGL")]


def config(out: Path, **changes) -> GenerateConfig:
    return GenerateConfig(
        out=str(out), seed=3, clips=2, scene=SceneConfig(persons=[2, 2], seconds=0.2, **changes.pop("scene", {})),
        rig=RigConfig(ring=RingConfig(views=2, focal=90, size=[96, 72])), quality=ImageQuality.draft, **changes,
    )  # fmt: skip


@pytest.fixture(scope="module")
def bare(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("bare") / "data"
    generate(config(out, images=["rgb"]))
    return out


@pytest.fixture
def data(bare, tmp_path) -> Path:
    return Path(shutil.copytree(bare, tmp_path / "data"))


def test_labels_are_added_in_place_once_and_the_set_stays_sound(data):
    before = contents(data, FILE, "checksums.json")
    assert label(data, ["forces"]) == 2
    assert physical_labels(data / "000000").kinds == ("forces",)
    assert contents(data, FILE, "checksums.json") == before
    assert verify(data).problems == []
    # Others are added to them.
    kept = physical_labels(data / "000000").forces
    assert label(data / "000000", ["surface", "forces"]) == 1
    found = physical_labels(data / "000000")
    assert found.kinds == ("forces", "surface")
    np.testing.assert_array_equal(found.forces.residual, kept.residual)
    assert verify(data).problems == []
    assert label(data, ["forces"]) == 0
    # The data set is continued as if it had no labels.
    lines = generate(config(data, images=["rgb"]))
    assert {line["status"] for line in lines} == {"ok"}
    assert (data / "000000" / FILE).is_file()
    assert verify(data).problems == []


def test_the_same_clip_has_the_same_labels(data):
    label(data, workers=2)
    there = (data / "000001" / FILE).read_bytes()
    (data / "000001" / FILE).unlink()
    assert label(data) == 1
    assert (data / "000001" / FILE).read_bytes() == there


def test_labels_that_are_damaged_are_made_again(data):
    label(data, ["contacts"])
    (data / "000000" / FILE).write_bytes(b"nothing")
    assert any(problem.clip == "000000" for problem in verify(data).problems)
    assert label(data, ["contacts"]) == 1
    assert verify(data).problems == []


def test_damaged_clips_and_clips_without_states_are_refused(data, tmp_path):
    (data / "000001/state.safetensors").unlink()
    with pytest.raises(FileNotFoundError, match="state of bodies"):
        label(data)
    assert not (data / "000000" / FILE).exists()
    (data / "000000/clip.json").write_text((data / "000000/clip.json").read_text() + " ")
    with pytest.raises(ValueError, match="make the clip again"):
        label(data / "000000")


def test_frames_too_far_apart_are_refused(tmp_path):
    generate(config(tmp_path / "slow", scene={"fps": 5.0}))
    with pytest.raises(ValueError, match="12 frames per second or more, found 5"):
        make_labels(tmp_path / "slow/000000", ["forces"])
    assert make_labels(tmp_path / "slow/000000", ["surface"]).kinds == ("surface",)


def test_exports_have_the_labels(data, tmp_path):
    label(data)
    clip, labels = load_clip(data / "000000"), physical_labels(data / "000000")
    for format in ("coco", "npz", "panoptic", "huggingface"):
        export(data, tmp_path / format, format)
    assert json.loads((tmp_path / "coco/export.json").read_text())["surface_points"] == list(NAMES)
    coco = json.loads((tmp_path / "coco/annotations/person_keypoints_train.json").read_text())
    images = {image["id"]: image for image in coco["images"]}
    for entry in coco["annotations"]:
        image = images[entry["image_id"]]
        if image["clip"] != "000000":
            continue
        frame, view, person = image["frame"], clip.rig.names.index(image["camera"]), entry["track_id"]
        assert set(KEYS) <= set(entry)
        np.testing.assert_allclose(entry["residual"], labels.forces.residual[frame, person], atol=0.006)
        codes = labels.surface.visibility[frame, view, person]
        assert entry["surface_visibility"] == codes.tolist()
        points = np.reshape(entry["surface_keypoints"], (-1, 3))
        np.testing.assert_array_equal(points[:, 2] == 2, codes == 0)
        xy = clip.rig[view : view + 1].project(labels.surface.xyz[frame, person][None])[0][0, 0]
        np.testing.assert_allclose(points[codes == 0, :2], xy[codes == 0], atol=0.01)
        # Forces on feet add up to the ground reaction.
        feet = [each for each in entry["contacts"] if each["source"] == "solved" and each["part"].endswith("foot")]
        total = np.sum([each["force"] for each in feet], axis=0) if feet else np.zeros(3)
        np.testing.assert_allclose(total, np.sum(entry["ground_reaction"], axis=0), atol=0.2)
    arrays = np.load(tmp_path / "npz/train/000000.npz")
    np.testing.assert_array_equal(arrays["surface.hidden_by"], labels.surface.hidden_by)
    assert arrays["contacts.names"].tolist() == list(labels.contacts.names)
    same = np.load(tmp_path / "panoptic/train/000000/physics.npz")
    np.testing.assert_array_equal(same["forces.ground_reaction"], labels.forces.ground_reaction)
    line = json.loads((tmp_path / "huggingface/train/metadata.jsonl").read_text().splitlines()[0])
    assert set(KEYS) <= set(line["persons"])
