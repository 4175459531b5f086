"""Cloth bends in one piece, hands have shapes, and palms lie on the surfaces that they touch."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from synth.motion.geometry import reach_with_arm
from synth.people.body import Body, body_at
from synth.people.clothing import HANDS, Hat, PersonLooks, sample_hands, sample_looks
from synth.people.mjcf import add_person
from synth.people.skinning import Skin, mesh_triangles
from synth.rooms.rays import cast_rays
from tests.support.surfaces import in_t_pose

BODY, LOOKS = Body(), sample_looks(0.0, rng=np.random.default_rng(0))


@pytest.mark.parametrize("untucked", [True, False])
def test_cloth_of_a_bent_trunk_is_neither_torn_nor_turned_inside_out(untucked):
    spec = mujoco.MjSpec()
    add_person(spec, 0, BODY, replace(LOOKS, untucked=untucked), position=(0, 0, 0.95), rng=None)
    model = spec.compile()
    data, tops = mujoco.MjData(model), []
    straight = model.qpos0.copy()
    bent = straight.copy()
    for joint, bend in (("spine", 50), ("l_upper_arm", -70), ("r_thigh", -80)):
        at = model.joint(f"person0/{joint}").qposadr[0]
        axis = (1, 0, 0) if joint == "l_upper_arm" else (0, 1, 0)
        bent[at : at + 4] = Rotation.from_rotvec(np.radians(bend) * np.array(axis)).as_quat(scalar_first=True)
    for state in (straight, bent):
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        Skin(model).apply(data)
        geoms = [g for g in range(model.ngeom) if "/top" in model.geom(g).name or "/bottom" in model.geom(g).name]
        tops.append([
            mesh_triangles(model, g) @ data.geom_xmat[g].reshape(3, 3).T + data.geom_xpos[g] for g in geoms
        ])  # fmt: skip
    # Parts of a garment share the places of their common seams.
    names = [model.geom(g).name.split("/")[2].rstrip("0123456789") for g in geoms]
    for garment in ("top", "bottom"):
        before, after = (
            np.concatenate([part for part, name in zip(state, names, strict=True) if name == garment]).reshape(-1, 3)
            for state in tops
        )
        same = cKDTree(before).query_pairs(1e-6, output_type="ndarray")
        assert len(same) > 1000
        assert np.linalg.norm(after[same[:, 0]] - after[same[:, 1]], axis=1).max() < 1e-5
    before, after = (np.concatenate(state) for state in tops)
    long = [np.linalg.norm(each - np.roll(each, 1, axis=1), axis=-1) for each in (before, after)]
    assert np.percentile(long[1] / np.maximum(long[0], 0.002), 99) < 2.5


def test_nothing_bends_in_a_scene_without_people():
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    before = data.geom_xpos.copy()
    Skin(model).apply(data)
    np.testing.assert_array_equal(data.geom_xpos, before)


def test_a_fist_is_short_and_an_open_hand_wide():
    spans = {}
    for shape in HANDS:
        looks = replace(LOOKS, hands=(shape, "relaxed"))
        hand = [part.vertices for part in in_t_pose(BODY, looks) if (part.segment, part.material) == ("l_hand", "skin")]
        spans[shape] = np.ptp(np.concatenate(hand), axis=0)
    assert min(spans, key=lambda shape: spans[shape][1]) == "fist"
    assert max(spans, key=lambda shape: spans[shape][1]) == "open"
    assert spans["point"][1] > spans["fist"][1] + 0.02
    assert 0.17 < spans["open"][1] < 0.22


def test_hands_are_checked_drawn_and_default_to_relaxed():
    assert LOOKS.hands == ("relaxed", "relaxed")
    assert sample_hands(rng=np.random.default_rng(3)) == sample_hands(rng=np.random.default_rng(3))
    with pytest.raises(ValueError, match=r"expected two of relaxed, open, grip, fist, point"):
        replace(LOOKS, hands=("relaxed", "paw"))
    assert isinstance(LOOKS, PersonLooks)


def test_the_wrist_bends_so_that_the_palm_lies_on_a_table():
    chest, shoulder = np.eye(3)[None], np.array([[0.0, 0.2, 1.3]])
    down, palm = np.array([[0.0, 0.0, -1.0]]), np.array([[0.45, 0.2, 0.8]])
    how = (BODY, "l", chest, shoulder, palm, down, (-0.35, 0.45, -1.0))
    bent, straight = (reach_with_arm(*how, straight=straight)[0, 2] for straight in (False, True))
    assert -bent[:, 2] @ down[0] > 0.999
    assert -straight[:, 2] @ down[0] < 0.9


@pytest.mark.parametrize(
    "worn", [{"hair": "short"}, {"hair": "long"}, {"hat": Hat("cap", ((0.1, 0.1, 0.1), (0.2, 0.2, 0.2)))}]
)
def test_rays_in_one_call_meet_what_single_rays_meet(worn):
    """A body's box of the compiled model holds only its solid parts; clothes and hair reach beyond."""
    rng = np.random.default_rng(0)
    spec = mujoco.MjSpec()
    add_person(spec, 0, Body(), replace(sample_looks(0.0, rng=rng), **worn), position=(0, 0, 1), rng=None)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    Skin(model, normals=False).apply(data)
    eye, solid = np.array((3.0, 1.0, 1.5)), np.array((1, 0, 0, 0, 0, 0), np.uint8)
    ways = rng.normal((0, 0, 1), (0.1, 0.4, 0.5), (3000, 3)) - eye
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    geoms, distances, _ = cast_rays(model, data, eye, ways)
    met = np.zeros(1, np.int32)
    alone = [mujoco.mj_ray(model, data, eye, way, solid, 1, -1, met) for way in ways]
    assert (geoms >= 0).sum() > 300
    np.testing.assert_allclose(distances, alone, atol=1e-4)


@pytest.mark.parametrize("body", [Body(), body_at(1, 9)], ids=["man", "girl"])
def test_solids_that_fit_the_skin_leave_masses_where_they_are(body):
    """The reference is what MuJoCo computes from the capsules of the body's proportions."""
    found = []
    for each in (body, replace(body, snug=True)):
        spec = mujoco.MjSpec()
        add_person(spec, 0, each, LOOKS, position=(0, 0, 1), rng=None)
        model = spec.compile()
        turns = Rotation.from_quat(model.body_iquat[1:], scalar_first=True).as_matrix()
        found.append((model.body_mass, model.body_ipos, turns * model.body_inertia[1:, None] @ turns.swapaxes(1, 2)))
    for plain, snug in zip(*found, strict=True):
        np.testing.assert_allclose(snug, plain, atol=1e-9)
