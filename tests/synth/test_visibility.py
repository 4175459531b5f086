"""Visibility: what must hide a joint does, and nothing else; images say the same."""

import mujoco
import numpy as np
import pytest

from dmae.cameras import CameraRig
from dmae.clip import Visibility
from synth.rigs import RigConfig, add_cameras, make_rig
from synth.visibility import joint_visibility

VISIBLE, SELF, PERSON, OBJECT, OUTSIDE, BEHIND, ABSENT = Visibility
MAN = """
<body name="man{index}" pos="{x} {y} 0"><freejoint/>
  <geom type="capsule" fromto="0 0 .9 0 0 1.4" size=".16"/>
  <geom type="sphere" pos="0 0 1.65" size=".11"/>
  <geom type="capsule" fromto="0 .1 .07 0 .1 .85" size=".07"/>
  <geom type="capsule" fromto="0 -.1 .07 0 -.1 .85" size=".07"/>
  <geom type="capsule" fromto="0 .24 .8 0 .24 1.4" size=".05"/>
  <geom type="capsule" fromto="0 -.24 .8 0 -.24 1.4" size=".05"/>
</body>
"""
# Head, chest, left and right hand, left and right foot of a man at the origin, each in the middle of its limb.
POINTS = np.array([[0, 0, 1.65], [0, 0, 1.2], [0, 0.24, 0.8], [0, -0.24, 0.8], [0, 0.1, 0.07], [0, -0.1, 0.07]])
DEPTH = np.array([0.11, 0.16, 0.05, 0.05, 0.07, 0.07]) + 0.01


def looking_along_x(*centers) -> CameraRig:
    """Level 640 x 480 cameras of 500 px focal length at the centres, looking along +x; image right is -y."""
    R = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
    pose = np.tile(np.eye(4), (len(centers), 1, 1))
    pose[:, :3, :3], pose[:, :3, 3] = R, -np.array(centers, float) @ R.T
    K = np.tile([[500.0, 0, 319.5], [0, 500, 239.5], [0, 0, 1]], (len(centers), 1, 1))
    names = [f"c{i}" for i in range(len(centers))]
    return CameraRig(names, K, np.zeros((len(centers), 5)), pose, np.tile([640, 480], (len(centers), 1)))


def scene(rig: CameraRig, men: list, things: str = "") -> tuple[mujoco.MjModel, np.ndarray, np.ndarray]:
    """Men standing at (x, y) on a floor among things, each named geom an object.

    Returns:
        The model, the geoms' ids and the men's points (1, P, 6, 3).
    """
    bodies = "".join(MAN.format(index=i, x=x, y=y) for i, (x, y) in enumerate(men))
    spec = mujoco.MjSpec.from_string(
        '<mujoco><worldbody><light pos="0 0 4"/><geom type="plane" size="9 9 .1" rgba=".5 .5 .5 1"/>'
        f"{things}{bodies}</worldbody></mujoco>"
    )
    add_cameras(spec, rig)
    model = spec.compile()
    ids, things = np.zeros(model.ngeom, np.uint16), 0
    for geom in range(model.ngeom):
        if model.geom(geom).name:
            ids[geom], things = 256 + things, things + 1
        elif model.geom_bodyid[geom]:
            ids[geom] = model.geom_bodyid[geom]
    return model, ids, np.array([POINTS + np.array([x, y, 0]) for x, y in men])[None]


def look(rig, men, things="", shift=0.0):
    model, ids, joints = scene(rig, men, things)
    qpos = model.qpos0[None].copy()
    for man in range(len(men)):
        qpos[0, 7 * man] += shift
    joints[..., 0] += shift
    return joint_visibility(model, qpos, joints, np.tile(DEPTH, (len(men), 1)), ids, rig)


