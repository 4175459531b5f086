import numpy as np

from dmae.data.clip import Source
from dmae.evaluation.report.joints import added, tally


def test_quantiles_and_means_are_numpys_within_a_unit():
    rng = np.random.default_rng(0)
    error = rng.gamma(2, 30, 5000)
    found = tally(error, np.full(error.shape, Source.MEASURED))
    assert found.mean == np.float64(error.sum() / len(error)) or abs(found.mean - error.mean()) < 1e-9
    for share in (0.1, 0.5, 0.9, 0.99):
        assert abs(found.quantile(share) - np.quantile(error, share)) <= 1


def test_parts_add_up_to_the_whole():
    rng = np.random.default_rng(1)
    error, source = rng.uniform(0, 3000, 400), rng.integers(0, 4, 400)
    error[source == Source.ABSENT] = np.nan
    whole, parts = tally(error, source), tally(error[:150], source[:150]) + tally(error[150:], source[150:])
    assert (parts.joints, parts.completed, parts.missing, parts.compared) == (
        400,
        (source == Source.COMPLETED).sum(),
        (source == Source.ABSENT).sum(),
        np.isfinite(error).sum(),
    )
    assert np.isclose(parts.mean, whole.mean)
    np.testing.assert_array_equal(parts.histogram, whole.histogram)


def test_a_tally_of_nothing_has_no_error():
    none = tally(np.full(3, np.nan), np.full(3, Source.MEASURED))
    assert none.mean is None and none.quantile(0.9) is None


def test_groups_of_the_same_name_add_up():
    one = tally(np.array([1.0]), np.array([Source.MEASURED]))
    both = added({"a": one, "b": one}, {"b": one, "c": one})
    assert {name: each.joints for name, each in both.items()} == {"a": 1, "b": 2, "c": 1}
