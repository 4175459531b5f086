"""Stature, mass and limb lengths of people by sex, age and percentile."""

import numpy as np

from synth.people.body import ADULT_AGE, Body

ADULT = 30.0
"""Age of sampled adults, years."""
CHILDREN = (4.0, ADULT_AGE)
"""Least and greatest age of children, years."""
_STATURE = (1.75, 0.12, 0.065)
"""Stature of adults, m: mean of men, difference of the mean of women, standard deviation. ANSUR II (Gordon et al.,
NATICK/TR-15/007, 2014) found 1.756, 0.127, and 0.069 for men and 0.064 for women."""
_INDEX = (24.0, 1.0, 3.0)
"""Body mass index of adults, kg/m^2: mean of men, difference of the mean of women, standard deviation; worldwide means
(NCD-RisC, Lancet 387, 2016). It is independent of stature, so that mass and stature correlate with 0.5, as among
soldiers."""
_LENGTH = 0.02
"""Relative standard deviation of leg and arm lengths at a given stature. For crotch heights in ANSUR II it is 2.8 %,
which includes measurement errors."""
_LIMITS = ((1.48, 2.02), (18.0, 33.0), (0.95, 1.05), (0.95, 1.05))
"""Bounds of adults' stature, m, body mass index, kg/m^2, relative leg length and relative arm length."""

# Growth charts of the CDC (Kuczmarski et al., Vital and Health Statistics 11/246, 2002). Rows: age, years; of boys and
# of girls, median stature, m, and its coefficient of variation, without the charts' skewness; then L, M, S
# of the body mass index, kg/m^2 (Cole and Green, Statistics in Medicine 11, 1992).
_GROWTH = np.array((
    (4, 1.0251, 0.0413, -1.684, 15.64, 0.0718, 1.0103, 0.0433, -2.991, 15.31, 0.0786),
    (6, 1.1566, 0.0437, -3.198, 15.38, 0.0827, 1.1501, 0.0450, -3.236, 15.21, 0.0934),
    (8, 1.2812, 0.0451, -3.191, 15.77, 0.1017, 1.2783, 0.0460, -2.629, 15.81, 0.1167),
    (10, 1.3882, 0.0476, -2.774, 16.62, 0.1198, 1.3821, 0.0487, -2.178, 16.84, 0.1367),
    (12, 1.4931, 0.0499, -2.453, 17.79, 0.1312, 1.5149, 0.0486, -1.977, 18.07, 0.1482),
    (13, 1.5641, 0.0503, -2.334, 18.44, 0.1341, 1.5734, 0.0439, -1.955, 18.71, 0.1506),
    (15, 1.7014, 0.0459, -2.136, 19.83, 0.1351, 1.6190, 0.0401, -2.032, 19.91, 0.1506),
    (16, 1.7361, 0.0431, -2.043, 20.53, 0.1342, 1.6257, 0.0398, -2.115, 20.43, 0.1492),
    (18, 1.7619, 0.0406, -1.877, 21.87, 0.1323, 1.6313, 0.0397, -2.301, 21.26, 0.1473),
))  # fmt: skip
_RAREST = 2.0
"""Greatest deviation of children from the median, in standard deviations: the charts' percentiles 2 to 98."""


def body_at(
    feminine: float,
    age: float = ADULT,
    *,
    stature: float = 0.0,
    index: float = 0.0,
    legs: float = 0.0,
    arms: float = 0.0,
) -> Body:
    """Return the body of a person of given sex, age and percentiles.

    Percentiles are deviations from the median in standard deviations; 1.645 is the 95th percentile.

    Args:
        feminine: 0 for men and boys, 1 for women and girls.
        age: Years, from 4; adult proportions from 18 on.
        stature, index, legs, arms: Deviations of the stature, of the body mass index, and of the lengths of legs and
            arms at this stature. They are clipped to the range of the population.

    Raises:
        ValueError: the age is below 4, or `feminine` is not within 0 to 1.
    """
    if age < ADULT_AGE:
        index, stature = (float(np.clip(z, -_RAREST, _RAREST)) for z in (index, stature))
        row = np.array([np.interp(age, _GROWTH[:, 0], column) for column in _GROWTH.T[1:]])
        median, spread, power, middle, width = (1 - feminine) * row[:5] + feminine * row[5:]
        tall = median * (1 + spread * stature)
        heavy = middle * (1 + power * width * index) ** (1 / power)
    else:
        tall = np.clip(_STATURE[0] - _STATURE[1] * feminine + _STATURE[2] * stature, *_LIMITS[0])
        heavy = np.clip(_INDEX[0] - _INDEX[1] * feminine + _INDEX[2] * index, *_LIMITS[1])
    long = [np.clip(1 + _LENGTH * z, *limits) for z, limits in zip((legs, arms), _LIMITS[2:], strict=True)]
    return Body(*(round(float(value), 4) for value in (tall, heavy * tall**2, feminine, *long, age)))


def sample_body(children: float = 0.0, *, rng: np.random.Generator) -> Body:
    """Draw a person's body.

    Args:
        children: Probability of a child, of any age from 4 to 17 years.
        rng: Draws everything.
    """
    age = rng.uniform(*CHILDREN) if children and rng.random() < children else ADULT
    feminine = float(rng.random() < 0.5)
    stature, index, legs, arms = rng.standard_normal(4)
    return body_at(feminine, age, stature=stature, index=index, legs=legs, arms=arms)
