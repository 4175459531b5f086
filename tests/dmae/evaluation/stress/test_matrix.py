"""The matrix on small clips: planned, kept, continued, the same with any number of workers."""

import json
from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Detections2D, Poses3D
from dmae.data.skeleton import BODY25
from dmae.data.store import save_clip, write_manifest
from dmae.evaluation.config import StressConfig
from dmae.evaluation.stress import matrix
from dmae.evaluation.stress.matrix import CACHE, compute, prepare
from dmae.evaluation.stress.page import angle_tables
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture
from tests.support.animals import dog_clip
from tests.support.commands import dmae
from tests.support.stressed_clips import strollers

CLIPS = [strollers(30, persons, views=4, name=name, fps=10.0) for name, persons in (("a", 3), ("b", 2))]


def config(**changes) -> StressConfig:
    options = {"axes": ["misses", "cameras"], "pairs": [], "methods": ["measured", "linear"]}
    return StressConfig(**options | changes)


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """The file of a cache, and the result of the run that filled it."""
    file = tmp_path_factory.mktemp("cache") / CACHE
    return file, compute(prepare(CLIPS, config(), file))


@pytest.fixture
def ran(monkeypatch) -> list:
    """Cells that are run, and the methods in each."""
    found, run_cell = [], matrix.run_cell

    def counted(subject, cell, contenders):
        found.append((subject.clip.id, cell.levels, [each.name for each in contenders]))
        return run_cell(subject, cell, contenders)

    monkeypatch.setattr(matrix, "run_cell", counted)
    return found


def test_curves_fall_from_the_clip_as_it_is(first):
    _, result = first
    assert [axis["name"] for axis in result["axes"]] == ["misses", "cameras"]
    for axis in result["axes"]:
        for method in axis["methods"].values():
            values = [point["pcp"][0] for point in method["points"]]
            assert values[0] > 97 and values[-1] < values[0]
            assert all(point["pcp"][1] <= point["pcp"][0] <= point["pcp"][2] for point in method["points"])
    measured, linear = (result["axes"][0]["methods"][name] for name in ("measured", "linear"))
    assert measured["points"][-1]["pcp"][0] < linear["points"][-1]["pcp"][0]
    assert measured["breaks"]["hidden"] is None


def test_angles_are_scored_in_degrees_where_they_are_asked_for(first, tmp_path):
    options = {"axes": ["jitter"], "levels": {"jitter": [8]}, "methods": ["linear"]}
    clips = [CLIPS[1].select(slice(8))]
    found = compute(prepare(clips, config(angles=True, **options), tmp_path / CACHE))
    exact, shaken = (point["angles"][0] for point in found["axes"][0]["methods"]["linear"]["points"])
    assert 0 < exact < shaken < 45
    (table,) = angle_tables(found)
    assert [row[:2] for row in table.rows] == [("jitter", "0 % of height"), ("jitter", "8 % of height")]
    assert table.rows[1][2].startswith(f"{shaken:.1f}")
    assert not angle_tables(first[1]) and "angles" not in first[1]["axes"][0]["methods"]["linear"]["points"][0]
    plain = prepare(clips, config(**options), tmp_path / CACHE)
    assert plain.missing()  # scores without angles are others


def test_bodies_that_are_no_people_are_stressed_too(tmp_path):
    clip = dog_clip(60, dogs=2)
    subjects = config(axes=["own_body", "cameras"], levels={"cameras": [1]}, methods=["linear", "gaussian_process"])
    result = compute(prepare([clip], subjects, tmp_path / CACHE))
    for axis in result["axes"]:
        lines, learned = (axis["methods"][name]["points"] for name in ("linear", "gaussian_process"))
        assert all(mine["pcp"][0] > other["pcp"][0] for mine, other in zip(learned, lines, strict=True))
        assert learned[0]["pcp"][0] > 95


def test_networks_that_do_not_know_a_body_are_left_out_with_a_note():
    matrix = prepare([dog_clip(30)], StressConfig(axes=["cameras"], pairs=[]))
    methods = ["measured", "linear", "linear_body", "kalman", "gaussian_process"]
    assert [each.name for each in matrix.contenders] == methods
    assert "Left out dmae, paper: their weights know people, and nothing of dog19." in matrix.plan.notes


def test_a_second_run_computes_nothing(first, ran):
    file, result = first
    again = prepare(CLIPS, config(), file)
    assert "10 of them kept from earlier runs, 0 to compute" in again.forecast
    assert compute(again) == result
    assert ran == []


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"levels": {"misses": [20, 30]}}, {((("misses", 30.0),), ("measured", "linear"))}),
        ({"methods": ["measured", "linear", "hold"], "axes": ["cameras"]}, {"hold alone"}),
        ({"seed": 1, "axes": ["misses"]}, {((("misses", level),), ("measured", "linear")) for level in (20, 40)}),
    ],
)
def test_what_is_new_alone_is_computed(first, ran, changes, expected):
    file, _ = first
    compute(prepare(CLIPS, config(**changes), file))
    if expected == {"hold alone"}:
        assert {tuple(methods) for _, _, methods in ran} == {("hold",)} and len(ran) == 6
    else:
        assert {(levels, tuple(methods)) for _, levels, methods in ran} == expected
        assert len(ran) == 2 * len(expected)


