"""Places for cameras: on walls, under ceilings, on tripods; and rooms that have none."""

import numpy as np
import pytest

from synth.planning.config import LensConfig, MountConfig
from synth.planning.places import aimed_cameras, find_places, stage_of
from synth.rooms.room import arena_file, room_choices

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
