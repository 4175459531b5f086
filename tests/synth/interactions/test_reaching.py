"""Arms that reach for a point and return to their own motion."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from synth.interactions.casting import reach_for
from synth.interactions.script import Reach
from synth.motion.geometry import reach_with_arm
from synth.motion.procedural.trajectory import arm
from synth.people.body import SEGMENTS, segment_origins
from tests.support.scenes import BODY, gliding

# Flexion, abduction, inward turn, elbow, pronation of arms that hang, are raised, and are raised behind the head.
ANGLES = st.tuples(*(st.floats(*span) for span in ((-0.5, 2.8), (0, 2.5), (-1.2, 1.2), (0.05, 2.4), (-1.2, 1.2))))


@given(ANGLES, ANGLES, st.sampled_from("lr"), st.floats(0.15, 0.45), st.floats(-0.3, 0.3), st.floats(0.9, 1.5))
@settings(max_examples=60)
def test_elbows_are_hinges_and_nothing_jumps_while_a_hand_reaches(start, stop, side, ahead, aside, height):
    frames, sign = 60, {"l": 1, "r": -1}[side]
    motion = gliding(BODY, frames, (0, 0), (0, 0))
    time = np.linspace(0, 1, frames)
    segments = [SEGMENTS.index(f"{side}_{part}") for part in ("upper_arm", "forearm", "hand")]
    rotations = motion.rotations.copy()
    swing = np.array(start) + (0.5 - 0.5 * np.cos(2 * np.pi * time[:, None])) * (np.array(stop) - start)
    rotations[:, segments] = np.stack(arm(np.tile(np.eye(3), (frames, 1, 1)), sign, swing), axis=1)
    motion = replace(motion, rotations=rotations)
    share = np.clip(2 - np.abs(6 * time - 3), 0, 1)
    share = share**2 * (3 - 2 * share)
    palm = np.tile((ahead, aside + sign * 0.15, height), (frames, 1))
    reach = Reach(0, side, share, palm, np.tile((1.0, 0, 0), (frames, 1)))
    found = reach_for(motion, BODY, reach).rotations

    upper, forearm = found[:, segments[0]], found[:, segments[1]]
    sideways = np.degrees(np.arcsin((upper[..., 2] * forearm[..., 1]).sum(-1).clip(-1, 1)))
    np.testing.assert_allclose(sideways, 0, atol=1e-4)
    np.testing.assert_allclose(found[share == 0], motion.rotations[share == 0], atol=1e-9)
    chest, shoulder = (
        rotations[:, SEGMENTS.index("chest")],
        segment_origins(BODY, motion.root, rotations)[:, segments[0]],
    )
    wanted = reach_with_arm(BODY, side, chest, shoulder, palm, reach.normal, reach.elbow)
    np.testing.assert_allclose(found[share == 1][:, segments], wanted[share == 1], atol=1e-9)
    steps = np.swapaxes(found[:-1, segments], -1, -2) @ found[1:, segments]
    assert Rotation.from_matrix(steps.reshape(-1, 3, 3)).magnitude().max() < 1.2
