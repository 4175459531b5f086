"""Places for cameras: on walls, under ceilings, on tripods; and rooms that have none."""

import json
from itertools import combinations

import numpy as np
import pytest

import synth
from dmae.cli import compose
from dmae.formats.calibrations import read_calibration
from synth.cli import SYNTH
from synth.planning.config import LensConfig, MountConfig
from synth.planning.page import numbers
from synth.planning.places import aimed_cameras, find_places
from synth.planning.plan import (
    FIGURES,
    CameraPlan,
    check_numbers,
    cover_floor,
    expected,
    find_candidates,
    with_one_less,
)
from synth.planning.search import JointEvidence, choose, gather, predict, rehearse, standard_errors
from synth.rigs.coverage import stage_of
from synth.rooms.config import room_choices
from synth.rooms.room import arena_file
from tests.support.commands import synth as run

MIDDLE = np.zeros(2)
FLOOR = '<geom name="floor" type="plane" size="9 9 .1"/>'
WALLS = "".join(
    f'<geom name="wall{x}{y}" type="box" size="{3 if y else 0.1} {3 if x else 0.1} 1.5" pos="{3 * x} {3 * y} 1.5"/>'
    for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1))
)
CUPBOARD = '<geom name="cupboard" type="box" size=".3 .3 1" pos="2 2 1"/>'


def room(tmp_path, things: str):
    path = tmp_path / "room.xml"
    path.write_text(f"<mujoco><worldbody>{FLOOR}{things}</worldbody></mujoco>")
    return path


@pytest.mark.parametrize("name", room_choices())
def test_every_room_has_places_of_every_kind_inside_it(name):
    places = find_places(MountConfig(places=60), arena_file(name), MIDDLE, 1.9)
    assert set(places.kind) == {"wall", "ceiling", "tripod"}
    assert len(places) == 60
    assert np.abs(places.at[:, :2]).max() < 6.5
    tripods = places.at[places.kind == "tripod"]
    assert (np.linalg.norm(tripods[:, :2], axis=1) >= 1.9).all()


def test_places_are_where_they_were_allowed(tmp_path):
    arena = room(tmp_path, WALLS + CUPBOARD)
    config = MountConfig(walls=[2.0, 2.4], tripods=[1.0, 1.0], places=500)
    places = find_places(config, arena, MIDDLE, 1.0)
    walls, ceiling, tripods = (places.at[places.kind == kind] for kind in ("wall", "ceiling", "tripod"))
    # Walls are 20 cm thick, and cameras 15 cm or more off them.
    assert np.abs(walls[:, :2]).max() <= 2.9 - 0.15
    assert np.abs(walls[:, :2]).max(1).min() > 2.6
    assert (walls[:, 2].min(), walls[:, 2].max()) == (2.0, 2.4)
    # There is no ceiling: cameras hang at the top of the walls, 3 m, to 5 cm.
    assert np.abs(ceiling[:, 2] - 2.85).max() < 0.06
    assert set(tripods[:, 2]) == {1.0}
    assert (np.linalg.norm(tripods[:, :2] - 2, axis=1) > 0.3).all()
    inside = find_places(MountConfig(area=[0, 0, 2.9, 2.9], places=200), arena, MIDDLE, 1.0)
    assert inside.at[:, :2].min() >= 0


def test_walls_of_a_low_room_hold_cameras_up_to_their_top(tmp_path):
    config = MountConfig(tripods=[], ceiling=False, places=200)
    high = find_places(config, room(tmp_path, WALLS), MIDDLE, 1.0).at[:, 2]
    assert (high.min(), high.max()) == (1.8, 2.6)
    low = find_places(config, room(tmp_path, WALLS.replace('1.5"', '1.25"')), MIDDLE, 1.0).at[:, 2]
    assert low.min() == 1.8 and 2.4 < low.max() < 2.5


def test_a_ceiling_holds_cameras_below_it(tmp_path):
    arena = room(tmp_path, WALLS + '<geom name="ceiling" type="box" size="3 3 .1" pos="0 0 2.8"/>')
    places = find_places(MountConfig(walls=[], tripods=[], places=200), arena, MIDDLE, 1.0)
    np.testing.assert_allclose(places.at[:, 2], 2.7 - 0.15)


