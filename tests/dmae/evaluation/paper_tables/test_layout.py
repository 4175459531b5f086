"""Published rows: complete, each with its source, and in agreement with themselves."""

import pytest

from dmae.evaluation.config import NUMBERS
from dmae.evaluation.paper_tables.layout import TableColumn, below_publication, published_rows
from dmae.metrics.registry import protocol

ROWS = [row for number in NUMBERS for row in published_rows(number)]
LIMBS = ("upper arm", "lower arm", "upper leg", "lower leg")
KEYS = {
    1: {"actor_1", "actor_2", "actor_3", "average", "without_2"},
    2: {f"views_{count}{actor}" for count in (5, 4, 3) for actor in ("", "_actor_1", "_actor_2", "_actor_3")},
    3: {"pcp", "recall", "precision", "mpjpe", "hidden_recall", "hidden"},
    4: {"head", "torso", "average", "mpjpe", *(f"{side} {limb}" for side in ("left", "right") for limb in LIMBS)},
    5: {"recall", "mpjpe"},
    6: {f"{figure}_{count}" for figure in ("mpjpe", "recall") for count in range(2, 9)},
}
"""Keys of the columns of each table."""
OTHERS = {"not stated", "XRMoCap's own", "hkbu, better of two by the truth", "joints within 0.2 m"}
"""Protocols of publications that no measured row has."""


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row['table']} {row['name']}")
def test_every_row_says_where_its_figures_are_from(row):
    assert set(row) == {"table", "name", "data", "protocol", "source", "values", "note"}
    assert len(row["source"]) > 20
    assert row["protocol"] in {*protocol, *OTHERS}
    assert row["values"].keys() <= KEYS[row["table"]]
    assert row["values"] or row["note"]
    assert all(0 < value <= 100 for value in row["values"].values())


@pytest.mark.parametrize("row", [row for row in ROWS if "actor_1" in row["values"]], ids=lambda row: row["name"])
def test_averages_are_of_the_actors(row):
    actors = [row["values"][f"actor_{number}"] for number in (1, 2, 3)]
    # The average that is printed for TesseTrack is not that of its actors, and the row says so.
    assert abs(sum(actors) / 3 - row["values"]["average"]) < 0.1 or "not the mean" in row["note"]
    if "without_2" in row["values"]:
        assert (actors[0] + actors[2]) / 2 == pytest.approx(row["values"]["without_2"], abs=0.06)


def test_averages_by_number_of_cameras_are_of_the_actors():
    for row in (row for row in ROWS if row["table"] == 2):
        for count in (5, 4, 3):
            actors = [row["values"][f"views_{count}_actor_{number}"] for number in (1, 2, 3)]
            assert sum(actors) / 3 == pytest.approx(row["values"][f"views_{count}"], abs=0.1)


def test_the_paper_has_as_many_rows_as_its_source():
    ours = [row for row in ROWS if "Jiang, Chen and Guo" in row["source"]]
    assert [sum(row["table"] == number for row in ours) for number in NUMBERS] == [10, 3, 6, 2, 4, 0]


def test_the_paper_is_in_every_table_and_its_successors_in_the_first():
    for number in range(1, 6):
        assert any(row["name"].startswith("D-MAE") for row in published_rows(number))
    names = " ".join(row["name"] for row in published_rows(1))
    assert all(name in names for name in ("4DAssociation", "JCSAT", "MMDM", "Faster-VoxelPose"))


def test_a_system_below_its_publication_says_so():
    columns = [
        TableColumn("views_5", "5 cameras (9 frames)", lead=True),
        TableColumn("views_3", "3 cameras", lead=True),
    ]
    cells = {"views_5": {"value": 98.0}, "views_3": {"value": 95.0}}
    noted = below_publication(cells, "Lin and Lee 2021", columns, 2)
    assert noted == "; below its publication, which has 95.1 % (3 cameras)"
    assert not below_publication(cells, "Tu et al. 2020", columns, 2)


def test_what_is_quoted_at_second_hand_says_so():
    rows = {row["name"]: row["note"] for row in published_rows(1)}
    assert "secondary source" in rows["MMDM (Jiang et al. 2026)"]
    assert "secondary source" not in rows["MvP (Wang et al. 2021)"]
