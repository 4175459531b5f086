"""Trunks bend in small steps, hands have shapes, and palms lie on the surfaces that they touch."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from synth.motion.geometry import reach_with_arm
from synth.people.body import Body
from synth.people.clothing import HANDS, PersonLooks, sample_hands, sample_looks
from synth.people.mjcf import Bending, add_person
from synth.people.surfaces import hand

BODY, LOOKS = Body(), sample_looks(0.0, rng=np.random.default_rng(0))


@pytest.mark.parametrize("untucked", [True, False])
def test_neighbouring_pieces_of_a_bent_trunk_differ_by_a_small_turn(untucked):
    spec = mujoco.MjSpec()
    add_person(spec, 0, BODY, replace(LOOKS, untucked=untucked), position=(0, 0, 0.95), rng=None)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    straight = data.geom_xmat.reshape(-1, 3, 3).copy()
    bend = np.radians(50)
    at = model.joint("person0/spine").qposadr[0]
    data.qpos[at : at + 4] = Rotation.from_rotvec((0, bend, 0)).as_quat(scalar_first=True)
    mujoco.mj_kinematics(model, data)
    Bending(model).apply(data)
    turned = data.geom_xmat.reshape(-1, 3, 3) @ straight.swapaxes(1, 2)
    angles = Rotation.from_matrix(turned).magnitude()
    pieces = [angles[g] for g in range(model.ngeom) if model.geom(g).name.startswith("person0/spine/")]
    steps = np.diff(np.unique(np.round([0.0, *pieces, bend], 6)))
    assert steps.max() < 0.25 * bend
    assert np.abs(Rotation.from_matrix(turned[angles > 0.01]).as_rotvec()[:, [0, 2]]).max() < 1e-6


def test_nothing_bends_in_a_scene_without_people():
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    before = data.geom_xpos.copy()
    Bending(model).apply(data)
    np.testing.assert_array_equal(data.geom_xpos, before)


def test_a_fist_is_short_and_an_open_hand_wide():
    axes = np.array([(1, 0, 0), (0, 0, 1), (0, 1, 0)]).T
    spans = {shape: np.ptp(hand(BODY, shape, axes).vertices, axis=0) for shape in HANDS}
    assert min(spans, key=lambda shape: spans[shape][1]) == "fist"
    assert max(spans, key=lambda shape: spans[shape][0]) == "open"
    assert spans["point"][1] > spans["fist"][1] + 0.02


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