def test_another_clip_capture_or_code_is_computed_anew(first, ran, monkeypatch):
    file, _ = first
    moved = replace(CLIPS[0], truth=Poses3D(BODY25, CLIPS[0].truth.xyz + 0.01))
    assert len(prepare([moved, CLIPS[1]], config(), file).missing()) == 5
    stricter = replace(config().capture, th_p=0.3)
    assert len(prepare(CLIPS, config(capture=stricter), file).missing()) == 10
    monkeypatch.setattr("dmae.evaluation.stress.matrix.code_hash", lambda: "other")
    assert len(prepare(CLIPS, config(), file).missing()) == 10


@pytest.mark.parametrize("damage", [lambda line: line[:40], lambda line: b"\xff" + line, lambda _: b"[1]"])
def test_a_damaged_result_is_computed_anew_and_the_file_is_whole_again(first, ran, tmp_path, damage):
    kept, result = first
    lines = kept.read_bytes().splitlines()
    file = tmp_path / CACHE
    file.write_bytes(b"\n".join([*lines[1:], damage(lines[0])]))
    assert compute(prepare(CLIPS, config(), file)) == result
    assert len(ran) == 1
    keys = [{*json.loads(line, parse_constant=pytest.fail)} for line in file.read_bytes().splitlines()]
    assert sorted(map(min, keys)) == sorted(min(json.loads(line)) for line in lines)


def test_an_interrupted_run_is_continued(tmp_path, ran, first, monkeypatch):
    run_cell = matrix.run_cell

    def interrupted(*arguments):
        if len(ran) == 3:
            raise KeyboardInterrupt
        return run_cell(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(matrix, "run_cell", interrupted)
        with pytest.raises(KeyboardInterrupt):
            compute(prepare(CLIPS, config(), tmp_path / CACHE))
    assert len(ran) == 3
    assert compute(prepare(CLIPS, config(), tmp_path / CACHE)) == first[1]
    assert len(ran) == 10


@pytest.mark.slow
def test_the_number_of_workers_changes_nothing(first, tmp_path):
    file, result = first
    assert compute(prepare(CLIPS, config(workers=2), tmp_path / CACHE)) == result
    lines, others = (set(path.read_text().splitlines()) for path in (file, tmp_path / CACHE))
    assert others <= lines


def test_without_truth_what_all_cameras_measured_is_the_reference(first):
    clips = [replace(clip, truth=None) for clip in CLIPS]
    result = compute(prepare(clips, config(axes=["misses"])))
    assert result["reference"] == "capture"
    points = result["axes"][0]["methods"]["linear"]["points"]
    # Filled poses are smoothed, the reference is not.
    assert points[0]["pcp"][0] > 99.3 and points[-1]["pcp"][0] < points[0]["pcp"][0]


def test_axes_that_clips_do_not_allow_are_left_out_with_a_note():
    few = [strollers(frames=20, persons=1, views=3, name="few")]
    planned = prepare(few, config(axes=[], pairs=None)).plan
    names = [axis.name for axis in planned.axes]
    assert "person_swaps" not in names and "merges" not in names and "misses" in names
    (cameras,) = (axis for axis in planned.axes if axis.name == "cameras")
    assert cameras.levels == ((1.0,),)
    assert any("clip 'few' has 3 cameras, and two must be left" in note for note in planned.notes)
    assert {level[0] for level in planned.pairs[0].levels} == {1.0}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"axes": ["jiter"]}, "no corruption 'jiter'; did you mean jitter"),
        ({"axes": ["merges"]}, "merges=20: expected 2 people or more in an image, clip 'few' has at most 1"),
        (
            {"axes": ["cameras"], "levels": {"cameras": [1, 2]}},
            "cameras=2: clip 'few' has 3 cameras, and two must be left",
        ),
        ({"levels": {"misses": [120]}}, r"misses=120: expected 0 or up to 100, in %"),
        ({"levels": {"misses": [0]}}, "levels.misses: expected one or more above 0"),
        (
            {"axes": ["misses", "edges", "bursts", "offsets"], "pairs": [], "levels": {"jitter": [1]}},
            "levels.jitter: no such axis is used; there are misses, edges, bursts, offsets$",
        ),
        ({"pairs": ["misses"]}, r"pairs=misses: expected two different axes, as in pairs=\[cameras\+objects\]"),
        ({"methods": ["liner"]}, "no completion method 'liner'; did you mean linear"),
        ({"methods": []}, r"methods=\[\]: expected some of"),
        ({"paper_weights": "runs/paper"}, "paper_weights=runs/paper: expected paper among the methods"),
    ],
)
def test_what_cannot_be_is_named(changes, message):
    few = [strollers(frames=10, persons=1, views=3, name="few")]
    with pytest.raises(ValueError, match=message):
        prepare(few, config(**changes))


