import numpy as np
import pytest

from dmae.bodyframe import turn
from dmae.hints import carried, mended, roughness, stretch

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


class TestStretch:
    def test_swinging_limbs_keep_their_length_and_noisy_ones_do_not(self):
        rng = np.random.default_rng(0)
        angle = 10 * np.sin(np.arange(100) / 5)
        child = 0.3 * np.stack([np.cos(angle), np.sin(angle), np.zeros(100)], -1)
        xyz = np.zeros((100, 2, 2, 3))
        xyz[:, :, 1] = child[:, None] + rng.normal(0, 0.02, (100, 2, 3)) * np.array([0, 1])[:, None]
        exact, noisy = stretch(xyz, [(0, 1)]).transpose(1, 0, 2, 3)
        np.testing.assert_allclose(exact, np.log(0.1))
        # The mean size of a Gaussian is 0.8 deviations.
        assert noisy[..., 0].mean() == pytest.approx(np.log(0.8 * 2 + 0.1), abs=0.15)
        # A root has no bone; it is as its person.
        np.testing.assert_array_equal(noisy[:, 0, 1], noisy[:, 0, 0])

    def test_a_hidden_joint_has_the_bones_of_the_edges_of_its_hole(self):
        xyz = np.zeros((80, 1, 2, 3))
        xyz[:, 0, 1, 0] = 0.3
        xyz[29, 0, 1, 0] = 0.5
        xyz[30:50, 0, 1] = np.nan
        _, before, after = stretch(xyz, [(0, 1)])[40, 0, 1]
        assert before > np.log(5)
        assert after == pytest.approx(np.log(0.1))

    def test_who_is_never_measured_is_as_usual(self):
        np.testing.assert_allclose(stretch(np.full((4, 1, 2, 3), np.nan), [(0, 1)]), np.log(1.1))


class TestMended:
    BONES = ((0, 1), (1, 2), (1, 3))

    def arm(self) -> np.ndarray:
        """A root at the origin, a joint 0.3 m along x, and two children of that 0.4 m along x and y."""
        return np.tile([[0, 0, 0], [0.3, 0, 0], [0.7, 0, 0], [0.3, 0.4, 0]], (9, 1, 1, 1)).reshape(9, 1, 4, 3)

    def test_what_hangs_too_far_is_led_back(self):
        base, xyz = self.arm(), self.arm()
        xyz[3:6, 0, 2] = np.nan
        base[3:6, 0, 2] = [0.3, 0, 0.5]
        off = mended(base, xyz, self.BONES)
        np.testing.assert_allclose(off[4, 0, 2, 0], [0, 0, -0.1])
        assert not off[:, :, [0, 1, 3]].any() and not off[[2, 6]].any()

    def test_children_lead_their_parent(self):
        base, xyz = self.arm(), self.arm()
        xyz[3:6, 0, 1] = np.nan
        base[3:6, 0, 1] = [0.2, 0, 0]
        parent, children = mended(base, xyz, self.BONES)[4, 0, 1]
        np.testing.assert_allclose(parent, [0.1, 0, 0])
        to_second = np.array([0.1, 0.4, 0])
        length = np.linalg.norm(to_second)
        np.testing.assert_allclose(children, ([0.1, 0, 0] + to_second * (1 - 0.4 / length)) / 2)

    def test_bones_never_measured_lead_nowhere(self):
        xyz = self.arm()
        xyz[:, 0, 2] = np.nan
        assert not mended(self.arm(), xyz, self.BONES).any()
