"""Tables for which models are trained: here for a few steps, on small clips."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dmae.completion import training
from dmae.completion.config import DecoderConfig, EncoderConfig
from dmae.completion.paper import PAPER
from dmae.completion.training import train
from dmae.data.clip import Clip
from dmae.data.store import save_clip, write_manifest
from dmae.evaluation.config import TableConfig, TableSize
from dmae.evaluation.paper_tables import network, tables
from dmae.evaluation.paper_tables.layout import markdown, terminal_tables
from dmae.evaluation.paper_tables.tables import make_table
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


def test_error_and_recall_by_number_of_cameras(clips, tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "_MOST_SUBSETS", 2)
    made = table(tmp_path, 6, clips / "0")
    assert rows_of(made).keys() == {"measured", "linear", "dmae"}
    cells = {key: cell["value"] for key, cell in rows_of(made)["dmae"]["cells"].items()}
    counts = sorted(int(key.rpartition("_")[2]) for key in cells if key.startswith("mpjpe"))
    assert counts == list(range(2, counts[-1] + 1))
    assert 0 < cells[f"mpjpe_{counts[-1]}"] < cells["mpjpe_2"] < 200
    assert cells[f"recall_{counts[-1]}"] > 95
    published = next(row for row in made["rows"] if row["origin"] == "published")
    assert published["cells"]["mpjpe_3"]["value"] == 47.3


def test_angles_by_number_of_cameras(clips, tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "_MOST_SUBSETS", 1)
    monkeypatch.setitem(tables.METHODS, TableSize.small, ("dmae",))
    made = table(tmp_path, 6, clips / "0", angles=True)
    cells = rows_of(made)["dmae"]["cells"]
    assert all(0 < cells[f"angles_{count}"]["value"] < 20 for count in (2, 3, 4))
    with pytest.raises(ValueError, match="angles=true: table 2 has no errors of joints"):
        table(tmp_path, 2, clips, angles=True)


def test_interactions_have_a_row_for_transfer_and_one_without(clips, tmp_path, monkeypatch):
    monkeypatch.setitem(tables._TRANSFER_STEPS, TableSize.small, (2, 2))
    made = table(tmp_path, 3, clips, angles=True)
    rows = rows_of(made)
    assert list(rows) == ["measured", "linear", "dmae", tables.TUNED_HERE, tables.ALONE]
    assert made["recording"] == "2 simulated clips"
    for name, row in rows.items():
        assert row["origin"] == "measured here"
        assert all(row["cells"][key]["value"] is not None for key in ("pcp", "recall", "mpjpe", "hidden_recall"))
        assert (row["differences"] == {}) == (name == "dmae")
    assert all(0 < row["cells"]["angles"]["value"] < 20 for row in rows.values())
    assert "hips and knees, °" in markdown(made)
    assert rows["measured"]["cells"]["hidden"]["value"] is None
    assert rows["measured"]["cells"]["hidden_recall"]["value"] == 0
    assert all(row["differences"] == {} for row in made["rows"] if row["origin"] == "published")
    trained = [folder.name for folder in (tmp_path / "models").iterdir()]
    assert sorted(trained) == ["table_3_alone", "table_3_tuned"]


@pytest.fixture
def tiny(monkeypatch):
    """The paper's network small and trained for a few steps, and no shipped weights."""
    model = replace(
        PAPER.model, encoder=EncoderConfig(dim=16, depth=1, heads=1, head_dim=16, mlp=16), decoder=DecoderConfig(dim=8)
    )
    plan = replace(PAPER, model=model)
    monkeypatch.setattr(network, "PAPER", plan)
    monkeypatch.setitem(network.STEPS, TableSize.small, (2, 2, 2))
    return plan


@pytest.fixture
def pretrained(tiny, clips, tmp_path, monkeypatch):
    """Weights of it in place of those that are shipped."""
    plan = replace(tiny, learning=replace(tiny.learning, steps=2, epoch=2))
    folder = train(plan, [walked(seen(frames=50, name="0"), 0)], tmp_path / "paper")
    for module in (network, training):
        monkeypatch.setattr(module, "weights_folder", lambda name: folder if name == "paper" else Path(name))
    return folder


