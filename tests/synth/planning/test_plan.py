"""Whole plans from small searches: results, files, and input that is refused."""

import json

import numpy as np
import pytest

import synth
from dmae.cli import compose
from dmae.formats.calibrations import read_calibration
from synth.cli import SYNTH
from synth.planning.plan import FIGURES, check_numbers, cover_floor, find_candidates, with_one_less
from synth.planning.search import gather, rehearse
from synth.rooms.room import arena_file
from tests.support.commands import synth as run

SMALL = (
    "arena=studio",
    "cameras=[2,3]",
    "persons=[1,1]",
    "scene.seconds=0.4",
    "search.clips=1",
    "search.frames=2",
    "search.check_clips=2",
    "mount.places=12",
)


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    out = tmp_path_factory.mktemp("plan") / "plan"
    return synth.plan(*SMALL[3:], arena="studio", cameras=[2, 3], persons=[1, 1], out=out), out


def test_a_plan_has_figures_and_what_each_camera_is_worth(planned):
    plan, _ = planned
    assert [len(each.rig) for each in plan.rigs] == [2, 3]
    three = plan[3]
    assert set(three.figures) == set(FIGURES)
    assert 0 <= three.figures["pcp"].low <= three.figures["pcp"].value <= three.figures["pcp"].high <= 100
    assert three.figures["pcp"].value > 80
    assert (len(plan[2].worth), len(three.worth)) == (0, 3)
    assert three.floor.share(2) > 50
    assert plan[3].prediction.score > plan[2].prediction.score


def test_what_is_written_is_read_back_by_captures_and_rigs(planned, tmp_path):
    plan, out = planned
    rig = read_calibration(out / "cameras_3.toml")
    np.testing.assert_allclose(rig.projections, plan[3].rig.projections, atol=1e-6)
    given = ["clips=1", "scene.seconds=0.2", "scene.persons=[1,1]", "scene=studio"]
    clip = next(synth.generate(f"rig.path={out}/cameras_3.toml", *given[1:3], clips=1, scene="studio", rig="ring"))
    assert len(clip.rig) == 3
    done = run(tmp_path, "generate", f"--config-dir={out}", "rig=planned_3", *given, "out=clips")
    assert done.returncode == 0, done.stderr
    text = (out / "mounting_3.txt").read_text()
    for name, (x, y, z) in zip(plan[3].rig.names, plan[3].rig.centers, strict=True):
        line = next(line for line in text.splitlines() if line.startswith(name))
        assert f"{x:.2f}" in line and f"{y:.2f}" in line and f"{z:.2f}" in line
    numbers = json.loads((out / "plan.json").read_text())
    assert [each["cameras"] for each in numbers["rigs"]] == [2, 3]
    page = (out / "plan.html").read_text()
    assert "Where to mount cameras" in page and "What each camera sees." in page


def test_the_same_seed_gives_the_same_plan(planned):
    plan, _ = planned
    again = synth.plan(*SMALL[3:], arena="studio", cameras=[2, 3], persons=[1, 1])
    np.testing.assert_array_equal(again[3].rig.cam_from_world, plan[3].rig.cam_from_world)
    assert again[3].figures == plan[3].figures


def test_cameras_that_exist_are_chosen_from(tmp_path):
    done = run(tmp_path, "plan", *SMALL[:1], *SMALL[2:], "rig=shelf", "cameras=[3,3]", "out=plan")
    assert done.returncode == 0, done.stderr
    names = json.loads((tmp_path / "plan/plan.json").read_text())["rigs"][0]["names"]
    assert len(names) == 3 and set(names) <= set("01234")


def test_a_forecast_writes_nothing(tmp_path):
    done = run(tmp_path, "plan", *SMALL, "dry_run=true", "out=plan")
    assert done.returncode == 0 and "3 clips to simulate, 10 captures: about" in done.stdout
    assert not (tmp_path / "plan").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["cameras=[1,4]"], "cameras: expected [least, greatest] number, from 2"),
        (["cameras=[5,4]"], "cameras: expected [least, greatest]"),
        (["cameras=[4,40]"], "to 32"),
        (["mount.places=3", "cameras=[4,4]"], "raise mount.places"),
        (["rig=shelf", "cameras=[4,6]"], "there are 5 cameras in the rig"),
        (["mount.walls=[2,9]"], "m high"),
        (["mount.walls=[2]"], "mount.walls: expected [least, greatest] height"),
        (["mount.walls=[]", "mount.tripods=[]", "mount.ceiling=false"], "no camera can be mounted anywhere"),
        (["mount.area=[1,1,0,0]"], "mount.area: expected"),
        (["lens.view_deg=[200]"], "lens.view_deg"),
        (["arena=nowhere.xml"], "nowhere.xml"),
        (["persons=[4,1]"], "scene.persons"),
    ],
)
def test_what_cannot_be_is_one_message_and_nothing_is_written(tmp_path, options, message):
    done = run(tmp_path, "plan", *SMALL, *options, "out=plan")
    assert done.returncode == 1
    assert message in done.stderr and len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "plan").exists()


def test_a_folder_that_holds_something_is_kept(tmp_path):
    (tmp_path / "plan").mkdir()
    (tmp_path / "plan" / "notes.txt").write_text("mine")
    done = run(tmp_path, "plan", *SMALL, "out=plan")
    assert done.returncode == 1 and "notes.txt" in done.stderr
    assert [path.name for path in (tmp_path / "plan").iterdir()] == ["notes.txt"]


def test_evidence_agrees_with_the_simulated_detector():
    config = compose(SYNTH.commands["plan"], [*SMALL, "persons=[2,2]", "scene.seconds=1.6", "rig=shelf"])
    candidates, rehearsal = find_candidates(config), rehearse(config, 0)
    evidence = gather(rehearsal, candidates, config.detector, 40)
    clip = rehearsal.seen_by(candidates.rig, config.detector)
    labels, detected = clip.detection_labels, clip.detections.observed
    found = sum(detected[labels.person == person].sum() for person in range(2))
    joints = len(clip) * len(clip.rig) * 2 * detected.shape[-1]
    # Feet are in the detector's skeleton alone; they are detected about as often as the rest.
    assert evidence.probability.mean() == pytest.approx(found / joints, abs=0.08)


def test_rigs_are_checked_on_other_clips():
    config = compose(SYNTH.commands["plan"], list(SMALL))
    assert set(check_numbers(config)).isdisjoint(range(config.search.clips))
    assert with_one_less([3, 5, 9]) == [[3, 5, 9], [5, 9], [3, 9], [3, 5]]
    assert with_one_less([3, 5]) == [[3, 5]]


def test_the_floor_is_seen_by_the_cameras_that_look_at_it():
    config = compose(SYNTH.commands["plan"], [*SMALL, "rig=ring", "rig.ring.views=4"])
    rig = find_candidates(config).rig
    floor = cover_floor(rig, arena_file("studio"), np.zeros(2), 1.0)
    middle = len(floor.x) // 2
    assert floor.cameras[middle, middle] == 4
    assert floor.cameras[0, 0] == -1
    away = cover_floor(rig[:1], arena_file("studio"), 3 * rig.centers[0, :2] / np.linalg.norm(rig.centers[0, :2]), 1.0)
    assert away.share(1) < 100