def test_a_man_alone_is_seen_whole_from_in_front():
    visibility, hidden_by = look(looking_along_x((-4, 0, 1)), [(0, 0)])
    assert visibility.shape == (1, 1, 1, 6)
    assert (visibility == VISIBLE).all()
    assert (hidden_by == -1).all()


def test_a_man_s_body_hides_his_far_hand_and_foot_from_the_side():
    rig = looking_along_x((-4, 0, 1))
    quarter = np.eye(4)
    quarter[:2, :2] = [[0, 1], [-1, 0]]
    rig = CameraRig(rig.names, rig.K, rig.dist, rig.cam_from_world @ quarter, rig.size)
    np.testing.assert_allclose(rig.centers, [[0, -4, 1]], atol=1e-12)
    visibility, hidden_by = look(rig, [(0, 0)])
    # The near arm lies before the chest, the near leg before the far one.
    assert visibility[0, 0, 0].tolist() == [VISIBLE, SELF, SELF, VISIBLE, SELF, VISIBLE]
    assert hidden_by[0, 0, 0].tolist() == [-1, 0, 0, -1, 0, -1]


def test_a_wall_hides_what_is_below_its_edge_and_says_which_wall():
    walls = (
        '<geom name="low" type="box" pos="-1.5 0 .5" size=".1 2 .5"/>'
        '<geom name="far" type="box" pos="3 0 1" size=".1 2 1"/>'
    )
    visibility, hidden_by = look(looking_along_x((-4, 0, 1)), [(0, 0), (4, 1.5)], walls)
    assert visibility[0, 0, 0].tolist() == [VISIBLE, VISIBLE, OBJECT, OBJECT, OBJECT, OBJECT]
    assert hidden_by[0, 0, 0].tolist() == [-1, -1, 0, 0, 0, 0]
    assert visibility[0, 0, 1].tolist() == [OBJECT] * 6
    assert hidden_by[0, 0, 1].tolist() == [1, 1, 0, 0, 0, 0]


def test_a_man_behind_a_man_is_hidden_by_him_where_he_is_covered():
    visibility, hidden_by = look(looking_along_x((-4, 0, 1.2)), [(0, 0), (8, 0), (2, 1.2)])
    assert visibility[0, 0].tolist() == [[VISIBLE] * 6, [PERSON] * 6, [VISIBLE] * 6]
    assert hidden_by[0, 0].tolist() == [[-1] * 6, [0] * 6, [-1] * 6]
    # From higher up the far one's head shows over the near one.
    visibility, hidden_by = look(looking_along_x((-4, 0, 2.0)), [(8, 0), (0, 0)])
    assert visibility[0, 0, 0].tolist() == [VISIBLE] + [PERSON] * 5
    assert hidden_by[0, 0, 0].tolist() == [-1] + [1] * 5


def test_the_state_moves_people_away_from_what_hid_them():
    wall = '<geom name="wall" type="box" pos="2 0 1" size=".1 2 1"/>'
    rig = looking_along_x((-4, 0, 1))
    assert (look(rig, [(4, 0)], wall)[0] == OBJECT).all()
    assert (look(rig, [(4, 0)], wall, shift=-3.0)[0] == VISIBLE).all()


def test_what_is_outside_the_image_or_behind_is_not_asked_what_hides_it():
    things = (
        '<geom name="wall" type="box" pos="1 0 1" size=".1 9 2"/>'
        '<geom name="back" type="box" pos="-2 0 1" size=".1 9 2"/>'
    )
    visibility, hidden_by = look(looking_along_x((0, 0, 1)), [(3, 0), (3, 2.5), (-3, 0), (1.7, 0)], things)
    assert visibility[0, 0, :3].tolist() == [[OBJECT] * 6, [OUTSIDE] * 6, [BEHIND] * 6]
    # Near by, feet and head do not fit into the image.
    assert visibility[0, 0, 3].tolist() == [OBJECT] * 4 + [OUTSIDE] * 2
    assert (hidden_by[0, 0, 1:3] == -1).all()


