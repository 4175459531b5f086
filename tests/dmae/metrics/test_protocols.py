"""PCP by protocol: cases computed by hand that tell the protocols apart."""

import numpy as np
import pytest

from dmae.data.skeleton import SHELF14
from dmae.metrics.protocols import better_limbs, count_limbs, protocol, published_pcp
from tests.support.shelf_walkers import aside, people

KNEE = SHELF14.index("l_knee")[0]


def pcp(name: str, pred: np.ndarray, truth: np.ndarray) -> list[float]:
    """PCP of each person, %; None for a person without a limb that counts."""
    correct, counted = count_limbs(protocol[name], pred, truth, SHELF14)
    return [
        100 * float((right & known).sum() / known.sum()) if known.any() else None
        for right, known in zip(correct.swapaxes(0, 1), counted.swapaxes(0, 1), strict=True)
    ]


def missed_once() -> tuple[np.ndarray, np.ndarray]:
    """Two persons in four frames; the second is missed in the first frame."""
    truth = people(4, 2)
    pred = truth.copy()
    pred[0, 1] = np.nan
    return pred, truth


def empty_once() -> tuple[np.ndarray, np.ndarray]:
    """A person in four frames, of which the first has no prediction."""
    truth = people(4, 1)
    pred = truth.copy()
    pred[0] = np.nan
    return pred, truth


def shared() -> tuple[np.ndarray, np.ndarray]:
    """Two persons 4 cm apart, and one prediction, which is the first of them."""
    truth = people(1, 2)
    truth[0, 1] = aside(truth[0, 0], 0.04)
    return truth[:, :1].copy(), truth


def far() -> tuple[np.ndarray, np.ndarray]:
    """A prediction 0.6 m off, so that only limbs longer than 1.2 m would be correct."""
    truth = people(1, 1)
    return aside(truth, 0.6), truth


def at_half() -> tuple[np.ndarray, np.ndarray]:
    """The left knee off by 0.5 m: exactly half of a thigh of 0.5 m, and less than half of a shank of 0.75 m."""
    truth = people(1, 1).round(3)
    truth[0, 0, KNEE] = truth[0, 0, SHELF14.index("l_hip")[0]] - (0, 0, 0.5)
    truth[0, 0, SHELF14.index("l_ankle")[0]] = truth[0, 0, KNEE] - (0, 0, 0.75)
    pred = truth.copy()
    pred[0, 0, KNEE, 0] += 0.5
    return pred, truth


@pytest.mark.parametrize(
    ("case", "expected"),
    [
        (missed_once, {"strict": [100, 75], "mvpose": [100, 75], "voxelpose": [100, 75], "4da": [100, 100],
                       "hkbu": [100, 75]}),
        (empty_once, {"strict": [75], "mvpose": [75], "voxelpose": [100], "4da": [100], "hkbu": [75]}),
        (shared, {"strict": [100, 0], "mvpose": [100, 100], "voxelpose": [100, 100], "4da": [100, None],
                  "hkbu": [100, 0]}),
        (far, {"strict": [0], "mvpose": [0], "voxelpose": [0], "4da": [0], "hkbu": [0]}),
        (at_half, {"strict": [100], "mvpose": [100], "voxelpose": [100], "4da": [90], "hkbu": [90]}),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)  # fmt: skip
def test_protocols_differ_as_described(case, expected):
    assert set(expected) == set(protocol)
    assert {name: pcp(name, *case()) for name in protocol} == expected


def test_averages_are_of_the_published_protocols():
    scores = published_pcp(*missed_once(), SHELF14, [0, 1])
    assert scores == {"mvpose": 87.5, "voxelpose": 87.5, "4da": 100, "hkbu": 87.5}


def test_the_better_of_two_is_chosen_for_each_person_and_frame():
    """Each of the two predictions has one leg right in one frame: the better of two has it in both frames."""
    truth = people(2, 1)
    first, second = truth.copy(), truth.copy()
    first[0, 0, KNEE] += 1
    second[1, 0, KNEE] += 1
    scores = []
    for correct, counted in (
        count_limbs(protocol["hkbu"], first, truth, SHELF14),
        count_limbs(protocol["hkbu"], second, truth, SHELF14),
        better_limbs(protocol["hkbu"], first, second, truth, SHELF14),
    ):
        scores.append(100 * correct[counted].mean())
    assert scores == [90, 90, 100]
