"""The page of file formats agrees with the written files: a format changes only with its version and the page."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file

from dmae.data.clip import Poses3D, Source
from dmae.data.images import KINDS
from dmae.data.labels import JointError, Visibility
from dmae.data.skeleton import BODY25
from dmae.data.store import FORMAT, save_clip
from synth.datasets import splits, statistics
from synth.datasets.config import SplitBy
from synth.datasets.exporters import export
from synth.datasets.exporters.export import export as export_data_set
from synth.datasets.exporters.layouts import KEYS, PERSONS
from synth.datasets.splits import write_splits
from tests.support.clips import image_clip
from tests.support.data_sets import image_set

REFERENCE = Path(__file__).parents[2] / "docs/reference"
F, V, P, J, D = 12, 4, 2, 25, 2
SIZES = {"F": F, "V": V, "P": P, "J": J, "D": D}


def section(page: str, title: str) -> str:
    text = (REFERENCE / f"{page}.md").read_text()
    return re.split(r"^## ", text.split(f"\n## {title}\n", 1)[1], flags=re.MULTILINE)[0]


def rows(text: str) -> list[list[str]]:
    """The cells of the tables in a section, without heads."""
    lines = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| `")]
    return [[cell.strip(" |") for cell in line] for line in lines]


def names(cell: str) -> list[str]:
    return re.findall(r"`([^`]+)`", cell)


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    """A clip with everything that a clip can have."""
    folder = tmp_path_factory.mktemp("clip")
    clip = image_clip(folder / "images", F, V)
    xyz = clip.truth.xyz
    rays = np.ones((*xyz.shape[:3], 2, 3))
    poses = Poses3D(BODY25, xyz, rays=rays)
    save_clip(replace(clip, truth=poses, poses=poses, true_rig=clip.rig), folder)
    return folder


def documented_arrays() -> dict[str, tuple[str, str]]:
    """Shape and type by the name of an array."""
    found = {}
    arrays = section("files", "A clip").split("arrays.safetensors`**")[1].split("**`state.safetensors`**")[0]
    for first, shape, kind, *_ in rows(arrays):
        for name in names(first):
            if name.startswith("*."):
                found |= {f"{part}{name[1:]}": (shape, kind) for part in ("truth", "poses")}
            elif not name.endswith(".*"):
                found[name] = (shape, kind)
    found |= {f"true_{name}": value for name, value in found.items() if name.startswith("rig.")}
    return found


def test_arrays_of_a_clip_are_those_of_the_page(written):
    arrays, documented = load_file(written / "arrays.safetensors"), documented_arrays()
    assert set(arrays) == set(documented)
    for name, (shape, kind) in documented.items():
        sizes = shape.strip("()").rstrip(",").split(", ")
        assert str(arrays[name].dtype) == kind, name
        assert len(sizes) == arrays[name].ndim, name
        for size, found in zip(sizes, arrays[name].shape, strict=True):
            low, _, high = size.partition("..")
            assert int(low) <= found <= int(high) if high else found == SIZES.get(size) or str(found) == size, name


def test_the_json_of_a_clip_is_that_of_the_page(written):
    meta = json.loads((written / "clip.json").read_text())
    table = rows(section("files", "A clip").split("arrays.safetensors`**")[0])
    assert set(meta) == {name for first, _ in table for name in names(first)}
    assert meta["format"] == FORMAT == int(dict(table)["`format`"])
    for name in meta["images"]:
        assert name in next(says for first, says in table if "`images`" in first)


@pytest.mark.parametrize(
    ("array", "codes"), [("visibility", Visibility), ("detected_error", JointError), ("*.source", Source)]
)
def test_codes_are_those_of_the_page(array, codes):
    says = next(row[3] for row in rows(section("files", "A clip")) if row[0] == f"`{array}`")
    numbers = [int(number) for number in re.findall(r"(?:^|, )(\d) ", says)]
    assert numbers == [int(code) for code in codes]
    for code in codes:
        part = re.search(rf"(?:^|, ){int(code)} ([a-z ]+)", says)[1]
        words = code.name.lower().replace("hidden_by_", "").split("_")
        assert any(word in part for word in words), (code, part)


def test_kinds_of_images_are_those_of_the_page():
    assert [names(row[0])[0] for row in rows(section("files", "Images"))] == list(KINDS)


def test_versions_are_those_of_the_pages():
    for number, text in (
        (splits.FORMAT, section("files", "`splits.json`")),
        (statistics.FORMAT, section("files", "`statistics/`")),
    ):
        assert f"`format` {number}" in text
    assert f"version {export.FORMAT} of every layout" in (REFERENCE / "exports.md").read_text()


def test_keys_of_splits_and_statistics_are_those_of_the_page(tmp_path):
    write_splits(tmp_path / "splits.json", {"train": ["0"]}, SplitBy.rig, 0)
    assert set(json.loads((tmp_path / "splits.json").read_text())) <= set(names(section("files", "`splits.json`")))
    data = image_set(tmp_path / "set", clips=1)
    statistics.stats(data, tmp_path / "card")
    content = json.loads((tmp_path / "card/statistics.json").read_text())
    documented = set(names(section("files", "`statistics/`")))
    assert set(content) <= documented
    assert set(content["histograms"]["distance"]) <= documented


def test_keys_of_exports_are_those_of_the_page(tmp_path):
    data = image_set(tmp_path / "set", clips=1, depth=True)
    export_data_set(data, tmp_path / "coco")
    content = json.loads((tmp_path / "coco/annotations/person_keypoints_train.json").read_text())
    tables = rows(section("exports", "coco"))
    documented = {name for first, _ in tables for name in names(first)}
    amodal = {"amodal_segmentation", "amodal_bbox"}
    assert set(content["images"][0]) | set(content["annotations"][0]) | amodal == documented
    physical = {name for first, _ in rows(section("exports", "What `synth label` found")) for name in names(first)}
    assert physical == set(KEYS)
    assert set(PERSONS) <= documented | physical | {"xyz"}
    summary = json.loads((tmp_path / "coco/export.json").read_text())
    page = (REFERENCE / "exports.md").read_text()
    counted = set(summary["splits"]["train"])
    assert all(f"`{name}`" in page for name in {*summary, *counted})
