"""Visibility of joints: hidden by exactly what is in front of them."""

import mujoco
import numpy as np
import pytest

from dmae.data.cameras import CameraRig
from dmae.data.labels import Visibility
from synth.labels.visibility import joint_visibility
from synth.people.body import SKELETON, Body, body_at
from synth.physics.simulation import simulate
from synth.rigs.config import RigConfig, RingConfig
from synth.rigs.rig import make_rig
from tests.support import scenes
from tests.support.standing_people import DEPTH, POINTS, looking_along_x, scene

VISIBLE, SELF, PERSON, OBJECT, OUTSIDE, BEHIND, ABSENT = Visibility


def look(rig, places, objects="", shift=0.0):
    model, ids, joints = scene(rig, places, objects)
    qpos = model.qpos0[None].copy()
    for person in range(len(places)):
        qpos[0, 7 * person] += shift
    joints[..., 0] += shift
    return joint_visibility(model, qpos, joints, np.tile(DEPTH, (len(places), 1)), ids, rig)


def test_a_person_alone_is_visible_from_the_front():
    seen = look(looking_along_x((-4, 0, 1)), [(0, 0)])
    assert seen.visibility.shape == (1, 1, 1, 6)
    assert (seen.visibility == VISIBLE).all()
    assert (seen.occluder == -1).all()


def test_a_body_hides_its_far_hand_and_foot_from_the_side():
    rig = looking_along_x((-4, 0, 1))
    quarter = np.eye(4)
    quarter[:2, :2] = [[0, 1], [-1, 0]]
    rig = CameraRig(rig.names, rig.K, rig.dist, rig.cam_from_world @ quarter, rig.size)
    np.testing.assert_allclose(rig.centers, [[0, -4, 1]], atol=1e-12)
    seen = look(rig, [(0, 0)])
    # The near arm lies before the chest, the near leg before the far one.
    assert seen.visibility[0, 0, 0].tolist() == [VISIBLE, SELF, SELF, VISIBLE, SELF, VISIBLE]
    assert seen.occluder[0, 0, 0].tolist() == [-1, 0, 0, -1, 0, -1]


def test_a_wall_hides_joints_below_its_edge_and_is_their_occluder():
    walls = (
        '<geom name="low" type="box" pos="-1.5 0 .5" size=".1 2 .5"/>'
        '<geom name="far" type="box" pos="3 0 1" size=".1 2 1"/>'
    )
    seen = look(looking_along_x((-4, 0, 1)), [(0, 0), (4, 1.5)], walls)
    assert seen.visibility[0, 0, 0].tolist() == [VISIBLE, VISIBLE, OBJECT, OBJECT, OBJECT, OBJECT]
    assert seen.occluder[0, 0, 0].tolist() == [-1, -1, 0, 0, 0, 0]
    assert seen.visibility[0, 0, 1].tolist() == [OBJECT] * 6
    assert seen.occluder[0, 0, 1].tolist() == [1, 1, 0, 0, 0, 0]


def test_a_person_hides_another_behind_where_they_overlap():
    seen = look(looking_along_x((-4, 0, 1.2)), [(0, 0), (8, 0), (2, 1.2)])
    assert seen.visibility[0, 0].tolist() == [[VISIBLE] * 6, [PERSON] * 6, [VISIBLE] * 6]
    assert seen.occluder[0, 0].tolist() == [[-1] * 6, [0] * 6, [-1] * 6]
    # From higher up the far one's head shows over the near one.
    seen = look(looking_along_x((-4, 0, 2.0)), [(8, 0), (0, 0)])
    assert seen.visibility[0, 0, 0].tolist() == [VISIBLE] + [PERSON] * 5
    assert seen.occluder[0, 0, 0].tolist() == [-1] + [1] * 5


