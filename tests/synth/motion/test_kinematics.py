"""Angles, speeds and accelerations of poses and movements for which they are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dmae.data.skeleton import BODY25
from dmae.numerics.paths import local_parabola
from synth.motion.config import ProceduralConfig
from synth.motion.kinematics import QUANTITIES, SMOOTHING, kinematics
from synth.motion.procedural.gait import make_motion
from synth.people.body import SEGMENTS
from synth.physics.body_state import reference_joints
from tests.support.scenes import BODY, gliding

FPS = 25.0
ABOVE = tuple(name for name in SEGMENTS if not name.endswith(("pelvis", "thigh", "shin", "foot")))
PARTS = {"chest and all": ABOVE, "pelvis and all": ("pelvis", *ABOVE)}


def joints(motion) -> np.ndarray:
    return reference_joints(BODY, motion.root, motion.rotations)[:, :25]


def posed(turns: dict[str, tuple[str, float]]) -> dict[str, np.ndarray]:
    """Measure an upright person, arms hanging, with segments turned about an axis by degrees."""
    motion = gliding(BODY, 30, (0, 0), (1e-9, 0))
    rotations = motion.rotations.copy()
    for segment, (axis, degrees) in turns.items():
        which = [SEGMENTS.index(name) for name in PARTS.get(segment, (segment,))]
        rotations[:, which] = Rotation.from_euler(axis, degrees, degrees=True).as_matrix() @ rotations[:, which]
    measured = kinematics(reference_joints(BODY, motion.root, rotations)[:, :25], FPS)
    return {name: values[15] for name, values in measured.items()}


@pytest.mark.parametrize(
    ("turns", "quantity", "change", "within"),
    [
        ({"l_shin": ("y", 40)}, "knee flexion", (40, 0), 3),
        ({"r_thigh": ("y", -30), "r_shin": ("y", -30)}, "hip flexion", (0, 30), 2),
        ({"l_thigh": ("x", 20), "l_shin": ("x", 20)}, "hip abduction", (20, 0), 2),
        ({"l_foot": ("y", -15)}, "ankle flexion", (15, 0), 1),
        ({"pelvis and all": ("y", 20)}, "trunk lean, forward", 20, 0.1),
        ({"pelvis and all": ("x", -20)}, "trunk lean, left", 20, 0.1),
        ({"chest and all": ("z", 25)}, "trunk twist, left", 25, 0.1),
        ({"head": ("z", 30)}, "head turn, left", 30, 0.1),
        ({"head": ("y", -10)}, "face, up", 10, 0.5),
        ({"l_upper_arm": ("y", -60)}, "arm raised", (52, 0), 10),
        ({"r_forearm": ("y", -70)}, "elbow flexion", (0, 70), 4),
    ],
)
def test_angles_are_the_turns_of_segments(turns, quantity, change, within):
    assert posed(turns)[quantity] - posed({})[quantity] == pytest.approx(np.array(change), abs=within)


def test_a_t_pose_has_its_arms_straight_and_level():
    lifted = {
        f"{side}_{part}": ("x", turn) for side, turn in (("l", 77), ("r", -77)) for part in ("upper_arm", "forearm")
    }
    t_pose = posed(lifted)
    assert t_pose["arm raised"] == pytest.approx(90, abs=2)
    assert t_pose["arm outward"] == pytest.approx(90, abs=3)
    assert t_pose["elbow flexion"] == pytest.approx(0, abs=1)
    assert posed({})["hand over hips"].max() < 0 < t_pose["hand over hips"].min()


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 50), st.floats(-np.pi, np.pi), st.floats(-20, 20), st.floats(-20, 20))
def test_quantities_do_not_depend_on_position_and_heading(seed, yaw, x, y):
    xyz = joints(make_motion(ProceduralConfig(), seconds=2, fps=FPS, rng=np.random.default_rng(seed)))
    moved = xyz @ Rotation.from_euler("z", yaw).as_matrix().T + (x, y, 0)
    here, there = kinematics(xyz, FPS), kinematics(moved, FPS)
    for quantity in QUANTITIES:
        scale = 1 + np.nanmax(np.abs(here[quantity.name]))
        np.testing.assert_allclose(there[quantity.name], here[quantity.name], atol=1e-5 * scale, err_msg=quantity.name)


def test_mirroring_exchanges_left_and_right():
    xyz = joints(make_motion(ProceduralConfig(), seconds=3, fps=FPS, rng=np.random.default_rng(3)))
    real, mirrored = kinematics(xyz, FPS), kinematics((xyz * (1, -1, 1))[:, list(BODY25.mirror)], FPS)
    for name, values in real.items():
        expected = values[:, ::-1] if values.ndim == 2 else -values if "left" in name else values
        np.testing.assert_allclose(mirrored[name], expected, atol=1e-6 * (1 + np.nanmax(np.abs(values))), err_msg=name)


def test_speed_of_gliding_and_acceleration_of_circling():
    straight = kinematics(joints(gliding(BODY, 50, (0, 0), (1.3, 0.4))), FPS)
    assert np.nanmedian(straight["hips along floor, speed"]) == pytest.approx(np.hypot(1.3, 0.4))
    assert np.nanmax(straight["ankle, acceleration"]) < 1e-3
    assert np.nanmedian(straight["foot slide"]) == pytest.approx(100 * np.hypot(1.3, 0.4))
    angle = 1.2 * np.arange(100) / FPS
    standing = joints(gliding(BODY, 100, (0, 0), (1e-9, 0)))
    turns = Rotation.from_euler("z", angle[:, None]).as_matrix()
    circling = kinematics((standing + (0, -2.0, 0)) @ turns.swapaxes(1, 2), FPS)
    assert np.nanmedian(circling["pelvis turning, speed"]) == pytest.approx(np.degrees(1.2), rel=1e-3)
    assert np.nanmedian(circling["hips along floor, speed"]) == pytest.approx(2 * 1.2, rel=2e-3)
    assert np.nanmedian(circling["hips, acceleration"]) == pytest.approx(2 * 1.2**2, rel=2e-3)


@pytest.mark.parametrize("fps", [25.0, 120.0])
def test_smoothing_halves_the_power_at_6_hz(fps):
    times = np.arange(round(20 * fps)) / fps
    for hertz, share in ((1, 1), (6, 0.5)):
        wave = np.sin(2 * np.pi * hertz * times)[:, None]
        power = (local_parabola(wave, SMOOTHING * fps) ** 2)[50:-50].mean() / (wave**2)[50:-50].mean()
        assert power == pytest.approx(share, abs=0.06)


def test_a_hidden_joint_hides_only_the_quantities_that_need_it():
    xyz = joints(make_motion(ProceduralConfig(), seconds=2, fps=FPS, rng=np.random.default_rng(1)))
    whole = kinematics(xyz, FPS)
    xyz[20:, BODY25.index("l_wrist")] = np.nan
    holed = kinematics(xyz, FPS)
    for name, values in whole.items():
        needs = "elbow" in name or "wrist" in name or "hand" in name
        assert np.isnan(holed[name][22:48]).any() == needs, name
        if needs:
            np.testing.assert_array_equal(holed[name][:, 1], values[:, 1], err_msg=name)
    nobody = kinematics(np.full((20, 25, 3), np.nan), FPS)
    assert all(np.isnan(values).all() for values in nobody.values())
    collapsed = kinematics(np.ones((20, 25, 3)), FPS)
    assert np.isnan(collapsed["knee flexion"]).all()
    assert (collapsed["ankle, acceleration"][1:-1] < 1e-9).all()
