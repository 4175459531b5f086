"""Visibility: what must hide a joint does, and nothing else; images say the same."""

import mujoco
import numpy as np
import pytest

from dmae.cameras import CameraRig
from dmae.clip import Visibility
from synth.anthropometry import body_at
from synth.body import Body
from synth.lens import add_cameras
from synth.rigs import RigConfig, make_rig
from synth.simulate import simulate_motions
from synth.stands import RingConfig
from synth.visibility import joint_visibility

from . import people

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
    visibility, hidden_by, _ = look(looking_along_x((-4, 0, 1)), [(0, 0)])
    assert visibility.shape == (1, 1, 1, 6)
    assert (visibility == VISIBLE).all()
    assert (hidden_by == -1).all()


def test_a_man_s_body_hides_his_far_hand_and_foot_from_the_side():
    rig = looking_along_x((-4, 0, 1))
    quarter = np.eye(4)
    quarter[:2, :2] = [[0, 1], [-1, 0]]
    rig = CameraRig(rig.names, rig.K, rig.dist, rig.cam_from_world @ quarter, rig.size)
    np.testing.assert_allclose(rig.centers, [[0, -4, 1]], atol=1e-12)
    visibility, hidden_by, _ = look(rig, [(0, 0)])
    # The near arm lies before the chest, the near leg before the far one.
    assert visibility[0, 0, 0].tolist() == [VISIBLE, SELF, SELF, VISIBLE, SELF, VISIBLE]
    assert hidden_by[0, 0, 0].tolist() == [-1, 0, 0, -1, 0, -1]


def test_a_wall_hides_what_is_below_its_edge_and_says_which_wall():
    walls = (
        '<geom name="low" type="box" pos="-1.5 0 .5" size=".1 2 .5"/>'
        '<geom name="far" type="box" pos="3 0 1" size=".1 2 1"/>'
    )
    visibility, hidden_by, _ = look(looking_along_x((-4, 0, 1)), [(0, 0), (4, 1.5)], walls)
    assert visibility[0, 0, 0].tolist() == [VISIBLE, VISIBLE, OBJECT, OBJECT, OBJECT, OBJECT]
    assert hidden_by[0, 0, 0].tolist() == [-1, -1, 0, 0, 0, 0]
    assert visibility[0, 0, 1].tolist() == [OBJECT] * 6
    assert hidden_by[0, 0, 1].tolist() == [1, 1, 0, 0, 0, 0]


def test_a_man_behind_a_man_is_hidden_by_him_where_he_is_covered():
    visibility, hidden_by, _ = look(looking_along_x((-4, 0, 1.2)), [(0, 0), (8, 0), (2, 1.2)])
    assert visibility[0, 0].tolist() == [[VISIBLE] * 6, [PERSON] * 6, [VISIBLE] * 6]
    assert hidden_by[0, 0].tolist() == [[-1] * 6, [0] * 6, [-1] * 6]
    # From higher up the far one's head shows over the near one.
    visibility, hidden_by, _ = look(looking_along_x((-4, 0, 2.0)), [(8, 0), (0, 0)])
    assert visibility[0, 0, 0].tolist() == [VISIBLE] + [PERSON] * 5
    assert hidden_by[0, 0, 0].tolist() == [-1] + [1] * 5


def test_a_pillar_hides_the_half_of_a_body_that_it_covers():
    # From 4 m the edge at y = 0.03, half way, covers all to the left of y = 0.06.
    pillar = '<geom name="pillar" type="box" pos="-2 .28 1" size=".05 .25 1"/>'
    seen = look(looking_along_x((-4, 0, 1)), [(0, 0)], pillar)
    assert seen.visibility[0, 0, 0].tolist() == [VISIBLE, VISIBLE, OBJECT, VISIBLE, OBJECT, VISIBLE]
    assert seen.hidden_by[0, 0, 0].tolist() == [-1, -1, 0, -1, 0, -1]
    # A round one of the same breadth, seen from the other side, covers the other half.
    pillar = '<geom name="pillar" type="cylinder" pos="-2 -.28 1" size=".25 1"/>'
    seen = look(looking_along_x((-4, 0, 1)), [(0, 0)], pillar)
    assert seen.visibility[0, 0, 0].tolist() == [VISIBLE, VISIBLE, VISIBLE, OBJECT, VISIBLE, OBJECT]