@pytest.mark.parametrize(
    ("things", "config", "message"),
    [
        ("", MountConfig(), r"room.xml has no walls .* set mount.walls=\[\]"),
        ("", MountConfig(walls=[]), r"no walls, so that its extent is unknown.*mount.area"),
        (CUPBOARD, MountConfig(), "no walls"),
        (WALLS, MountConfig(walls=[2.0, 4.0]), r"mount.walls=\[2.0, 4.0\]: room.xml is (2.9\d|3.00) m high"),
        (WALLS, MountConfig(tripods=[1.0, 5.0]), "mount.tripods.* m high"),
        (WALLS, MountConfig(area=[20, 20, 21, 21]), "no places for cameras are left"),
    ],
)
def test_rooms_and_heights_that_cannot_be(tmp_path, things, config, message):
    with pytest.raises(ValueError, match=message):
        find_places(config, room(tmp_path, things), MIDDLE, 1.0)


def test_open_ground_takes_tripods_in_an_area(tmp_path):
    config = MountConfig(walls=[], ceiling=False, area=[-4, -4, 4, 4], places=30)
    places = find_places(config, room(tmp_path, ""), MIDDLE, 1.5)
    assert set(places.kind) == {"tripod"} and len(places) == 30


def test_cameras_are_aimed_at_people_and_not_too_steeply(tmp_path):
    arena = room(tmp_path, WALLS)
    places = find_places(MountConfig(places=40), arena, MIDDLE, 1.0)
    lens = LensConfig(view_deg=[50.0, 90.0])
    found = aimed_cameras(places, lens, MIDDLE, 1.0, stage_of(arena, MIDDLE, 1.0), steepest=40.0)
    assert found.tilt_deg.min() >= -40
    # Aimed at the middle or at a point half a radius from it.
    ahead = found.rig.cam_from_world[:, 2, :3]
    toward = np.array([0, 0, 1.0]) - found.rig.centers
    off = np.linalg.norm(np.cross(ahead, toward), axis=1)
    assert off.max() <= 0.5 + 1e-9
    assert set(found.view_deg) == {50.0, 90.0}
    focal = found.rig.K[found.view_deg == 90.0][:, 0, 0]
    np.testing.assert_allclose(focal, 640.0)


# The search for cameras, on evidence that is known; and evidence, in scenes that are simple.


def evidence_of(centers: np.ndarray, joints: np.ndarray, probability: np.ndarray, error: float = 0.01) -> JointEvidence:
    """Evidence of cameras at (C, 3) places on (N, 3) joints."""
    toward = joints[:, None] - centers
    toward /= np.linalg.norm(toward, axis=-1, keepdims=True)
    planes = np.eye(3) - toward[..., :, None] * toward[..., None, :]
    rows, columns = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
    weight = probability[..., None] / error**2
    return JointEvidence(probability.astype(np.float32), (planes[..., rows, columns] * weight).astype(np.float32))


def around(count: int, radius: float = 4.0) -> np.ndarray:
    angle = 2 * np.pi * np.arange(count) / count
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(count, 1.5)], -1)