def test_the_border_of_the_image_is_the_outer_edge_of_its_pixels():
    rig = looking_along_x((-2, 0, 1))
    for offset, code in ((-0.499, VISIBLE), (-0.501, OUTSIDE)):
        y = (319.5 - offset) / 500 * 2
        visibility, _ = joint_visibility(
            *_nothing(rig), np.array([[[[0, y, 1.0]]]]), np.zeros((1, 1)), np.zeros(1, np.uint16), rig
        )
        assert visibility.item() == code


def _nothing(rig):
    model = scene(rig, [])[0]
    return model, np.zeros((1, 0))


def test_an_absent_person_is_absent_everywhere():
    rig = looking_along_x((-4, 0, 1), (-3, 1, 1))
    model, ids, joints = scene(rig, [(0, 0), (2, 1)])
    joints = np.repeat(joints, 2, 0)
    joints[1, 0] = np.nan
    qpos = np.repeat(model.qpos0[None], 2, 0)
    qpos[1, 2] = -50
    visibility, hidden_by = joint_visibility(model, qpos, joints, np.tile(DEPTH, (2, 1)), ids, rig)
    assert (visibility[1, :, 0] == ABSENT).all()
    assert (visibility[0] != ABSENT).all()
    assert (hidden_by[1, :, 0] == -1).all()


def test_floors_and_what_is_transparent_hide_nothing():
    rig = looking_along_x((-4, 0, 1))
    glass = '<geom name="glass" type="box" pos="-2 0 1" size=".1 2 1" rgba="1 1 1 {}"/>'
    assert (look(rig, [(0, 0)], glass.format(0))[0] == VISIBLE).all()
    assert (look(rig, [(0, 0)], glass.format(0.1))[0] == OBJECT).all()
    model, ids, joints = scene(rig, [(0, 0)])
    joints[0, 0, 4:, 2] = -0.01
    visibility, _ = joint_visibility(model, model.qpos0[None], joints, DEPTH[None], ids, rig)
    assert (visibility == VISIBLE).all()


def test_a_camera_within_something_sees_nothing_through_it():
    box = '<geom name="box" type="box" pos="-4 0 1" size=".3 .3 .3"/>'
    visibility, hidden_by = look(looking_along_x((-4, 0, 1)), [(0, 0)], box)
    assert (visibility == OBJECT).all()
    assert (hidden_by == 0).all()
    # Within the chest of the first man.
    visibility, hidden_by = look(looking_along_x((-0.1, 0, 1.2)), [(0, 0), (3, 0)])
    assert (visibility[0, 0, 1] == PERSON).all()
    assert (hidden_by[0, 0, 1] == 0).all()


def test_moving_scene_and_cameras_together_changes_nothing():
    rng = np.random.default_rng(3)
    men = [tuple(place) for place in rng.uniform(-1.5, 1.5, (4, 2))]
    rig = make_rig(RigConfig(), rng=rng)
    here = look(rig, men)
    pose = rig.cam_from_world.copy()
    pose[:, :3, 3] -= pose[:, :3, :3] @ (7, -3, 0)
    there = look(CameraRig(rig.names, rig.K, rig.dist, pose, rig.size), [(x + 7, y - 3) for x, y in men])
    for a, b in zip(here, there, strict=True):
        np.testing.assert_array_equal(a, b)
    assert len(np.unique(here[0])) > 2


@pytest.mark.parametrize("view", [0, 2])
def test_views_do_not_depend_on_each_other(view):
    rng = np.random.default_rng(5)
    men = [tuple(place) for place in rng.uniform(-1.5, 1.5, (3, 2))]
    rig = make_rig(RigConfig(), rng=rng)
    whole, part = look(rig, men), look(rig[view : view + 1], men)
    for a, b in zip(whole, part, strict=True):
        np.testing.assert_array_equal(a[:, view : view + 1], b)
