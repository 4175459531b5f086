"""Joint angles as scores, on people whose angles are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dmae.data.skeleton import BODY25
from dmae.evaluation.scores import score, summary
from dmae.metrics.angles import calibration, leg_angles
from dmae.metrics.score_tables import score_tables
from tests.dmae.formats.test_animation import simulated


def test_calibration_of_gaussian_errors():
    rng = np.random.default_rng(0)
    spread = rng.uniform(1, 5, 20_000)
    error = spread * rng.standard_normal(len(spread))
    honest, bold = calibration(error, spread), calibration(error, spread / 2)
    assert honest["held"] == pytest.approx(90, abs=1) and honest["ece"] < 0.01
    # Of a Gaussian, 58.9 % are within 0.8224 standard deviations, the half of 1.6449.
    assert bold["held"] == pytest.approx(58.9, abs=1.5) and bold["ece"] > 0.2
    assert np.isnan(calibration(np.full(3, np.nan), spread[:3])["ece"])


def test_a_bent_knee_is_an_error_of_the_knee():
    truth, _ = simulated(BODY25)
    xyz = truth.xyz.copy()
    knee, hip = BODY25.index("r_knee", "l_hip")
    below = BODY25.index("r_ankle", "r_big_toe", "r_small_toe", "r_heel")
    across = xyz[:, 0, hip] - xyz[:, 0, BODY25.index("r_hip")[0]]
    turn = Rotation.from_rotvec(np.radians(6) * across / np.linalg.norm(across, axis=-1, keepdims=True)).as_matrix()
    for joint in below:
        xyz[:, 0, joint] = xyz[:, 0, knee] + (turn @ (xyz[:, 0, joint] - xyz[:, 0, knee])[..., None])[..., 0]
    bent = replace(truth, xyz=xyz)
    found = score(bent, bent, truth, angles=leg_angles(truth)[0])
    # One of two knees.
    assert found["angles"]["knees"] == pytest.approx(3, abs=0.3)
    assert found["angles"]["hips"] < 0.5 and found["angles"]["ankles"] < 0.5
    assert found["angles"]["determined"] == 100 and 0 < found["angles"]["ece"] < 0.5
    run = {"clip": "a", "cameras": [0, 1], **found}
    mean = summary([run])
    assert mean["mean"]["angles"]["mae"] == pytest.approx(found["angles"]["mae"]) and "angles" in mean["intervals"]
    tables = score_tables({"skeleton": "body25", "results": [{"method": "none", "views": 2, **mean}]})
    (table,) = [each for each in tables if each.caption.startswith("Joint angles")]
    assert table.rows[0][2:5] == tuple(f"{found['angles'][joint]:.1f}" for joint in ("hips", "knees", "ankles"))


def test_angles_are_scored_on_request_only():
    truth, _ = simulated(BODY25, frames=5)
    found = score(truth, truth, truth)
    assert "angles" not in found and "angles" not in found["blocks"]