def test_standard_errors_are_those_of_the_inverse():
    rng = np.random.default_rng(0)
    parts = rng.normal(size=(5, 3, 4))
    covariance = parts @ parts.swapaxes(-1, -2) * 1e-4
    inverse = np.linalg.inv(covariance)
    information = inverse[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    np.testing.assert_allclose(standard_errors(information), np.sqrt(np.trace(covariance, axis1=1, axis2=2)), rtol=1e-3)


def test_the_share_that_is_measured_is_that_of_two_detections():
    rng = np.random.default_rng(1)
    probability = rng.uniform(0.2, 0.9, (200, 4))
    evidence = evidence_of(around(4), rng.normal(0, 0.5, (200, 3)), probability)
    none = (1 - probability).prod(1)
    one = sum(probability[:, c] * np.delete(1 - probability, c, 1).prod(1) for c in range(4))
    assert predict(evidence, [0, 1, 2, 3]).missing == pytest.approx(100 * (none + one).mean(), abs=1e-4)


def test_cameras_that_see_nothing_or_from_the_same_side_are_left():
    joints = np.random.default_rng(2).normal(0, 0.4, (100, 3)) + (0, 0, 1)
    centers = np.concatenate([around(6), around(6) + (0.05, 0, 0)])
    probability = np.full((100, 12), 0.9)
    probability[:, 3] = 0
    chosen = choose(evidence_of(centers, joints, probability), np.arange(12), range(2, 5))
    assert [len(cameras) for cameras in chosen.values()] == [2, 3, 4]
    assert all(3 not in cameras for cameras in chosen.values())
    one, other = centers[chosen[2]]
    cosine = one[:2] @ other[:2] / np.linalg.norm(one[:2]) / np.linalg.norm(other[:2])
    assert abs(cosine) < 0.6


def test_exchange_finds_the_best_of_all_pairs_and_keeps_places_apart():
    rng = np.random.default_rng(3)
    evidence = evidence_of(around(8), rng.normal(0, 1, (60, 3)), rng.uniform(0, 1, (60, 8)))
    place = np.arange(8) // 2
    (chosen,) = choose(evidence, place, range(2, 3)).values()
    allowed = [list(pair) for pair in combinations(range(8), 2) if place[pair[0]] != place[pair[1]]]
    scores = [predict(evidence, pair).score for pair in allowed]
    assert predict(evidence, chosen).score >= np.quantile(scores, 0.9)
    assert len(set(place[chosen])) == 2
    assert predict(evidence, chosen).score > predict(evidence, chosen[:1]).score


def test_intervals_are_over_clips():
    rng = np.random.default_rng(4)
    held = 0
    for _ in range(300):
        found = expected(rng.normal(90, 3, 6))
        held += found.low <= 90 <= found.high
    assert 270 <= held <= 297
    cut = expected(np.array([99.0, 100.0, 95.0, np.nan]), 0.0, 100.0)
    assert (cut.value, cut.high) == (98.0, 100.0) and cut.low > 80
    assert np.isnan(expected(np.array([5.0, np.nan])).low) and np.isnan(expected(np.array([np.nan])).value)


# Whole plans from small searches: results, files, and input that is refused.

SMALL = (
    "arena=studio",
    "views=[2,3]",
    "persons=[1,1]",
    "scene.seconds=0.4",
    "search.clips=1",
    "search.frames=2",
    "search.check_clips=2",
    "mount.places=12",
)


SMALL_PLAN = {
    "arena": "studio", "views": [2, 3], "persons": [1, 1], "seconds": 0.4, "mount": synth.MountConfig(places=12),
    "search": synth.SearchConfig(clips=1, frames=2, check_clips=2),
}  # fmt: skip
"""The same in Python."""


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    out = tmp_path_factory.mktemp("plan") / "plan"
    return synth.plan(**SMALL_PLAN, out=out), out


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


@pytest.mark.parametrize(
    ("options", "persons"),
    [
        ([], [2, 4]),
        (["persons=[1,3]"], [1, 3]),
        (["interaction=huddle"], [6, 6]),
        (["interaction=queue", "persons=[1,4]", "interaction.bystanders=2"], [5, 6]),
    ],
)
def test_a_plan_says_how_many_people_are_simulated(options, persons):
    assert numbers(CameraPlan(compose(SYNTH.commands["plan"], options), (), 0, ()))["persons"] == persons


def test_what_is_written_is_read_back_by_captures_and_rigs(planned, tmp_path):
    plan, out = planned
    rig = read_calibration(out / "cameras_3.toml")
    np.testing.assert_allclose(rig.projections, plan[3].rig.projections, atol=1e-6)
    given = ["clips=1", "scene.seconds=0.2", "scene.persons=[1,1]", "scene=studio"]
    cameras = synth.RigConfig(path=f"{out}/cameras_3.toml")
    clip = next(synth.generate(clips=1, seconds=0.2, persons=[1, 1], scene="studio", rig=cameras))
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
    again = synth.plan(**SMALL_PLAN)
    np.testing.assert_array_equal(again[3].rig.cam_from_world, plan[3].rig.cam_from_world)
    assert again[3].figures == plan[3].figures


def test_cameras_that_exist_are_chosen_from(tmp_path):
    done = run(tmp_path, "plan", *SMALL[:1], *SMALL[2:], "rig=shelf", "views=[3,3]", "out=plan")
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
        (["views=[1]"], "views: expected [least, greatest], a number from 2"),
        (["views=[1,4]"], "views: expected [least, greatest], a number from 2"),
        (["views=[5,4]"], "views: expected [least, greatest]"),
        (["views=[4,40]"], "to 32"),
        (["mount.places=3", "views=[4,4]"], "raise mount.places"),
        (["rig=shelf", "views=[4,6]"], "there are 5 cameras in the rig"),
        (["mount.walls=[2,9]"], "m high"),
        (["mount.walls=[2]"], "mount.walls: expected [least, greatest], more than 0 m"),
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