def test_a_pillar_hides_the_half_of_a_body_that_it_covers():
    # From 4 m the edge at y = 0.03, half way, covers all to the left of y = 0.06.
    pillar = '<geom name="pillar" type="box" pos="-2 .28 1" size=".05 .25 1"/>'
    seen = look(looking_along_x((-4, 0, 1)), [(0, 0)], pillar)
    assert seen.visibility[0, 0, 0].tolist() == [VISIBLE, VISIBLE, OBJECT, VISIBLE, OBJECT, VISIBLE]
    assert seen.occluder[0, 0, 0].tolist() == [-1, -1, 0, -1, 0, -1]
    # A round one of the same breadth, seen from the other side, covers the other half.
    pillar = '<geom name="pillar" type="cylinder" pos="-2 -.28 1" size=".25 1"/>'
    seen = look(looking_along_x((-4, 0, 1)), [(0, 0)], pillar)
    assert seen.visibility[0, 0, 0].tolist() == [VISIBLE, VISIBLE, VISIBLE, OBJECT, VISIBLE, OBJECT]


def test_the_margin_is_the_distance_from_occluder_to_joint():
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
    """Return the visibility of one joint of a person with a chest (body 1), an upper arm (2) and a forearm (3)."""
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


def test_an_arm_behind_the_torso_is_hidden_and_one_in_front_is_not():
    for side, code in ((0.4, SELF), (-0.4, VISIBLE)):
        wrist = np.array([0, 0.25, 1.5]) + (side, -0.15, -0.1)
        assert jointed((-4, 0, 1.3), f"{side} -.15 -.1", "0 -.1 -.1", wrist, 3, 0.06) == code


def test_a_joint_deep_within_its_limb_is_hidden_only_by_other_limbs():
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


def test_visibility_follows_the_state_of_the_scene():
    wall = '<geom name="wall" type="box" pos="2 0 1" size=".1 2 1"/>'
    rig = looking_along_x((-4, 0, 1))
    assert (look(rig, [(4, 0)], wall).visibility == OBJECT).all()
    assert (look(rig, [(4, 0)], wall, shift=-3.0).visibility == VISIBLE).all()


def test_joints_outside_the_image_or_behind_the_camera_have_no_occluder():
    objects = (
        '<geom name="wall" type="box" pos="1 0 1" size=".1 9 2"/>'
        '<geom name="back" type="box" pos="-2 0 1" size=".1 9 2"/>'
    )
    seen = look(looking_along_x((0, 0, 1)), [(3, 0), (3, 2.5), (-3, 0), (1.7, 0)], objects)
    assert seen.visibility[0, 0, :3].tolist() == [[OBJECT] * 6, [OUTSIDE] * 6, [BEHIND] * 6]
    # Near by, feet and head do not fit into the image.
    assert seen.visibility[0, 0, 3].tolist() == [OBJECT] * 4 + [OUTSIDE] * 2
    assert (seen.occluder[0, 0, 1:3] == -1).all()


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
    seen = joint_visibility(model, qpos, joints, np.tile(DEPTH, (2, 1)), ids, rig)
    assert (seen.visibility[1, :, 0] == ABSENT).all()
    assert (seen.visibility[0] != ABSENT).all()
    assert (seen.occluder[1, :, 0] == -1).all()


def test_floors_and_transparent_geoms_hide_nothing():
    rig = looking_along_x((-4, 0, 1))
    glass = '<geom name="glass" type="box" pos="-2 0 1" size=".1 2 1" rgba="1 1 1 {}"/>'
    assert (look(rig, [(0, 0)], glass.format(0)).visibility == VISIBLE).all()
    assert (look(rig, [(0, 0)], glass.format(0.1)).visibility == OBJECT).all()
    model, ids, joints = scene(rig, [(0, 0)])
    joints[0, 0, 4:, 2] = -0.01
    seen = joint_visibility(model, model.qpos0[None], joints, DEPTH[None], ids, rig)
    assert (seen.visibility == VISIBLE).all()


def test_a_camera_within_an_object_sees_nothing_through_it():
    box = '<geom name="box" type="box" pos="-4 0 1" size=".3 .3 .3"/>'
    seen = look(looking_along_x((-4, 0, 1)), [(0, 0)], box)
    assert (seen.visibility == OBJECT).all()
    assert (seen.occluder == 0).all()
    # Within the chest of the first man.
    seen = look(looking_along_x((-0.1, 0, 1.2)), [(0, 0), (3, 0)])
    assert (seen.visibility[0, 0, 1] == PERSON).all()
    assert (seen.occluder[0, 0, 1] == 0).all()


