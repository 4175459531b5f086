"""Tables for which models are trained: here for a few steps, on small clips."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.cli import DMAE, compose
from dmae.completion.config import SMALL, PaperSize
from dmae.data.clip import Clip
from dmae.data.store import save_clip, write_manifest
from dmae.evaluation.config import TableConfig, TableSize
from dmae.evaluation.paper_tables import learned, recording
from dmae.evaluation.paper_tables.learned import make_table
from dmae.formats.reading import DataConfig
from tests.support.clips import full_clip
from tests.support.scored_clips import seen

pytestmark = pytest.mark.slow
COUNT = 4


@pytest.fixture(scope="module")
def clips(tmp_path_factory):
    """A data set of walkers, truth on two skeletons."""
    folder = tmp_path_factory.mktemp("data") / "walkers"
    for number in range(COUNT):
        clip = seen(frames=50, name=f"{number}")
        save_clip(walked(clip, number), folder / clip.id)
    write_manifest(folder, [{"id": str(number), "status": "ok"} for number in range(COUNT)])
    return folder


def walked(clip: Clip, number: int) -> Clip:
    """The same walkers, detected with other errors."""
    error = np.random.default_rng(number).normal(0, 2, clip.detections.xy.shape)
    return replace(clip, detections=replace(clip.detections, xy=clip.detections.xy + error))


def table(out, number: int, path, **changes) -> dict:
    config = TableConfig(number=number, data=DataConfig(path=str(path)), size=TableSize.small, **changes)
    return make_table(config, out)


def rows_of(made: dict) -> dict[str, dict]:
    return {row["name"]: row for row in made["rows"] if row["origin"] != "published"}


def test_error_and_recall_by_number_of_cameras(clips, tmp_path):
    made = table(tmp_path, 6, clips)
    assert rows_of(made).keys() == {"measured", "linear", "dmae"}
    cells = {key: cell["value"] for key, cell in rows_of(made)["dmae"]["cells"].items()}
    counts = sorted(int(key.rpartition("_")[2]) for key in cells if key.startswith("mpjpe"))
    assert counts == list(range(2, counts[-1] + 1))
    assert 0 < cells[f"mpjpe_{counts[-1]}"] < cells["mpjpe_2"] < 200
    assert cells[f"recall_{counts[-1]}"] > 95
    published = next(row for row in made["rows"] if row["origin"] == "published")
    assert published["cells"]["mpjpe_3"]["value"] == 47.3


def test_interactions_have_a_row_for_transfer_and_one_without(clips, tmp_path, monkeypatch):
    monkeypatch.setitem(learned._TRANSFER_STEPS, TableSize.small, (2, 2))
    made = table(tmp_path, 3, clips)
    rows = rows_of(made)
    assert list(rows) == ["measured", "linear", "dmae", learned.TUNED_HERE, learned.ALONE]
    assert made["recording"] == "2 simulated clips"
    for name, row in rows.items():
        assert row["origin"] == "measured here"
        assert all(row["cells"][key]["value"] is not None for key in ("pcp", "recall", "mpjpe", "hidden_recall"))
        assert (row["differences"] == {}) == (name == "dmae")
    assert rows["measured"]["cells"]["hidden"]["value"] is None
    assert rows["measured"]["cells"]["hidden_recall"]["value"] == 0
    assert all(row["differences"] == {} for row in made["rows"] if row["origin"] == "published")
    trained = [folder.name for folder in (tmp_path / "models").iterdir()]
    assert sorted(trained) == ["table_3_alone", "table_3_tuned"]


def test_codes_have_recall_and_error_of_the_same_masked_joints(clips, tmp_path, monkeypatch):
    monkeypatch.setitem(learned._CODE_STEPS, TableSize.small, 2)
    rows = rows_of(table(tmp_path, 5, clips))
    assert list(rows) == [*learned.VARIANTS, learned.INTERPOLATED]
    for row in rows.values():
        assert 0 <= row["cells"]["recall"]["value"] <= 100
    assert all(rows[name]["cells"]["mpjpe"]["value"] > 1 for name in learned.VARIANTS)
    # Walkers glide: interpolation is right where two steps of training are not.
    assert rows[learned.INTERPOLATED]["cells"]["recall"]["value"] > 99
    assert rows[learned.BOTH]["cells"]["recall"]["value"] < 90


def test_the_paper_s_network_has_rows_before_and_after_tuning(clips, tmp_path, monkeypatch):
    monkeypatch.setattr(recording, "_FEW", (2, 1))
    tiny = replace(SMALL, schedule=replace(SMALL.schedule, batch=64))
    monkeypatch.setitem(recording.SIZES, PaperSize.small, tiny)
    save_clip(seen(frames=60), tmp_path / "clip")
    made = table(tmp_path, 1, tmp_path / "clip", extra_data=[str(clips)])
    rows = rows_of(made)
    assert list(rows)[-2:] == [recording.PRETRAINED, recording.TUNED]
    for name in (recording.PRETRAINED, recording.TUNED):
        assert rows[name]["cells"]["average"]["value"] is not None
        assert rows[name]["note"].startswith("small size: 64 channels and 2 layers in the encoder")
    # 15 frames are tuned on, 10 after them left out.
    assert made["frames"] == {"actor 1": 35, "actor 2": 35}
    without = rows_of(table(tmp_path / "without", 1, tmp_path / "clip"))
    assert without[recording.TUNED]["origin"] == "not measured"
    assert "give extra_data=[...]" in without[recording.TUNED]["note"]


def test_fusion_has_rows_before_and_after_tuning_and_the_better_of_two_says_so(clips, tmp_path, monkeypatch):
    monkeypatch.setitem(learned._FUSION_STEPS, TableSize.small, 2)
    monkeypatch.setattr(learned, "_TUNING_STEPS", 2)
    save_clip(seen(frames=60), tmp_path / "clip")
    made = table(tmp_path, 4, tmp_path / "clip", extra_data=[str(clips)])
    rows = rows_of(made)
    assert list(rows) == ["linear", "dmae", learned.FUSED, learned.FUSED_TUNED, learned.BETTER]
    for group in learned.GROUPS:
        assert rows[learned.FUSED_TUNED]["cells"][group]["value"] is not None
    better = rows[learned.BETTER]
    assert better["protocol"] == "hkbu, better of two by the truth"
    assert "no system can do so" in better["note"]
    for name in ("dmae", learned.FUSED_TUNED):
        assert better["cells"]["average"]["value"] >= rows[name]["cells"]["average"]["value"] - 0.5
    # 15 frames are tuned on, 10 after them left out.
    assert made["frames"] == {"actor 1": 35, "actor 2": 35}


def test_fusion_without_simulated_clips_is_not_measured(tmp_path):
    save_clip(seen(frames=60), tmp_path / "clip")
    rows = rows_of(table(tmp_path, 4, tmp_path / "clip"))
    for name in (learned.FUSED, learned.FUSED_TUNED, learned.BETTER):
        assert rows[name]["origin"] == "not measured"
        assert "give extra_data=[...]" in rows[name]["note"]
        assert {cell["value"] for cell in rows[name]["cells"].values()} == {None}


def test_a_set_of_one_clip_cannot_be_halved(tmp_path):
    save_clip(full_clip(frames=20), tmp_path / "clip")
    with pytest.raises(ValueError, match="1 clip; expected a data set of two clips or more"):
        table(tmp_path, 3, tmp_path / "clip")


def test_the_network_is_the_paper_s_but_for_its_size(clips):
    wanted = compose(DMAE.commands["train"], [f"data={clips}", "model=paper"])
    made = learned.training_plan(TableConfig(number=5))
    for name in ("frames", "fps", "dropout", "key_init", "residual", "align_heading"):
        assert getattr(made.model, name) == getattr(wanted.model, name), name
    assert made.examples == wanted.examples
    assert made.learning.loss == wanted.learning.loss