def test_the_margin_is_how_far_before_the_joint_that_begins_which_hides_it():
    wall = '<geom name="wall" type="box" pos="-2 0 .5" size=".05 2 .5"/>'
    seen = look(looking_along_x((-4, 0, 1)), [(0, 0)], wall)
    reach = np.linalg.norm(POINTS - (-4, 0, 1), axis=-1)
    # The wall's face is 1.95 m ahead and the joints 4 m.
    np.testing.assert_allclose(seen.depth_margin[0, 0, 0, 2:], reach[2:] * (1 - 1.95 / 4), rtol=1e-6)
    assert np.isnan(seen.depth_margin[0, 0, 0, :2]).all()
    # The chest of the near man is a capsule of 0.16 m around (0, 0).
    seen = look(looking_along_x((-4, 0, 1.2)), [(0, 0), (2, 0)])
    np.testing.assert_allclose(seen.depth_margin[0, 0, 1, 1], 2.16, atol=1e-4)
    # A camera within a thing has it before all the way.
    box = '<geom name="box" type="box" pos="-4 0 1" size=".3 .3 .3"/>'
    seen = look(looking_along_x((-4, 0, 1)), [(0, 0)], box)
    np.testing.assert_allclose(seen.depth_margin[0, 0, 0], reach, rtol=1e-6)


JOINTED = """
<body name="chest" pos="0 0 1.3"><freejoint/><geom type="box" size=".1 .2 .3"/>
  <body name="upper_arm" pos="0 .25 .2"><joint type="ball"/><geom type="capsule" fromto="0 0 0 {upper}" size=".05"/>
    <body name="forearm" pos="{upper}"><joint type="ball"/>
      <geom type="capsule" fromto="0 0 0 {fore}" size=".04"/>
    </body>
  </body>
</body>
"""


def jointed(camera, upper: str, fore: str, joint, body: int, depth: float) -> int:
    """What a camera sees of one joint of somebody with a chest (body 1), an upper arm (2) and a forearm (3)."""
    rig = looking_along_x(camera)
    spec = mujoco.MjSpec.from_string(
        f"<mujoco><worldbody>{JOINTED.format(upper=upper, fore=fore)}</worldbody></mujoco>"
    )
    model = spec.compile()
    seen = joint_visibility(
        model, model.qpos0[None], np.array([[[joint]]], float), np.array([[depth]]), np.ones(model.ngeom, np.uint16),
        rig, np.array([[body]]),
    )  # fmt: skip
    return seen.visibility.item()


def test_an_arm_behind_its_own_torso_is_hidden_and_one_before_it_is_not():
    for side, code in ((0.4, SELF), (-0.4, VISIBLE)):
        wrist = np.array([0, 0.25, 1.5]) + (side, -0.15, -0.1)
        assert jointed((-4, 0, 1.3), f"{side} -.15 -.1", "0 -.1 -.1", wrist, 3, 0.06) == code


def test_a_joint_deep_within_its_limb_is_hidden_by_other_limbs_alone():
    # The spine, 0.1 m behind the front of the chest and 0.2 m within from the side.
    spine, hanging = (0, 0, 1.4), "0 0 -.3"
    assert jointed((-4, 0, 1.4), hanging, hanging, spine, 1, 0.15) == VISIBLE
    # A forearm 0.06 m before the chest is nearer than the depth allows for, but no part of it.
    assert jointed((-4, 0, 1.4), "-.2 0 -.1", "0 -.5 0", spine, 1, 0.35) == SELF
    # The upper arm is jointed to the chest: from the side it is part of what the spine lies in.
    assert jointed((-4, 0.25, 1.4), "-.2 -.25 -.1", "0 0 -.3", spine, 1, 0.35) == VISIBLE
    assert jointed((-4, 0.25, 1.4), "-.2 -.25 -.1", "0 0 -.3", spine, 1, 0.12) == SELF
    # A limb that touches the joint does not hide it.
    assert jointed((-4, 0, 1.3), "-.2 -.25 -.2", "0 0 -.1", (-0.15, 0, 1.3), 1, 0.35) == VISIBLE


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
    visibility, hidden_by, _ = look(looking_along_x((0, 0, 1)), [(3, 0), (3, 2.5), (-3, 0), (1.7, 0)], things)
    assert visibility[0, 0, :3].tolist() == [[OBJECT] * 6, [OUTSIDE] * 6, [BEHIND] * 6]
    # Near by, feet and head do not fit into the image.
    assert visibility[0, 0, 3].tolist() == [OBJECT] * 4 + [OUTSIDE] * 2
    assert (hidden_by[0, 0, 1:3] == -1).all()


