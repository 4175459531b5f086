import numpy as np
import pytest

from dmae.bodyframe import turn
from dmae.hints import carried, roughness

PARENTS = np.array([0, 0])


def turning_person(frames: int = 9) -> tuple[np.ndarray, np.ndarray]:
    """A root that walks along x while the body turns, a child half a metre ahead of it; and where the body faces."""
    front = np.linspace(0, np.pi / 2, frames)[:, None]
    root = np.stack([np.arange(frames), np.zeros(frames), np.ones(frames)], -1)[:, None]
    return np.stack([root, root + turn(np.broadcast_to([0.5, 0, 0], root.shape), front)], 2), front


class TestCarried:
    def test_who_keeps_still_in_the_body_is_where_it_was(self):
        xyz, front = turning_person()
        observed = np.ones((9, 1, 2), bool)
        observed[3:6, 0, 1] = False
        off = carried(xyz, observed, PARENTS, front)
        np.testing.assert_allclose(off[..., :2, :], 0, atol=1e-12)
        # In the world it was left behind, and is not there yet.
        np.testing.assert_allclose(off[4, 0, 1, 2], xyz[2, 0, 1] - xyz[4, 0, 1])
        np.testing.assert_allclose(off[4, 0, 1, 3], xyz[6, 0, 1] - xyz[4, 0, 1])
        assert not off[observed].any()

    def test_a_move_in_the_body_is_told_in_the_world(self):
        xyz, front = turning_person()
        xyz[6:, 0, 1] += turn(np.tile([0, 0.2, 0], (3, 1)), front[6:, 0])
        observed = np.ones((9, 1, 2), bool)
        observed[3:6, 0, 1] = False
        off = carried(xyz, observed, PARENTS, front)
        np.testing.assert_allclose(off[4, 0, 1, 1], turn(np.array([0, 0.2, 0]), front[4, 0]), atol=1e-12)

    def test_nothing_is_told_of_a_side_on_which_it_is_never_observed(self):
        xyz, front = turning_person()
        observed = np.ones((9, 1, 2), bool)
        observed[4:, 0, 1] = False
        off = carried(xyz, observed, PARENTS, front)
        assert off[5, 0, 1, 2].any()
        assert not off[4:, 0, 1, [1, 3]].any()


class TestRoughness:
    def test_noise_is_rough_and_motion_is_not(self):
        rng = np.random.default_rng(0)
        time = np.arange(200)[:, None, None, None] / 25
        smooth = np.sin(3 * time) * np.ones((1, 2, 3, 3)) * 0.2
        noisy = smooth + rng.normal(0, 0.01, smooth.shape) * np.array([0, 1])[:, None, None]
        rough = roughness(noisy)[5:-5]
        assert rough[:, 0].max() < -1
        # The third difference of white noise has 20 times its variance; three of them are some 1.6 deviations long.
        assert rough[:, 1].mean() == pytest.approx(np.log(1.6 * np.sqrt(20)), abs=0.2)

    def test_a_hidden_joint_is_as_rough_as_at_the_edges_of_its_hole(self):
        rng = np.random.default_rng(0)
        xyz = np.zeros((80, 1, 2, 3))
        xyz[:30, 0, 0] = rng.normal(0, 0.05, (30, 3))
        xyz[30:50, 0, 0] = np.nan
        person, before, after = roughness(xyz)[40, 0, 0]
        assert before > person > 1
        assert after == pytest.approx(np.log(0.1))

    @pytest.mark.parametrize("frames", [1, 3, 5])
    def test_what_is_hardly_measured_is_rough_as_usual(self, frames):
        xyz = np.full((frames, 1, 2, 3), np.nan)
        xyz[0] = 0
        np.testing.assert_allclose(roughness(xyz), np.log(1.1))
