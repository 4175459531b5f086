"""Scenes: one model of room, props and people, with an id for every geom and visible surfaces that stop rays."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from dmae.data.images import FIRST_OBJECT_ID
from dmae.data.labels import Visibility
from dmae.formats.rig import intrinsics
from synth.labels.visibility import joint_visibility
from synth.people.body import SKELETON, Body
from synth.people.clothing import HAIRSTYLES
from synth.people.mjcf import HIDDEN_GROUP
from synth.physics.simulation import simulate
from synth.rigs.placement import aimed
from synth.rooms.props import footprints
from synth.rooms.room import arena_file
from synth.scene.build import STEPS_PER_CONTROL, SUBSTEPS, build_scene
from synth.scene.spec import PropSpec
from tests.support.scenes import BODY, RIG, gliding, scene

PROPS = [PropSpec("screen", (1.5, 0.0), 1.0, (0.1, 0.8, 0.1)), PropSpec("chair", (-1.5, 0.0), 0.0, (0.8, 0.1, 0.1))]


@pytest.fixture(scope="module")
def built():
    return build_scene(scene([BODY, BODY], 25, props=PROPS, arena="office"), RIG)


def hit(built, data, start, direction) -> tuple[int, float]:
    """Id and distance of the first geom of any group that a ray meets."""
    geom = np.zeros(1, np.int32)
    distance = mujoco.mj_ray(built.model, data, np.array(start, float), np.array(direction, float), None, 1, -1, geom)
    return int(built.geom_ids[geom[0]]), float(distance)


def test_the_physics_options_are_those_that_were_measured(built):
    option = built.model.opt
    # MuJoCo 4.0.0 has a bug in sparse scenes of this size.
    assert option.jacobian == mujoco.mjtJacobian.mjJAC_DENSE
    assert mujoco.mj_isSparse(built.model) == 0
    assert option.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert option.timestep * SUBSTEPS * STEPS_PER_CONTROL == pytest.approx(1 / 25)
    assert option.timestep <= 0.0025


def test_every_object_has_a_name_and_every_person_an_id(built):
    assert built.objects[0] == "floor"
    assert {"wall_north", "shelf", "desk", "0/screen", "1/chair"} <= set(built.objects)
    shown = built.geom_ids[built.model.geom_group != HIDDEN_GROUP]
    assert set(shown) == {1, 2, *(FIRST_OBJECT_ID + k for k in range(len(built.objects)))}
    assert set(built.geom_persons) == {-1, 0, 1}
    assert (built.geom_ids[built.geom_persons < 0] >= FIRST_OBJECT_ID).all()


def test_the_model_has_the_cameras_of_the_rig(built):
    assert built.model.ncam == len(RIG)


def test_rays_meet_visible_surfaces_only(built):
    model = built.model
    data = mujoco.MjData(model)
    data.qpos[model.joint("person1/pelvis").qposadr[0] : model.joint("person1/pelvis").qposadr[0] + 2] = (0, -2)
    mujoco.mj_kinematics(model, data)
    chest = data.xpos[model.body("person0/chest").id]
    person, distance = hit(built, data, chest + np.array((1.0, 0, 0.1)), (-1, 0, 0))
    assert person == 1
    assert 0.8 < distance < 0.95, "the front of the chest, no deeper: the solid capsule inside stops no ray"
    assert hit(built, data, (0, -2, 3), (0, 0, -1))[0] == 2
    assert built.objects[hit(built, data, (0, 3.5, 1), (0, 0, -1))[0] - FIRST_OBJECT_ID] == "floor"
    assert built.objects[hit(built, data, (3.0, 0.0, 1.0), (-1, 0, 0))[0] - FIRST_OBJECT_ID] == "0/screen"


def test_solid_parts_lie_within_the_visible_surface(built):
    """A ray from outside meets the surface before the solid part, or at most 20 mm behind."""
    model = built.model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    solid = np.flatnonzero((built.geom_persons == 0) & (model.geom_group == HIDDEN_GROUP))
    excess = []
    for geom in solid:
        axes = data.geom_xmat[geom].reshape(3, 3)
        for angle in np.linspace(0, 2 * np.pi, 8, endpoint=False):
            out = axes[:, 0] * np.cos(angle) + axes[:, 1] * np.sin(angle)
            start = data.geom_xpos[geom] + 0.6 * out
            person, distance = hit(built, data, start, -out)
            excess.append(0.6 - model.geom_size[geom, 0] - distance if person == 1 else 0.0)
    assert np.percentile(excess, 5) > -0.02


@pytest.mark.parametrize("style", HAIRSTYLES)
@pytest.mark.parametrize("feminine", [0.0, 1.0])
def test_the_face_is_visible_from_the_front_and_not_from_behind(style, feminine):
    body = Body(1.7, 68, feminine)
    spec = scene([body], 1)
    person = replace(spec.persons[0], looks=replace(spec.persons[0].looks, hair=style))
    # Level cameras before and behind the person.
    size, centers, target = [1000, 1200], np.array([(3.0, 0, 1), (-3, 0, 1)]), np.array((0, 0, 1))
    rig = aimed(["before", "behind"], intrinsics(900, size), centers, target, size)
    simulation = simulate(replace(spec, persons=(person,)), rig, [gliding(body, 1, (0, 0), (0, 0))])
    front, back = joint_visibility(
        simulation.model, simulation.qpos, simulation.joints, simulation.depth, simulation.geom_ids, rig
    ).visibility[0, :, 0]
    hidden = {joint for joint, how in zip(SKELETON.joints, front, strict=True) if how != Visibility.VISIBLE}
    assert hidden <= {"body25.l_heel", "body25.r_heel"}
    shown = {joint for joint, how in zip(SKELETON.joints, back, strict=True) if how == Visibility.VISIBLE}
    assert not shown & {"body25.nose", "body25.l_eye", "body25.r_eye", "shelf14.top_head", "body25.l_big_toe"}
    assert {"body25.l_heel", "body25.r_heel", "body25.neck", "shelf14.l_hip", "body25.r_elbow"} <= shown


def test_people_have_the_mass_of_their_bodies(built):
    assert built.model.body_subtreemass[built.model.body("person0/pelvis").id] == pytest.approx(BODY.mass, rel=1e-3)


def test_obstacles_include_room_and_props(built):
    room = footprints(arena_file("office"))
    np.testing.assert_array_equal(built.obstacles[: len(room)], room)
    chair = built.obstacles[np.linalg.norm(built.obstacles[:, :2] - (-1.5, 0), axis=1) < 0.3]
    assert len(chair) and (chair[:, 2] < 0.6).all()


def test_a_body_in_t_pose_has_no_contact_with_itself(built):
    model, data = built.model, mujoco.MjData(built.model)
    mujoco.mj_forward(model, data)
    own = built.geom_persons[data.contact.geom] if data.ncon else np.empty((0, 2))
    assert not (own == 0).all(1).any(), "nothing of a body in T-pose touches itself"
    assert model.npair > 20


def test_paint_changes_images_only(built):
    """Without it the geoms, their shapes and the physics are the same to the last bit."""
    plain = build_scene(scene([BODY, BODY], 25, props=PROPS, arena="office"), RIG, painted=False)
    model, painted = plain.model, built.model
    assert model.ntexdata < painted.ntexdata
    for name in (
        "mesh_vert",
        "mesh_face",
        "geom_pos",
        "geom_quat",
        "geom_size",
        "body_inertia",
        "geom_matid",
        "bvh_aabb",
    ):
        np.testing.assert_array_equal(getattr(model, name), getattr(painted, name), err_msg=name)
    np.testing.assert_array_equal(plain.geom_ids, built.geom_ids)
    assert plain.objects == built.objects
