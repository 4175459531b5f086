"""What is published with an export: Croissant metadata that its readers load, a datasheet, a citation, checksums."""

import hashlib
import json
import shutil
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from dmae.datasets import FrameDataset
from synth.datasets.config import AboutConfig
from synth.datasets.exporters.croissant import croissant as metadata
from synth.datasets.exporters.croissant import hub_metadata
from synth.datasets.exporters.export import export
from synth.datasets.statistics import scene_kinds, terms
from tests.support.data_sets import image_set

# Its readers use functions that rdflib and pandas are about to remove.
pytestmark = [
    pytest.mark.filterwarnings(f"ignore::{each}") for each in ("DeprecationWarning", "FutureWarning", "UserWarning")
]

ABOUT = AboutConfig("hidden-people", "A. Publisher", "https://example.org/licence", "https://example.org", "2026-11-24")
RAI = (
    "dataCollection", "dataCollectionType", "dataLimitations", "dataBiases", "dataUseCases", "dataSocialImpact",
    "personalSensitiveInformation", "dataAnnotationProtocol", "hasSyntheticData",
)  # fmt: skip
"""Fields that venues ask for."""


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    return image_set(tmp_path_factory.mktemp("data") / "set", clips=2)


@pytest.fixture(scope="module")
def rows(data, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("rows") / "export"
    export(data, out, "huggingface", about=ABOUT)
    return out


@pytest.fixture(scope="module")
def croissant():
    return pytest.importorskip("mlcroissant")


def test_a_date_that_croissant_does_not_take_is_refused():
    for wrong in ("yesterday", "1.12.2026", "2026-13-01", ""):
        with pytest.raises(ValueError, match=f"about.date={wrong}: expected year-month-day"):
            AboutConfig(date=wrong)


def test_a_licence_is_an_address():
    with pytest.raises(ValueError, match=r"about.licence=CC-BY-4.0: expected its address, as https://creative"):
        AboutConfig(licence="CC-BY-4.0")


def test_published_pages_name_the_file_of_a_room_not_its_folder():
    kinds = scene_kinds({"arena": "/home/ann/lab.xml", "motion": {"kind": "procedural"}})
    assert kinds[0] == "arena=lab.xml" and "**Rooms from files** (lab.xml: 1 clip)" in terms(Counter(kinds))


def test_metadata_follows_from_the_provenance_of_the_clips(rows):
    found = json.loads((rows / "croissant.json").read_text())
    assert (found["name"], found["license"], found["datePublished"]) == (ABOUT.name, ABOUT.licence, ABOUT.date)
    assert all(found[f"rai:{key}"] for key in RAI)
    assert "rooms: studio" in found["rai:dataCollection"] and "recorded takes" in found["rai:dataCollection"]
    assert "terms of those takes apply" in found["description"]
    sheet = (rows / "DATASHEET.md").read_text()
    assert all(f"## {part}\n" in sheet for part in ("Motivation", "Composition", "Collection", "Uses", "Maintenance"))
    assert ABOUT.licence in sheet and found["rai:dataBiases"] in sheet
    assert found["citeAs"].startswith("@misc{hidden-people, title={hidden-people}, ")
    summary = json.loads((rows / "export.json").read_text())
    about = replace(ABOUT, name="Hidden people, 2nd ed.")
    cited = metadata(rows, summary, dict.fromkeys(("dataCollection", "rights"), ""), about)["citeAs"]
    assert cited.startswith("@misc{Hidden-people-2nd-ed., title={Hidden people, 2nd ed.}, ")
    citation = yaml.safe_load((rows / "CITATION.cff").read_text())
    assert (citation["title"], citation["authors"]) == (ABOUT.name, [{"name": ABOUT.creator}])


def test_fields_of_persons_are_known_if_the_first_clip_shows_nobody(rows, tmp_path):
    out = Path(shutil.copytree(rows, tmp_path / "export"))
    summary = json.loads((out / "export.json").read_text())
    (split,) = summary["splits"]

    def fields() -> list[str]:
        made = metadata(out, summary, dict.fromkeys(("dataCollection", "rights"), ""), ABOUT)
        return [field["name"] for field in made["recordSet"][0]["field"]]

    before, lines = fields(), (out / split / "metadata.jsonl").read_text()
    nobody = json.dumps(json.loads(lines.splitlines()[0]) | {"persons": {}})
    (out / split / "metadata.jsonl").write_text(f"{nobody}\n{lines}")
    assert fields() == before and "keypoints" in before


@pytest.mark.parametrize(
    ("licence", "stated"),
    [
        (None, {"license": "unknown"}),
        ("https://creativecommons.org/licenses/by-nc-sa/4.0/", {"license": "cc-by-nc-sa-4.0"}),
        ("https://creativecommons.org/publicdomain/zero/1.0/", {"license": "cc0-1.0"}),
        ("https://www.apache.org/licenses/LICENSE-2.0.txt", {"license": "apache-2.0"}),
        (ABOUT.licence, {"license": "other", "license_name": "see-link", "license_link": ABOUT.licence}),
    ],
)
def test_the_hub_reads_name_licence_tasks_and_size(licence, stated, rows):
    hub = pytest.importorskip("huggingface_hub")
    text = hub_metadata(rows, json.loads((rows / "export.json").read_text()), replace(ABOUT, licence=licence))
    found = hub.DatasetCard(text).data.to_dict()
    assert {key: value for key, value in found.items() if key.startswith("license")} == stated
    assert (found["pretty_name"], found["size_categories"]) == (ABOUT.name, ["n<1K"])
    assert found["task_categories"] == ["keypoint-detection", "object-detection", "image-segmentation"]


def test_the_readme_of_rows_begins_with_what_the_hub_reads(rows):
    hub = pytest.importorskip("huggingface_hub")
    card = hub.DatasetCard.load(rows / "README.md")
    assert card.data.license_link == ABOUT.licence and card.text.strip().startswith(f"# {ABOUT.name}\n")


def test_checksums_are_of_all_files(rows):
    sums = dict(reversed(line.split("  ", 1)) for line in (rows / "SHA256SUMS").read_text().splitlines())
    files = {path.relative_to(rows).as_posix(): path for path in rows.rglob("*") if path.is_file()}
    assert sums.keys() == files.keys() - {"SHA256SUMS", "croissant.json"}
    assert all(hashlib.sha256(files[name].read_bytes()).hexdigest() == sums[name] for name in sums)


def test_three_loaders_read_the_same_first_record(rows, data, croissant, tmp_path):
    datasets = pytest.importorskip("datasets")
    record = next(iter(croissant.Dataset(str(rows / "croissant.json")).records("train")))
    row = datasets.load_dataset(str(rows), cache_dir=str(tmp_path / "cache"))["train"][0]
    image, target = FrameDataset(data, skeleton="coco17")[0]
    assert record["train/file_name"].decode() == "000000/cam0/000005.jpg"
    assert (record["train/clip"].decode(), record["train/frame"]) == (row["clip"], row["frame"])
    assert record["train/camera"].decode() == row["camera"]["name"]
    for joints in (record["train/keypoints"], row["persons"]["keypoints"]):
        np.testing.assert_allclose(np.reshape(joints, (-1, 17, 3)), target["keypoints"], atol=0.01)
    assert image.shape[1:] == row["image"].size[::-1]


@pytest.mark.parametrize("format", ["coco", "webdataset", "npz", "panoptic"])
def test_metadata_of_every_layout_is_valid(data, croissant, format, tmp_path):
    export(data, tmp_path / "out", format, about=ABOUT)
    loaded = croissant.Dataset(str(tmp_path / "out/croissant.json"))
    assert not loaded.metadata.issues.errors
    files = [each["contentUrl"] for each in json.loads((tmp_path / "out/croissant.json").read_text())["distribution"]]
    assert all((tmp_path / "out" / name).is_file() for name in files)
    if format == "coco":
        record = next(iter(loaded.records("train")))
        content = json.loads((tmp_path / "out/annotations/person_keypoints_train.json").read_text())
        assert record["train/track_id"] == content["annotations"][0]["track_id"]
        np.testing.assert_allclose(record["train/keypoints"], content["annotations"][0]["keypoints"])
