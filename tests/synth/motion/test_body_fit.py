"""Motions fitted to bodies of other sizes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dmae.data.rng import Stream, generator
from synth.motion.config import MotionConfig, ProceduralConfig
from synth.motion.feet import fit_to_body
from synth.motion.source import load_motion
from synth.people.body import Body, segment_origins
from synth.people.solids import capsules

FPS = 25.0


def walk(seconds: float = 3.0):
    """A straight procedural walk: feet alternate, toes clear the floor."""
    config = MotionConfig(procedural=ProceduralConfig(standing=0, straight=1, gesture=0))
    return load_motion(config, seconds=seconds, fps=FPS, rng=generator(1, 0, Stream.MOTION))


@given(st.floats(1.5, 2.0), st.floats(50, 100))
@settings(max_examples=8, deadline=None)
def test_a_fitted_body_stands_on_the_floor(stature, mass):
    body = Body(stature, mass)
    motion = fit_to_body(walk(), body)
    segments, ends, radii = capsules(body)
    origins = segment_origins(body, motion.root, motion.rotations)[:, segments]
    heights = origins[:, :, None, 2] + np.einsum("fcj,cej->fce", motion.rotations[:, segments, 2], ends)
    lowest = (heights.min(2) - radii).min(1)
    assert np.abs(lowest).max() < 0.03
    assert abs(np.median(lowest)) < 0.01


def test_longer_legs_make_longer_steps():
    motion = walk()
    short, tall = fit_to_body(motion, Body(1.5, 50)), fit_to_body(motion, Body(2.0, 90))
    strides = [np.linalg.norm(m.root[-1, :2] - m.root[0, :2]) for m in (short, tall)]
    assert strides[1] / strides[0] == pytest.approx(2.0 / 1.5)