def test_the_border_of_the_image_is_the_outer_edge_of_its_pixels():
    rig = looking_along_x((-2, 0, 1))
    edges = [(-0.499, 200), (639.499, 200), (300, -0.499), (300, 479.499), (-0.499, 479.499)]
    beyond = [(-0.501, 200), (639.501, 200), (300, -0.501), (300, 479.501), (-0.501, 479.499)]
    for pixels, code in ((edges, VISIBLE), (beyond, OUTSIDE)):
        u, v = np.array(pixels).T
        joints = np.stack([np.zeros(5), (319.5 - u) / 500 * 2, 1 + (239.5 - v) / 500 * 2], -1)[None, None]
        seen = joint_visibility(*_nothing(rig), joints, np.zeros((1, 5)), np.zeros(1, np.uint16), rig)
        assert (seen.visibility == code).all()


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
    visibility, hidden_by, _ = joint_visibility(model, qpos, joints, np.tile(DEPTH, (2, 1)), ids, rig)
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
    seen = joint_visibility(model, model.qpos0[None], joints, DEPTH[None], ids, rig)
    assert (seen.visibility == VISIBLE).all()


def test_a_camera_within_something_sees_nothing_through_it():
    box = '<geom name="box" type="box" pos="-4 0 1" size=".3 .3 .3"/>'
    visibility, hidden_by, _ = look(looking_along_x((-4, 0, 1)), [(0, 0)], box)
    assert (visibility == OBJECT).all()
    assert (hidden_by == 0).all()
    # Within the chest of the first man.
    visibility, hidden_by, _ = look(looking_along_x((-0.1, 0, 1.2)), [(0, 0), (3, 0)])
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


@pytest.mark.parametrize("body", [Body(), Body(1.65, 60, 1.0), Body(1.85, 100), body_at(0, 5), body_at(1, 9)])
def test_the_joints_of_somebody_upright_are_seen_through_the_skin_they_lie_under(body):
    rig = make_rig(RigConfig(ring=RingConfig(views=16, radius=[4, 4], height=[1.6, 1.6])), rng=np.random.default_rng(0))
    simulation = simulate_motions(people.scene([body], 2), [people.gliding(body, 2, (0, 0), (1, 0))], rig)
    seen = joint_visibility(
        simulation.model, simulation.qpos[:1], simulation.joints[:1], simulation.depth, simulation.geom_ids, rig,
        simulation.bodies,
    ).visibility[0, :, 0]  # fmt: skip
    towards = np.degrees(np.abs(np.arctan2(rig.centers[:, 1], rig.centers[:, 0])))
    front, back, side = towards < 40, towards > 140, np.abs(towards - 90) < 30
    names = [f"body25.{name}" for name in ("neck", "mid_hip", "l_shoulder", "r_hip", "l_elbow", "r_knee", "l_ankle")]
    limbs = [simulation.skeleton.joints.index(name) for name in (*names, "shelf14.bottom_head")]
    assert (seen[front][:, limbs] == VISIBLE).all()
    assert (seen[back][:, limbs] == VISIBLE).all()
    # Shoulders and all are one with the trunk; what hangs at its side is not.
    trunk = simulation.skeleton.index("body25.neck", "shelf14.bottom_head")
    assert (seen[side][:, trunk] == VISIBLE).all()
    face = simulation.skeleton.index("body25.nose", "body25.l_eye", "body25.r_eye")
    assert (seen[front][:, face] == VISIBLE).all()
    assert (seen[back][:, face] == SELF).all()
    heels = simulation.skeleton.index("body25.l_heel", "body25.r_heel")
    assert (seen[back][:, heels] == VISIBLE).all()


def test_many_rays_are_as_good_as_few(monkeypatch):
    """Frames are judged in blocks; joints at one place, of which a skeleton of skeletons has many, by one ray."""
    rig = looking_along_x((-4, 0, 1), (-4, 0.5, 1.5))
    model, ids, joints = scene(rig, [(0, 0), (1, 0.2)], '<geom name="wall" type="box" pos="-1 -.5 1" size=".1 .5 1"/>')
    qpos, joints = np.tile(model.qpos0, (7, 1)), np.tile(joints, (7, 1, 1, 1))
    qpos[:, 7] += 0.1 * np.arange(7)
    joints[:, 1, :, 0] += 0.1 * np.arange(7)[:, None]
    joints[2, 0] = np.nan
    depth = np.tile(DEPTH, (2, 1))
    expected = joint_visibility(model, qpos, joints, depth, ids, rig)
    assert len(np.unique(expected.visibility)) > 2
    twice = joint_visibility(model, qpos, joints[:, :, [*range(6), *range(6)]], np.tile(depth, 2), ids, rig)
    monkeypatch.setattr("synth.visibility._RAYS_AT_ONCE", 50)
    blocks = joint_visibility(model, qpos, joints, depth, ids, rig)
    for whole, part, both in zip(expected, blocks, twice, strict=True):
        np.testing.assert_array_equal(part, whole)
        np.testing.assert_array_equal(both, np.tile(whole, 2))