def test_moving_scene_and_cameras_together_changes_nothing():
    rng = np.random.default_rng(3)
    places = [tuple(place) for place in rng.uniform(-1.5, 1.5, (4, 2))]
    rig = make_rig(RigConfig(), rng=rng)
    here = look(rig, places)
    pose = rig.cam_from_world.copy()
    pose[:, :3, 3] -= pose[:, :3, :3] @ (7, -3, 0)
    there = look(CameraRig(rig.names, rig.K, rig.dist, pose, rig.size), [(x + 7, y - 3) for x, y in places])
    for name in ("visibility", "occluder", "depth_margin"):
        np.testing.assert_array_equal(getattr(here, name), getattr(there, name))
    assert len(np.unique(here.visibility)) > 2


@pytest.mark.parametrize("view", [0, 2])
def test_views_do_not_depend_on_each_other(view):
    rng = np.random.default_rng(5)
    places = [tuple(place) for place in rng.uniform(-1.5, 1.5, (3, 2))]
    rig = make_rig(RigConfig(), rng=rng)
    whole, part = look(rig, places), look(rig[view : view + 1], places)
    for name in ("visibility", "occluder", "depth_margin"):
        np.testing.assert_array_equal(getattr(whole, name)[:, view : view + 1], getattr(part, name))


@pytest.mark.parametrize("body", [Body(), Body(1.65, 60, 1.0), Body(1.85, 100), body_at(0, 5), body_at(1, 9)])
def test_joints_of_an_upright_person_are_visible_through_their_skin(body):
    rig = make_rig(RigConfig(ring=RingConfig(views=16, radius=[4, 4], height=[1.6, 1.6])), rng=np.random.default_rng(0))
    simulation = simulate(scenes.scene([body], 2), rig, [scenes.gliding(body, 2, (0, 0), (1, 0))])
    seen = joint_visibility(
        simulation.model, simulation.qpos[:1], simulation.joints[:1], simulation.depth, simulation.geom_ids, rig,
        simulation.bodies,
    ).visibility[0, :, 0]  # fmt: skip
    towards = np.degrees(np.abs(np.arctan2(rig.centers[:, 1], rig.centers[:, 0])))
    front, back, side = towards < 40, towards > 140, np.abs(towards - 90) < 30
    names = [f"body25.{name}" for name in ("neck", "mid_hip", "l_shoulder", "r_hip", "l_elbow", "r_knee", "l_ankle")]
    limbs = [SKELETON.joints.index(name) for name in (*names, "shelf14.bottom_head")]
    assert (seen[front][:, limbs] == VISIBLE).all()
    assert (seen[back][:, limbs] == VISIBLE).all()
    # Shoulders and all are one with the trunk; what hangs at its side is not.
    trunk = SKELETON.index("body25.neck", "shelf14.bottom_head")
    assert (seen[side][:, trunk] == VISIBLE).all()
    face = SKELETON.index("body25.nose", "body25.l_eye", "body25.r_eye")
    assert (seen[front][:, face] == VISIBLE).all()
    assert (seen[back][:, face] == SELF).all()
    heels = SKELETON.index("body25.l_heel", "body25.r_heel")
    assert (seen[back][:, heels] == VISIBLE).all()


def test_blocks_of_rays_do_not_change_the_labels(monkeypatch):
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
    monkeypatch.setattr("synth.labels.visibility._RAYS_AT_ONCE", 50)
    blocks = joint_visibility(model, qpos, joints, depth, ids, rig)
    for name in ("visibility", "occluder", "depth_margin"):
        whole, part, both = (getattr(labels, name) for labels in (expected, blocks, twice))
        np.testing.assert_array_equal(part, whole)
        np.testing.assert_array_equal(both, np.tile(whole, 2))
