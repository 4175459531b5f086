"""Regions, windows, candidates and torsos, without any network."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.data.skeleton import BLAZEPOSE33
from dmae.detection.detectors.blazepose import _is_cut, _merged, anchors, same_region, shares_of, windows_of
from dmae.detection.detectors.landmarks import (
    TORSO,
    Person,
    Region,
    corrected_torso,
    disagreement,
    larger_region,
    painted_over,
    part_of,
    pyramid_of,
    same_torso,
)
from dmae.detection.registry import PoseDetectorConfig


def test_anchors_are_those_of_the_network():
    assert anchors().shape == (2254, 2)
    assert ((anchors() > 0) & (anchors() < 1)).all()
    np.testing.assert_allclose(anchors()[:2], 0.5 / 28)


@pytest.mark.parametrize("degrees", [0, 30, -120])
@pytest.mark.parametrize("side", [100, 700])
def test_a_point_of_a_cut_lies_where_it_is_in_the_image(degrees, side):
    angle = np.radians(degrees)
    region = Region(np.array([410.0, 300.0]), side, np.array([np.sin(angle), -np.cos(angle)]))
    place = region.to_image(np.array([0.3, 0.6]))
    y, x = np.mgrid[:600, :800] + 0.5
    image = 255 * np.exp(-((x - place[0]) ** 2 + (y - place[1]) ** 2) / (2 * (side / 20) ** 2))
    cut = region.cut(pyramid_of(np.repeat(image.astype(np.uint8)[..., None], 3, 2)), 256)[..., 0].astype(float)
    rows, columns = np.mgrid[:256, :256] + 0.5
    found = np.array([(columns * cut).sum(), (rows * cut).sum()]) / cut.sum() / 256
    np.testing.assert_allclose(found, (0.3, 0.6), atol=0.003)


def test_windows_cover_the_image_and_keep_in_it():
    for window in windows_of(1920, 1080, (1.0, 0.6, 0.35)):
        assert window.side <= 1920
    small = windows_of(1920, 1080, (0.35,))
    covered = np.zeros((1080, 1920), bool)
    for each in small:
        left, top = (each.centre - each.side / 2).round().astype(int)
        assert left >= 0 and top >= 0
        covered[top : top + round(each.side), left : left + round(each.side)] = True
    assert covered.all()


def test_windows_of_photographs_shrink_to_small_people():
    assert shares_of(PoseDetectorConfig(), 1920, 1080) == (1.0, 0.6, 0.35)
    photograph = PoseDetectorConfig(photographs=True)
    np.testing.assert_allclose(shares_of(photograph, 640, 480), (1.5, 1, 0.6, 0.36))
    assert 240 / 1920 >= shares_of(photograph, 1080, 1920)[-1] > 0.6 * 240 / 1920
    assert 0.12 >= shares_of(photograph, 12000, 8000)[-1] > 0.6 * 0.12
    assert shares_of(replace(photograph, windows=[2.0, 0.5]), 640, 480) == (2.0, 0.5)


def test_boxes_that_overlap_become_their_mean():
    boxes = np.zeros((3, 6, 2))
    boxes[:, 0] = (0.5, 0.5), (0.52, 0.5), (0.1, 0.1)
    boxes[:, 1] = 0.2
    found = _merged(boxes, np.array([0.8, 0.8, 0.6]))
    assert [round(score, 1) for _, score in found] == [0.8, 0.6]
    np.testing.assert_allclose(found[0][0][0], (0.51, 0.5))


def test_a_window_that_cuts_a_body_is_known():
    window = Region.upright(400, 0, 400)
    inside = Region.around(np.array([600.0, 200]), np.array([600.0, 60]))
    cut = Region.around(np.array([430.0, 200]), np.array([430.0, 60]))
    assert not _is_cut(inside, window, 1000, 400)
    assert _is_cut(cut, window, 1000, 400)
    assert not _is_cut(Region.around(np.array([10.0, 200]), np.array([10.0, 60])), Region.upright(0, 0, 400), 1000, 400)


def test_no_region_without_extent():
    assert Region.around(np.array([5.0, 5]), np.array([5.0, 5])) is None
    assert Region.around(np.array([5.0, np.nan]), np.array([5.0, 9])) is None


def person(x: float) -> Person:
    xy = np.zeros((33, 2))
    for joint, place in {"l_shoulder": (40, 0), "r_shoulder": (0, 0), "l_hip": (35, 60), "r_hip": (5, 60)}.items():
        xy[BLAZEPOSE33.index(joint)[0]] = place
    return Person(xy + (x, 0), np.zeros(33), np.zeros(33), 1.0, Region.around(np.array([x, 0.0]), np.array([x, -90.0])))


def test_duplicates_are_told_by_torsos():
    assert same_torso(person(0), person(10))
    assert not same_torso(person(0), person(60))
    assert same_region(person(0).region, person(10).region)
    assert not same_region(person(0).region, person(60).region)


def test_a_small_body_with_the_head_of_a_larger_one_is_a_part_of_it():
    whole = person(0)
    head = whole.xy[BLAZEPOSE33.index("nose")[0]]

    def shrunk(factor: float, by: float = 0) -> Person:
        return replace(whole, xy=head + factor * (whole.xy - head) + (by, 0))

    assert part_of(shrunk(0.5), whole) and not part_of(whole, shrunk(0.5))
    assert not part_of(shrunk(0.9), whole)
    assert not part_of(shrunk(0.5, by=whole.torso_size / 2), whole)


def standing(visibility: float) -> Person:
    """A person of 100 px from shoulders to hips, with straight limbs and a face of 14 px."""
    xy = np.full((33, 2), (0.0, -30.0))
    for side, sign in (("l", 1), ("r", -1)):
        places = {"eye": (4, -36), "mouth": (2, -22), "shoulder": (25, 0), "elbow": (30, 60), "wrist": (35, 110)}
        places |= {"hip": (15, 100), "knee": (15, 190), "ankle": (15, 270), "heel": (12, 280), "big_toe": (25, 280)}
        places |= {f"{finger}": (36, 120) for finger in ("index_finger", "little_finger", "thumb")}
        for joint, (x, y) in places.items():
            xy[BLAZEPOSE33.index(f"{side}_{joint}")[0]] = (sign * x, y)
    region = Region.around(np.array([0.5, 100.5]), np.array([0.5, -80.0]))
    return Person(xy, np.full(33, visibility), np.full(33, visibility), 1.0, region)


@pytest.mark.parametrize(
    ("visibility", "size", "x", "part"),
    [(0, 0.4, 15, True), (4, 0.4, 15, False), (0, 0.4, 90, False), (0, 0.9, 0, False)],
    ids=["a leg", "clearer than the larger body", "beside the leg", "as large"],
)
def test_a_body_made_of_the_leg_of_a_clearer_one_is_a_part_of_it(visibility, size, x, part):
    whole, small = standing(2), standing(visibility)
    small = replace(small, xy=small.xy * (size / 4, size) + (x, 120))
    assert part_of(small, whole) == part


def test_the_region_of_a_body_too_small_for_its_head_grows_around_the_head():
    whole = standing(2)
    assert larger_region(whole) is None
    head = [BLAZEPOSE33.index(joint)[0] for joint in ("l_ear", "r_ear", "nose")]
    small = whole.xy * np.where(whole.xy[:, 1:] >= 0, 0.5, 1)
    small = replace(whole, xy=small, region=Region.around(np.array([0.5, 50.5]), np.array([0.5, -40.0])))
    larger = larger_region(small)
    assert larger.side == pytest.approx(2 * small.region.side, rel=0.01)
    place = small.xy[head].mean(0) + 0.5
    np.testing.assert_allclose(larger.from_image(place) - 0.5, (small.region.from_image(place) - 0.5), atol=1e-9)
    assert larger_region(replace(small, region=None)) is None


def test_exchanged_sides_are_the_same_torso_but_disagree():
    xy = np.random.default_rng(2).uniform(0, 20, (33, 2))
    xy[TORSO] = [[60, 0], [0, 0], [50, 100], [10, 100]]
    exchanged = xy.copy()
    exchanged[TORSO] = xy[TORSO][[1, 0, 3, 2]]
    one, other = (Person(each, np.zeros(33), np.zeros(33), 1.0, None) for each in (xy, exchanged))
    assert same_torso(one, other)
    assert disagreement(one, one) == 0 and disagreement(one, other) == pytest.approx(0.5, abs=0.01)


def test_boxes_of_two_people_that_overlap_are_not_averaged():
    box = np.array([[0.5, 0.5], [0.4, 0.4], [0.45, 0.5], [0.45, 0.2], [0, 0], [0, 0]])
    beside = box + [[0.05, 0], [0, 0], [0.15, 0], [0.15, 0], [0, 0], [0, 0]]
    found = _merged(np.stack([box, beside]), np.array([0.9, 0.8]))
    np.testing.assert_allclose(sorted(each[2, 0] for each, _ in found), [0.45, 0.6])


def test_places_in_a_region_and_back():
    region = Region(np.array([410.0, 300.0]), 200.0, np.array([0.6, -0.8]))
    points = np.random.default_rng(0).uniform(0, 1, (5, 2))
    np.testing.assert_allclose(region.from_image(region.to_image(points)), points)


def test_a_person_painted_over_takes_the_colour_around():
    xy = np.full((33, 2), (31.5, 20.0))
    xy[TORSO] = [[40, 24], [24, 24], [38, 44], [26, 44]]
    person = Person(xy, np.zeros(33), np.zeros(33), 1.0, None)
    region = Region.upright(0, 0, 64)
    image = np.full((64, 64, 3), 90, np.uint8)
    image[26:42, 28:36] = 255
    painted = painted_over(image, region, [person])
    assert abs(painted.astype(int) - 90).max() <= 1
    assert painted_over(image, region, []) is image


@pytest.mark.parametrize("degrees", [0, 90, 200])
def test_hips_and_shoulders_are_moved_along_the_torso(degrees):
    """A torso of 100 px: hips rise by 5 and move apart by 0.8 px each; the other landmarks stay."""
    turn = np.array([[np.cos(a := np.radians(degrees)), -np.sin(a)], [np.sin(a), np.cos(a)]])
    upright = np.random.default_rng(0).uniform(0, 300, (2, 33, 2))
    upright[:, TORSO] = [(130, 50), (70, 50), (120, 150), (80, 150)]
    wanted = upright.copy()
    wanted[:, TORSO] = [(130, 48), (70, 48), (120.8, 145), (79.2, 145)]
    np.testing.assert_allclose(corrected_torso(upright @ turn.T), wanted @ turn.T, atol=1e-9)
