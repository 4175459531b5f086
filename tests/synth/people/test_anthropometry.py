"""Statures, masses and proportions follow surveys and growth charts."""

import numpy as np
import pytest

from synth.people.body import Body, body_at, sample_body

# Percentiles 3, 50, 97 of the CDC's charts, boys and girls: stature, m.
STATURES = {
    (5.04, 0): (1.0033, 1.0918, 1.1783),
    (10.04, 0): (1.2667, 1.3882, 1.5153),
    (14.04, 0): (1.4853, 1.6414, 1.7882),
    (5.04, 1): (0.9935, 1.0796, 1.1736),
    (10.04, 1): (1.2596, 1.3821, 1.5129),
    (14.04, 1): (1.4812, 1.6048, 1.7288),
}
# At -2, 0, 1 and 2 standard deviations: body mass index, kg/m^2.
INDICES = {
    (5, 0): (13.57, 15.42, 16.78, 18.69),
    (10, 0): (13.83, 16.62, 19.23, 24.65),
    (16, 0): (16.57, 20.53, 24.02, 30.30),
    (6, 1): (13.14, 15.21, 17.00, 20.25),
    (12, 1): (14.31, 18.07, 21.54, 28.24),
}


@pytest.mark.parametrize(("age", "feminine"), STATURES)
def test_statures_of_children_follow_the_growth_charts(age, feminine):
    found = [body_at(feminine, age, stature=z).stature for z in (-1.881, 0, 1.881)]
    np.testing.assert_allclose(found, STATURES[age, feminine], atol=0.012)


@pytest.mark.parametrize(("age", "feminine"), INDICES)
def test_mass_indices_of_children_follow_the_growth_charts(age, feminine):
    bodies = [body_at(feminine, age, index=z) for z in (-2, 0, 1, 2)]
    np.testing.assert_allclose([b.mass / b.stature**2 for b in bodies], INDICES[age, feminine], rtol=0.025)


def test_adults_follow_ansur_ii():
    # ANSUR II: mean and standard deviation of stature, m.
    rng = np.random.default_rng(0)
    bodies = [sample_body(rng=rng) for _ in range(4000)]
    for feminine, mean, spread in ((0.0, 1.756, 0.069), (1.0, 1.629, 0.064)):
        these = [body for body in bodies if body.feminine == feminine]
        stature, mass = np.array([(body.stature, body.mass) for body in these]).T
        assert stature.mean() == pytest.approx(mean, abs=0.01)
        assert stature.std() == pytest.approx(spread, abs=0.007)
        assert np.corrcoef(stature, mass)[0, 1] == pytest.approx(0.5, abs=0.1)
        girths = np.array([body.girth for body in these])
        assert abs(np.corrcoef(stature, girths)[0, 1]) < 0.1, "girth does not depend on stature"
        assert np.ptp(girths) > 0.25


def test_the_share_of_children_is_as_requested():
    rng = np.random.default_rng(1)
    ages = np.array([sample_body(0.3, rng=rng).age for _ in range(2000)])
    assert (ages < 18).mean() == pytest.approx(0.3, abs=0.03)
    assert ages[ages < 18].min() < 4.5 < 17.5 < ages[ages < 18].max()
    assert (np.array([sample_body(rng=rng).age for _ in range(50)]) == 30).all()


def heads_tall(body: Body) -> float:
    """Stature over the height of the head from the chin, which is 0.025 of stature above an adult's neck joint."""
    return 1 / (0.130 * body.head)


@pytest.mark.parametrize(("age", "heads", "sitting"), [(4, 5.4, 0.562), (8, 6.4, 0.537), (12, 7.2, 0.519)])
def test_children_have_large_heads_and_short_legs(age, heads, sitting):
    for body in (body_at(0, age), body_at(1, age)):
        assert heads_tall(body) == pytest.approx(heads, abs=0.25)
        # Hips are 0.053 of stature above what people sit on: adults sit 0.523 high and have their hips at 0.530.
        assert body.hip_height / body.stature == pytest.approx(1 - sitting + 0.053, abs=0.004)


def test_bodies_grow_steadily_into_adults():
    ages = np.arange(4, 18.01, 0.25)
    for feminine in (0, 1):
        bodies = [body_at(feminine, age) for age in ages[:-1]] + [body_at(feminine)]
        for growing in ("stature", "mass", "hip_height"):
            assert (np.diff([getattr(body, growing) for body in bodies]) > -0.01).all(), growing
        shares = np.array([body.masses[3] / body.mass for body in bodies])
        assert shares[0] == pytest.approx(0.081 + 0.0114 * 11, abs=1e-3)
        assert (np.diff(shares) <= 1e-9).all()
        assert np.abs(np.diff([body.girth for body in bodies[:-1]])).max() < 0.02
        figures = [body.figure for body in bodies]
        assert figures[0] == pytest.approx(0.5)
        assert figures[-1] == feminine
    assert body_at(0, 6).tempo > body_at(0, 12).tempo > body_at(0).tempo == 1.0


def test_extreme_percentiles_are_clipped():
    for age in (4, 9, 17.9, 30):
        for z in (-9, 9):
            body = body_at(1, age, stature=z, index=z, legs=z, arms=z)
            assert 0.6 < body.girth < 1.6
    with pytest.raises(ValueError, match="age must lie in 4"):
        body_at(0, 2)