def test_codes_have_recall_and_error_of_the_same_masked_joints(clips, pretrained, tmp_path):
    made = table(tmp_path, 5, clips)
    rows = rows_of(made)
    assert "equally many steps, 2 of 16 windows" in made["footnotes"][0]
    assert list(rows) == [*network.VARIANTS, network.LONGER, network.WINDOW, network.WHOLE]
    for row in rows.values():
        assert all(0 <= row["cells"][f"{kind}recall"]["value"] <= 100 for kind in network.MASKS)
    assert all(rows[name]["cells"]["mpjpe"]["value"] > 1 for name in network.VARIANTS)
    # Walkers glide: straight lines are wrong only at their ends, which are fewer in the recording than in windows.
    error = {name: row["cells"]["mpjpe"]["value"] for name, row in rows.items()}
    assert 2 * error[network.WHOLE] < error[network.WINDOW] < error[network.BOTH]


def test_the_paper_s_network_has_rows_for_each_stage_on_all_frames(clips, pretrained, tmp_path):
    save_clip(seen(frames=80).select(views=[0, 1, 2]), tmp_path / "clip")
    made = table(tmp_path, 1, tmp_path / "clip", extra_data=[str(clips)])
    rows = rows_of(made)
    assert [name for name in rows if name in network.NETWORK] == list(network.NETWORK)
    for name in network.NETWORK:
        assert rows[name]["cells"]["average"]["value"] is not None
        assert "where the paper has 256 and 6" in rows[name]["note"]
    assert made["frames"] == {"actor 1": 80, "actor 2": 80}
    assert [(pair["name"], pair["against"]) for pair in made["pairs"]] == list(network.STAGES)
    cells = [rows[name]["cells"]["average"]["value"] for name in network.STAGES[0]]
    gain = made["pairs"][0]["differences"]["average"]
    assert gain["value"] == pytest.approx(cells[0] - cells[1], abs=2e-3)
    assert f"{network.TUNED}, from {network.PRETRAINED} | " in markdown(made)
    assert [len(printed.rows) for printed in terminal_tables(made)] == [len(made["rows"]), len(network.STAGES)]
    without = rows_of(table(tmp_path / "without", 1, tmp_path / "clip"))
    assert without[network.PRETRAINED]["origin"] == "measured here"
    assert without[network.TUNED]["origin"] == "not measured"
    assert "give extra_data=[...]" in without[network.TUNED]["note"]


def test_no_frame_is_scored_by_a_network_that_learned_from_it_or_its_neighbours():
    clip = seen(frames=100)
    parts = network.folds(clip)
    assert [(part.start, part.stop) for part in parts] == [(0, 25), (25, 50), (50, 75), (75, 100)]
    for part in parts:
        scored = clip.truth.xyz[max(part.start - network.APART, 0) : part.stop + network.APART]
        for other in network.others(clip, part):
            assert not (other.truth.xyz[:, None] == scored[None]).all((2, 3, 4)).any()
    xyz = clip.truth.xyz.copy()
    xyz[40:] = np.nan
    some = replace(clip, truth=replace(clip.truth, xyz=xyz, source=np.where(np.isnan(xyz[..., 0]), 0, 1)))
    assert [(part.start, part.stop) for part in network.folds(some)] == [(0, 10), (10, 20), (20, 30), (30, 100)]


def test_fusion_has_rows_for_each_stage_and_the_better_of_two_says_so(clips, pretrained, tmp_path):
    save_clip(seen(frames=80).select(views=[0, 1, 2]), tmp_path / "clip")
    made = table(tmp_path, 4, tmp_path / "clip", extra_data=[str(clips)])
    rows = rows_of(made)
    assert list(rows) == ["linear", "dmae", *network.NETWORK, tables.BETTER]
    for group in tables.GROUPS:
        assert rows[network.TUNED]["cells"][group]["value"] is not None
    better = rows[tables.BETTER]
    assert better["protocol"] == "hkbu, better of two by the truth"
    assert "no system can do so" in better["note"]
    for name in ("dmae", network.TUNED):
        assert better["cells"]["average"]["value"] >= rows[name]["cells"]["average"]["value"] - 0.5
    assert made["frames"] == {"actor 1": 80, "actor 2": 80}


def test_fusion_without_simulated_clips_is_not_measured(pretrained, tmp_path):
    save_clip(seen(frames=60), tmp_path / "clip")
    rows = rows_of(table(tmp_path, 4, tmp_path / "clip"))
    for name in (*network.NETWORK[1:], tables.BETTER):
        assert rows[name]["origin"] == "not measured"
        assert "give extra_data=[...]" in rows[name]["note"]
        assert {cell["value"] for cell in rows[name]["cells"].values()} == {None}


def test_a_set_of_one_clip_cannot_be_halved(tmp_path):
    save_clip(full_clip(frames=20), tmp_path / "clip")
    with pytest.raises(ValueError, match="1 clip; expected a data set of two clips or more"):
        table(tmp_path, 3, tmp_path / "clip")
