"""Coverage of the people's area, and faults of cameras, in simple geometry."""

import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from dmae.formats.calibrations import write_calibration
from dmae.formats.config import LengthUnit
from synth.errors import FailedSimulation
from synth.rigs.config import CameraConfig, RigConfig, RingConfig
from synth.rigs.coverage import Stage, area, check_outside, check_rig, find_faults, meeting_point, views_of_cells
from synth.rigs.rig import make_rig
from tests.support.rigs import points_in_area, preset


def room(tmp_path, things: str) -> Stage:
    path = tmp_path / "room.xml"
    path.write_text(f'<mujoco><worldbody><geom name="floor" type="plane" size="9 9 .1"/>{things}</worldbody></mujoco>')
    return Stage(1.9, path)


def test_the_cells_hold_the_whole_area():
    corners = area(Stage(1.9))
    assert corners[..., 2].min() == 0
    assert corners[..., 2].max() == 2
    # The outermost polygon's edges touch the circle.
    rim = corners[-1, :, 0, :2]
    np.testing.assert_allclose(np.linalg.norm((rim + np.roll(rim, 1, 0)) / 2, axis=1), 1.9)


@pytest.mark.parametrize("name", ["shelf", "campus", "studio5", "dome"])
def test_covered_cells_are_in_the_images(name):
    rig = preset(name)
    points = points_in_area(1.9)
    seen = rig.inside(rig.project(points)[0])[0].sum(0)
    assert seen.min() >= views_of_cells(rig, Stage(1.9)).min()


def test_a_rig_in_centimetres_is_refused():
    ring = RigConfig(ring=RingConfig(radius=[300, 400], height=[100, 270]))
    with pytest.raises(ValueError, match=r"people are at most \d\.\d px tall.*lengths of rigs are in metres$"):
        make_rig(ring, rng=np.random.default_rng(0))
    listed = CameraConfig("left", [320, 240], focal=220, position=[320, 20, 220], target=[0, 0, 1])
    with pytest.raises(ValueError, match=r"in camera 'left' people are at most 1\.0 px tall"):
        make_rig(RigConfig(cameras=[listed]), rng=np.random.default_rng(0))


@pytest.mark.parametrize(
    ("factor", "remedy"),
    [
        (100, r"in metres, and with rig\.unit=cm people have a usual size$"),
        (1000, r"in metres, and with rig\.unit=mm people have a usual size$"),
        (10**6, r"in metres, and rig\.unit=cm or rig\.unit=mm states another unit of a file$"),
    ],
)
@pytest.mark.parametrize("name", ["shelf", "ring"])
def test_the_unit_of_a_file_in_which_people_have_a_usual_size_is_named(name, factor, remedy, tmp_path):
    rig, moved = preset(name), np.array([2.0, -1.0, 0.0])
    cam_from_world = rig.cam_from_world.copy()
    cam_from_world[:, :3, 3] -= cam_from_world[:, :3, :3] @ moved  # the middle is at `moved` there
    cam_from_world[:, :3, 3] *= factor
    write_calibration(replace(rig, cam_from_world=cam_from_world), tmp_path / "rig.toml", "pose2sim")
    config = RigConfig(path=str(tmp_path / "rig.toml"), origin=moved.tolist())
    with pytest.raises(ValueError, match=remedy):
        make_rig(config, rng=np.random.default_rng(0))
    if factor < 10**6:
        unit = LengthUnit.cm if factor == 100 else LengthUnit.mm
        made = make_rig(replace(config, unit=unit), rng=np.random.default_rng(0))
        np.testing.assert_allclose(made.centers, rig.centers, atol=1e-3)
        with pytest.raises(ValueError, match=remedy):
            make_rig(replace(config, unit=LengthUnit.m), rng=np.random.default_rng(0))


@pytest.mark.parametrize(
    ("thing", "shape"),
    [
        ("box", 'type="box" size=".3 .2 .4" euler="10 20 30"'),
        ("sphere", 'type="sphere" size=".3"'),
        ("post", 'type="cylinder" size=".1 1"'),
        ("bar", 'type="capsule" size=".1 .5"'),
        ("egg", 'type="ellipsoid" size=".2 .3 .4"'),
    ],
)
def test_a_camera_inside_an_object_is_refused_with_both_names(thing, shape, tmp_path):
    rig = preset("shelf")
    at = " ".join(map(str, rig.centers[3]))
    stage = room(tmp_path, f'<body name="{thing}" pos="{at}"><geom {shape}/></body>')
    with pytest.raises(FailedSimulation, match=rf"rig 'mine': camera '3' at \(.*\) m is inside '{thing}'"):
        check_rig(rig, "rig 'mine'", stage)
    assert list(find_faults(rig, stage)) == [3]
    model = mujoco.MjModel.from_xml_path(str(stage.arena))
    with pytest.raises(FailedSimulation, match=rf"camera '3' is inside '{thing}'"):
        check_outside(rig, model, 256 + np.arange(model.ngeom))
    # People do not count.
    check_outside(rig, model, np.ones(model.ngeom, int))


def test_a_camera_beside_an_object_is_accepted(tmp_path):
    rig = preset("shelf")
    at = " ".join(map(str, rig.centers[3] + (0, 0, 0.31)))
    assert not find_faults(rig, room(tmp_path, f'<geom type="sphere" size=".3" pos="{at}"/>'))


def test_a_camera_that_looks_away_sees_no_people():
    rig = preset("ring")
    turned = rig.cam_from_world.copy()
    turned[2] = np.diag([-1.0, 1, -1, 1]) @ turned[2]
    with pytest.raises(
        FailedSimulation, match=r"'ring2'.*sees no people: its image holds no point of the people's area"
    ):
        check_rig(replace(rig, cam_from_world=turned), "rig", Stage(1.9))


def test_walls_hide_people_and_planes_only_from_one_side(tmp_path):
    camera = CameraConfig("out", [640, 480], focal=500.0, position=[6.0, 0, 1.5], target=[0.0, 0, 1])
    rig = make_rig(RigConfig(cameras=[camera]), rng=np.random.default_rng(0))
    wall = '<geom name="wall" pos="4 0 2" type="box" size=".1 5 2"/>'
    with pytest.raises(FailedSimulation, match=r"'out'.*sees no people: 'wall' is between"):
        check_rig(rig, "rig", room(tmp_path, wall))
    assert not find_faults(rig, room(tmp_path, '<geom type="plane" pos="4 0 2" size="5 2 .1" euler="0 -90 0"/>'))
    # A gap to look through is enough.
    assert not find_faults(rig, room(tmp_path, wall.replace('pos="4 0 2"', 'pos="4 4.8 2"')))


def test_the_axes_of_a_ring_meet_at_its_target():
    rig = preset("ring")
    np.testing.assert_allclose(meeting_point(rig), (0, 0, 0.9), atol=1e-9)
    assert meeting_point(rig[:1]) is None


def test_cameras_that_look_elsewhere_are_answered_with_the_origin_to_set(data_folder):
    path = str(data_folder / "rigs" / "calibration_campus.json")
    with pytest.raises(FailedSimulation, match=r"sees no people.*axes meet at about \(.*set rig\.origin=\[") as failure:
        make_rig(RigConfig(path=path, size=[360, 288]), rng=np.random.default_rng(0))
    x, y, z = map(float, re.search(r"set rig\.origin=\[(.*),(.*),(.*)\]", str(failure.value)).groups())
    np.testing.assert_allclose((x, y, z), (1.85, 4.76, 0), atol=0.05)
    make_rig(RigConfig(path=path, size=[360, 288], origin=[x, y, z]), rng=np.random.default_rng(0))