def test_weights_that_are_not_there_are_named():
    with pytest.raises(FileNotFoundError, match="expected a folder that `dmae train` wrote"):
        prepare(CLIPS, config(methods=["dmae"], weights="nowhere"))


def test_clips_that_cannot_be_compared_are_named():
    without = replace(CLIPS[1], truth=None)
    with pytest.raises(ValueError, match="clips b have no truth, others have"):
        prepare([CLIPS[0], without], config())
    with pytest.raises(ValueError, match="two clips have the id 'a'"):
        prepare([CLIPS[0], CLIPS[0]], config())
    with pytest.raises(ValueError, match="no clip to stress"):
        prepare([], config())
    two = replace(CLIPS[1].select(views=[0, 1]), truth=None)
    with pytest.raises(ValueError, match="no truth, and its 2 cameras measure no joint in three views or more"):
        compute(prepare([two], config(axes=["misses"])))


def shortened(poses: Poses3D, fps: float) -> Poses3D:
    """Loses a frame."""
    return poses.select(slice(1, None))


def test_predictions_of_another_length_are_named():
    name = f"{__name__}:shortened"
    with pytest.raises(ValueError, match=r"shortened: expected poses of \d persons in 30 frames back, found \d in 29"):
        compute(prepare(CLIPS[:1], config(methods=[name], axes=["misses"])))


def halved(clip, _config):
    """Every second frame."""
    poses = capture(clip, CaptureConfig())
    return poses.without(np.broadcast_to((np.arange(len(clip)) % 2 == 1)[:, None, None], poses.source.shape))


def test_published_systems_and_captures_of_your_own_capture_in_their_own_way():
    own = f"{__name__}:halved"
    result = compute(prepare(CLIPS[:1], config(methods=["measured"], captures=["mvpose", own], axes=["cameras"])))
    assert "As measured" in result["methods"]["mvpose"]
    assert result["methods"][own] == f"The function {own}. As measured."
    first = {name: method["points"][0] for name, method in result["axes"][0]["methods"].items()}
    assert first["mvpose"]["pcp"][0] > 80
    assert first["mvpose"]["pcp"] != first["measured"]["pcp"]
    np.testing.assert_allclose(first[own]["pcp"][0], first["measured"]["pcp"][0] / 2, atol=2)


def test_paper_is_captured_with_its_thresholds():
    result = compute(prepare(CLIPS[:1], config(methods=["linear", "paper"], axes=["cameras"])))
    assert "completed by its network, weights=paper" in result["methods"]["paper"]
    last = {name: method["points"][-1] for name, method in result["axes"][0]["methods"].items()}
    # Two cameras are left, and the paper asks for three.
    assert last["paper"]["pcp"][0] == 0 < last["linear"]["pcp"][0]


def test_a_clip_without_people_is_not_measured_well_and_does_not_stop():
    nothing = np.full_like(CLIPS[0].detections.xy, np.nan)
    clip = replace(CLIPS[0], detections=Detections2D(BODY25, nothing, nothing[..., 0]), detection_labels=None)
    result = compute(prepare([clip], config(axes=["misses"])))
    assert result["axes"][0]["methods"]["linear"]["points"][0]["pcp"][0] == 0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A working directory with a data set of two clips."""
    folder = tmp_path_factory.mktemp("work")
    for clip in CLIPS:
        save_clip(clip, folder / "set" / clip.id)
    write_manifest(folder / "set", [{"id": clip.id, "status": "ok"} for clip in CLIPS])
    return folder


class TestCommand:
    def test_writes_a_result_and_a_page(self, folder):
        options = ("data=set", "axes=[jitter]", "levels.jitter=2", "pairs=[]", "methods=[linear]", "out=found")
        done = dmae(folder, "stress", *options)
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith(
            "4 cells (2 clips; corruptions: 1 alone, 0 in pairs; 1 seed), 4 to compute with 1 method each"
        )
        (axis,) = json.loads((folder / "found/stress.json").read_text())["axes"]
        assert [point["level"] for point in axis["methods"]["linear"]["points"]] == [0, 2]
        assert "<html" in (folder / "found/stress.html").read_text()
        again = dmae(folder, "stress", *options)
        assert "4 of them kept from earlier runs, 0 to compute" in again.stdout

    def test_real_recordings_are_taken(self, folder, data_folder):
        shelf = ("data=shelf", f"data.path={data_folder / 'shelf'}", "data.frames=[0,25]")
        options = ("axes=[objects,offsets]", "pairs=[]", "methods=[linear]", "out=shelf")
        done = dmae(folder, "stress", *shelf, *options)
        assert done.returncode == 0, done.stderr
        axes = json.loads((folder / "shelf/stress.json").read_text())["axes"]
        assert all(axis["methods"]["linear"]["points"][0]["pcp"][0] > 95 for axis in axes)
