"""Published rows: complete, each with its source, and in agreement with themselves."""

import tomllib
from pathlib import Path

import pytest

import dmae.evaluation.paper_tables.table as published
from dmae.evaluation.config import NUMBERS
from dmae.evaluation.paper_tables.table import published_rows
from dmae.metrics.registry import protocol

ROWS = tomllib.loads((Path(published.__file__).parent / "published.toml").read_text())["row"]
KEYS = {
    1: {"actor_1", "actor_2", "actor_3", "average"},
    2: {"views_5", "views_4", "views_3"},
    3: {"pcp", "recall", "precision", "mpjpe", "hidden_recall", "hidden"},
    4: {"head", "torso", "upper arms", "lower arms", "upper legs", "lower legs", "average", "mpjpe"},
    5: {"recall", "mpjpe"},
}
"""Keys of the columns of each table."""
OTHERS = {"not stated", "XRMoCap's own", "hkbu, better of two by the truth", "joints within 0.2 m"}
"""Protocols of publications that no measured row has."""


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row['table']} {row['name']}")
def test_every_row_says_where_its_figures_are_from(row):
    assert row["table"] in NUMBERS
    assert len(row["source"]) > 20
    assert row["protocol"] in {*protocol, *OTHERS}
    assert row["values"].keys() <= KEYS[row["table"]]
    assert row["values"] or row["note"]
    assert all(0 < value <= 100 for value in row["values"].values())


@pytest.mark.parametrize("row", [row for row in ROWS if "actor_1" in row["values"]], ids=lambda row: row["name"])
def test_averages_are_of_the_three_actors(row):
    actors = [row["values"][f"actor_{number}"] for number in (1, 2, 3)]
    assert sum(actors) / 3 == pytest.approx(row["values"]["average"], abs=0.1)


def test_the_paper_is_in_every_table_and_its_successors_in_the_first():
    for number in NUMBERS:
        assert any(row["name"].startswith("D-MAE") for row in published_rows(number))
    names = " ".join(row["name"] for row in published_rows(1))
    assert all(name in names for name in ("4DAssociation", "JCSAT", "MMDM", "Faster-VoxelPose"))


def test_what_is_quoted_at_second_hand_says_so():
    rows = {row["name"]: row["note"] for row in published_rows(1)}
    assert "secondary source" in rows["MMDM (Jiang et al. 2026)"]
    assert "secondary source" not in rows["MvP (Wang et al. 2021)"]


def test_a_row_without_a_source_is_an_error(tmp_path, monkeypatch):
    (tmp_path / "published.toml").write_text('[[row]]\ntable = 1\nname = "x"\n')
    monkeypatch.setattr(published, "files", lambda package: tmp_path)
    with pytest.raises(ValueError, match=r"'x'.*'source'"):
        published_rows(1)
