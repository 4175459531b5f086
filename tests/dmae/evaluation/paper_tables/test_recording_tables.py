"""Tables of one recording: PCP of each actor, and by number of cameras."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25, SHELF14, get_skeleton
from dmae.data.store import save_clip, write_manifest
from dmae.evaluation.config import TableConfig, TableSize
from dmae.evaluation.evaluate import evaluate
from dmae.evaluation.paper_tables import tables
from dmae.evaluation.paper_tables.layout import markdown, terminal_tables
from dmae.evaluation.paper_tables.tables import convert_with_head, make_table
from dmae.formats.reading import DataConfig
from dmae.metrics.registry import protocol
from tests.support import scored_clips
from tests.support.clips import t_pose, walkers

FRAMES = 130


def shaken() -> Clip:
    """Two walkers over five seconds, seen by three cameras with errors of some pixels."""
    clip = scored_clips.seen(frames=FRAMES).select(views=[0, 1, 2])
    xy = clip.detections.xy + np.random.default_rng(0).normal(0, 4, clip.detections.xy.shape)
    return replace(clip, detections=replace(clip.detections, xy=xy))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording")
    save_clip(shaken(), path)
    return path


@pytest.fixture(scope="module")
def actors(folder) -> dict:
    """Table 1 of it."""
    return table(folder, 1)


def table(path, number: int, **changes) -> dict:
    config = TableConfig(number=number, data=DataConfig(path=str(path)), size=TableSize.small, **changes)
    return make_table(config, path / "out")


@pytest.fixture
def no_network(monkeypatch):
    """Rows of straight lines alone, which others are compared with: completion takes most of the time."""
    monkeypatch.setitem(tables.METHODS, TableSize.small, ("measured", "linear"))
    monkeypatch.setattr(tables, "AGAINST", "linear")
    monkeypatch.setattr(tables, "paper_network", lambda *_: {})


def measured(made: dict) -> dict[str, dict]:
    return {row["name"]: row for row in made["rows"] if row["origin"] == "measured here"}


def test_strict_cells_are_the_scores_of_evaluate(folder, actors, no_network):
    methods = ["measured", "linear"]
    scores = scored_clips.by_method(evaluate(scored_clips.config(folder, methods=methods, views=[3, 2])))
    cameras = measured(table(folder, 2))
    for name in methods:
        cells = measured(actors)[name]["cells"]
        assert cells["average"]["value"] == pytest.approx(scores[name, 3]["mean"]["pcp"], abs=1e-3)
        found = [cells["actor_1"]["value"], cells["actor_2"]["value"]]
        assert found == pytest.approx(scores[name, 3]["mean"]["pcp_persons"], abs=1e-3)
        for views in (3, 2):
            cell = cameras[name]["cells"][f"views_{views}"]
            assert cell["value"] == pytest.approx(scores[name, views]["mean"]["pcp"], abs=1e-3)
            assert [cell["low"], cell["high"]] == pytest.approx(scores[name, views]["intervals"]["pcp"], abs=1e-3)
        worst = cameras[name]["cells"]["worst_2"]["value"]
        assert worst == pytest.approx(scores[name, 2]["worst"]["pcp"], abs=1e-3)


def test_frames_of_each_actor_stand_beside_the_average(actors):
    assert actors["frames"] == {"actor 1": FRAMES, "actor 2": FRAMES}
    assert [column["heading"] for column in actors["columns"]] == [
        f"actor 1 ({FRAMES} frames)", f"actor 2 ({FRAMES} frames)", f"average ({FRAMES}+{FRAMES} frames)"
    ]  # fmt: skip


def test_published_systems_have_rows_from_the_same_detections(folder, no_network):
    rows = {number: measured(table(folder, number, systems=["mvpose"])) for number in (1, 2)}
    cells = rows[1]["mvpose"]["cells"]
    assert "Dong et al. 2021" in rows[1]["mvpose"]["note"]
    assert cells["average"]["value"] == pytest.approx(
        (cells["actor_1"]["value"] + cells["actor_2"]["value"]) / 2, abs=2e-3
    )
    raw = rows[1]["measured"]["cells"]["average"]["value"]
    assert cells["average"]["value"] != raw
    # A capture is compared with a capture, not with completed poses.
    assert rows[1]["mvpose"]["against"] == "measured"
    difference = rows[1]["mvpose"]["differences"]["average"]["value"]
    assert difference == pytest.approx(cells["average"]["value"] - raw, abs=2e-3)
    by_cameras = rows[2]["mvpose"]["cells"]
    assert by_cameras["views_3"] == cells["average"]
    assert by_cameras["views_3_actor_1"] == cells["actor_1"]
    assert 0 < by_cameras["views_2"]["value"] <= 100


def test_an_unknown_system_is_named():
    with pytest.raises(ValueError, match="no capture method 'mvpos'; did you mean mvpose"):
        TableConfig(systems=["mvpos"])


def test_differences_have_intervals_and_published_rows_of_other_data_none(actors):
    rows = measured(actors)
    assert rows["dmae"]["differences"] == {}
    difference = rows["measured"]["differences"]["average"]
    assert difference["low"] <= difference["value"] <= difference["high"]
    cells = [rows[name]["cells"]["average"]["value"] for name in ("measured", "dmae")]
    assert difference["value"] == pytest.approx(cells[0] - cells[1], abs=2e-3)
    assert all(row["differences"] == {} for row in actors["rows"] if row["origin"] == "published")


def test_an_actor_of_few_frames_has_no_interval(tmp_path, no_network):
    clip = shaken()
    xyz = clip.truth.xyz.copy()
    xyz[20:, 1] = np.nan
    save_clip(replace(clip, truth=Poses3D(clip.truth.skeleton, xyz)), tmp_path)
    cells = measured(table(tmp_path, 1))["linear"]["cells"]
    assert cells["actor_2"]["value"] is not None
    assert cells["actor_2"]["low"] is None
    assert cells["actor_1"]["low"] is not None


@pytest.mark.parametrize("name", sorted(protocol))
def test_every_protocol_scores(tmp_path, name, no_network):
    save_clip(shaken().select(frames=slice(0, 30)), tmp_path)
    made = table(tmp_path, 1, protocol=name)
    assert made["protocol"] == name
    assert {row["protocol"] for row in measured(made).values()} == {name}
    assert 0 < measured(made)["linear"]["cells"]["average"]["value"] <= 100


def test_a_score_of_nothing_is_not_measured(tmp_path, no_network):
    """No person is predicted in any frame: under a protocol that leaves missed persons out nothing counts."""
    clip = scored_clips.seen(frames=10)
    nothing = np.full_like(clip.detections.xy, np.nan)
    save_clip(replace(clip, detections=replace(clip.detections, xy=nothing, score=nothing[..., 0])), tmp_path)
    made = table(tmp_path, 1, protocol="4da")
    assert measured(made)["linear"]["cells"]["average"] == {"value": None, "low": None, "high": None}
    assert "not measured" in next(row for row in terminal_tables(made)[0].rows if row[0] == "linear")
    strict = measured(table(tmp_path, 1))
    assert strict["linear"]["cells"]["average"]["value"] == 0


def test_text_has_every_row_its_source_and_what_is_noise(actors):
    text = markdown(actors)
    assert text.startswith("## Table 1: PCP of each actor\n")
    for row in actors["rows"]:
        assert f"| {row['name']}" in text
        assert row["source"] in text
    assert "noise" in text
    (printed,) = terminal_tables(actors)
    assert len(printed.rows) == len(actors["rows"])
    assert {len(row) for row in printed.rows} == {len(printed.header)}


class TestBadInput:
    def test_truth_on_another_skeleton(self, tmp_path):
        clip = shaken()
        save_clip(replace(clip, truth=walkers(FRAMES, 2)), tmp_path)
        with pytest.raises(ValueError, match=rf"truth on {BODY25.name}; table 2 scores the limbs of shelf14"):
            table(tmp_path, 2)

    def test_no_truth(self, tmp_path):
        save_clip(replace(shaken(), truth=None), tmp_path)
        with pytest.raises(ValueError, match="has no truth; table 1 needs true poses on shelf14"):
            table(tmp_path, 1)

    def test_several_recordings(self, tmp_path):
        for name in "ab":
            save_clip(scored_clips.seen(name=name), tmp_path / name)
        write_manifest(tmp_path, [{"id": name, "status": "ok"} for name in "ab"])
        with pytest.raises(ValueError, match="2 clips; table 1 is about the people of one recording"):
            table(tmp_path, 1)

    @pytest.mark.parametrize("number", [0, 7])
    def test_unknown_number(self, number):
        with pytest.raises(ValueError, match=rf"number={number}: the tables are 1, PCP of each actor; 2, "):
            TableConfig(number=number)

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"number": 5, "protocol": "4da"}, "table 5 counts joints, not limbs"),
            ({"number": 5, "weights": "runs/model"}, "trains its own networks"),
        ],
    )
    def test_options_that_a_table_does_not_read(self, options, message):
        with pytest.raises(ValueError, match=message):
            TableConfig(**options)

    def test_unknown_protocol(self):
        with pytest.raises(ValueError, match="no protocol 'voxelpos'; did you mean voxelpose"):
            TableConfig(protocol="voxelpos")


class TestShelf:
    def test_development_frames(self, data_folder, monkeypatch):
        monkeypatch.setattr(tables, "paper_network", lambda *_: {})
        config = TableConfig(number=1, data=DataConfig("shelf", str(data_folder / "shelf")), size=TableSize.small)
        made = make_table(config, None)
        assert list(made["frames"]) == ["actor 1", "actor 2", "actor 3"]
        rows = {row["name"]: row for row in made["rows"]}
        assert rows["dmae"]["cells"]["average"]["value"] > 98
        assert rows["D-MAE (Jiang et al. 2022)"]["differences"]["average"]["low"] is not None


# Heads as published evaluations place them.

ENDS = list(SHELF14.index("bottom_head", "top_head"))


def poses() -> Poses3D:
    return Poses3D(BODY25, t_pose()[None, None])


@pytest.mark.parametrize(
    ("head", "bottom", "top"),
    [
        # Nose at (0.1, 0, 1.62), ears at 1.64 and shoulders at 1.45 above the origin.
        ("mvpose", (0.05, 0, 1.535), (0.075, 0, 1.705)),
        ("voxelpose", (0.0375, 0, 1.5375), (0.05625, 0, 1.7125)),
    ],
)
def test_ends_are_where_the_formula_says(head, bottom, top):
    placed = convert_with_head(poses(), SHELF14, head).xyz[0, 0, ENDS]
    np.testing.assert_allclose(placed, [bottom, top], atol=1e-6)


def test_heads_of_protocols_are_known():
    heads = {name: convert_with_head(poses(), SHELF14, rules.head).xyz[0, 0, ENDS] for name, rules in protocol.items()}
    for name in ("strict", "4da", "hkbu"):
        np.testing.assert_array_equal(heads[name], convert(poses(), SHELF14).xyz[0, 0, ENDS])
    assert np.linalg.norm(heads["mvpose"] - heads["voxelpose"]) > 0.01


def test_all_but_the_head_is_converted_as_elsewhere():
    placed, plain = convert_with_head(walkers(), SHELF14, "mvpose"), convert(walkers(), SHELF14)
    rest = [joint for joint in range(len(SHELF14)) if joint not in ENDS]
    np.testing.assert_array_equal(placed.xyz[:, :, rest], plain.xyz[:, :, rest])


def test_a_head_without_a_nose_is_absent():
    xyz = t_pose()[None, None].copy()
    xyz[0, 0, BODY25.index("nose")] = np.nan
    placed = convert_with_head(Poses3D(BODY25, xyz), SHELF14, "voxelpose")
    assert np.isnan(placed.xyz[0, 0, ENDS]).all()
    assert (placed.source[0, 0, ENDS] == Source.ABSENT).all()


def test_a_head_that_is_known_stays():
    known = walkers(skeleton=SHELF14)
    assert convert_with_head(known, SHELF14, "mvpose") is known
    fused = get_skeleton("body25+shelf14")
    both = Poses3D(fused, np.concatenate([walkers().xyz, aside_head(known.xyz)], 2))
    np.testing.assert_array_equal(convert_with_head(both, SHELF14, "mvpose").xyz, aside_head(known.xyz))


def aside_head(xyz: np.ndarray) -> np.ndarray:
    xyz = xyz.copy()
    xyz[:, :, ENDS] += 0.1
    return xyz
