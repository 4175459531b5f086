"""Textures of skin, eyes, lips and clothes lie where their places on the body are."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree

from synth.people.body import SEGMENTS, Body, body_at
from synth.people.clothing import Garment, sample_looks
from synth.people.outfit import paint_clothes, parts
from synth.people.skin import paint_iris, paint_lips, paint_shoe, paint_skin
from synth.people.surface import bare_body
from tests.synth.people.test_surfaces import BARE

LIGHT = replace(BARE, skin=(0.77, 0.65, 0.58), hair_colour=(0.1, 0.1, 0.1))


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def colours_at(image: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Return the colours (..., 3), 0 to 1, at texture coordinates (..., 2) of an image whose first row is at 0."""
    column, row = (np.floor(uv * image.shape[1::-1]).astype(int) % image.shape[1::-1]).T
    return image[row, column] / 255


@pytest.mark.parametrize("body", [Body(), Body(1.6, 60, 1.0), body_at(0, 6)])
def test_eye_sockets_are_dark_and_noses_red(body):
    skin = [part for part in parts(body, LIGHT) if (part.material, part.segment) == ("skin", "head")]
    corners = np.concatenate([part.vertices[part.faces].reshape(-1, 3) for part in skin])
    colours = colours_at(paint_skin(body, LIGHT, rng=rng()), np.concatenate([part.uv.reshape(-1, 2) for part in skin]))
    eyes = bare_body(body).eyes.mean(1)
    size = body.stature * body.head
    near = cKDTree(corners).query(eyes, 30)[1].ravel()
    forehead = (np.abs(corners[:, 1]) < 0.02 * size) & (np.abs(corners[:, 2] - eyes[0, 2] - 0.03 * size) < 0.006 * size)
    forehead &= corners[:, 0] > eyes[0, 0]
    assert colours[near].mean() < 0.95 * colours[forehead].mean()
    nose = cKDTree(corners).query(corners[corners[:, 0].argmax()], 30)[1]
    redness = colours[:, 0] / colours.mean(1)
    assert redness[nose].mean() > redness[forehead].mean() + 0.02


def test_limbs_have_the_colour_of_skin():
    image = paint_skin(Body(), LIGHT, rng=rng())
    for part in parts(Body(), LIGHT):
        if part.material == "skin" and part.segment != "head":
            np.testing.assert_allclose(colours_at(image, part.uv.reshape(-1, 2)).mean(0), LIGHT.skin, atol=0.02)


@pytest.mark.parametrize("material", ["iris", "lip"])
def test_irises_and_lips_fill_their_textures(material):
    for part in parts(Body(), LIGHT):
        if part.material == material:
            np.testing.assert_allclose([part.uv.min((0, 1)), part.uv.max((0, 1))], [[0, 0], [1, 1]])


def test_lips_end_in_the_colour_of_the_skin_and_pupils_are_black():
    lips = paint_lips(Body(), LIGHT, rng=rng()) / 255
    np.testing.assert_allclose(lips[[0, -1, 64, 64], [64, 64, 0, -1]], np.tile(LIGHT.skin, (4, 1)), atol=0.03)
    # The lower lip is in the lower half of the face.
    assert lips[30:60, 64].mean(0)[1] < lips[2, 64][1] - 0.05
    iris = paint_iris(LIGHT, rng=rng())
    assert iris[28:36, 28:36].max() < 60 < iris[8:24, 28:36].max()
    # The corners of the mouth are not lower than its middle.
    dark = lips.mean(2).argmin(0)
    assert dark[[24, 103]].min() >= dark[64]


def test_no_skin_is_nearly_white():
    drawn = np.array([sample_looks(0.5, rng=np.random.default_rng(seed)).skin for seed in range(300)], np.float32)
    lightness = cv2.cvtColor(drawn[None], cv2.COLOR_RGB2LAB)[0, :, 0]
    assert 65 < lightness.max() < 73 and lightness.min() < 40


@pytest.mark.parametrize("body", [Body(), Body(1.6, 60, 1.0), body_at(0, 6)])
def test_hair_thins_out_on_the_skin_before_the_hairline(body):
    looks = replace(LIGHT, hair="short")
    found = parts(body, looks)
    hair = cKDTree(np.concatenate([part.vertices for part in found if part.material == "hair"]))
    skin = [part for part in found if (part.material, part.segment) == ("skin", "head")]
    corners = np.concatenate([part.vertices[part.faces].reshape(-1, 3) for part in skin])
    colours = colours_at(paint_skin(body, looks, rng=rng()), np.concatenate([part.uv.reshape(-1, 2) for part in skin]))
    eye, size = bare_body(body).eyes.mean((0, 1)), body.stature * body.head
    forehead = (np.abs(corners[:, 1]) < 0.02 * size) & (corners[:, 0] > eye[0] - 0.01 * size)
    forehead &= corners[:, 2] > eye[2] + 0.015 * size
    away = hair.query(corners)[0]
    near, far = colours[forehead & (away < 0.003 * size)], colours[forehead & (away > 0.012 * size)]
    assert near.mean() < 0.75 * far.mean()


def test_shoes_have_laces_across_the_foot():
    for part in parts(Body(), LIGHT):
        if part.material == "shoe" and part.segment.endswith("foot"):
            corners, uv = part.vertices[part.faces].reshape(-1, 3), part.uv.reshape(-1, 2)
            toes = bare_body(Body()).rotations[SEGMENTS.index(part.segment)][:, 0]
            assert np.corrcoef(corners @ toes, uv[:, 0])[0, 1] > 0.999
    image = paint_shoe(replace(LIGHT, shoes=(0.1, 0.1, 0.1)), rng=rng()).mean(2)
    across = np.diff((image[64] > 120).astype(int))
    assert (across == 1).sum() == 6


def worn(body: Body, looks, material: str, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return corners (N, 3) of a garment in the bind pose, and their colours (N, 3), 0 to 1."""
    own = [part for part in parts(body, looks) if part.material == material]
    image = paint_clothes(body, looks, 256, rng=np.random.default_rng(seed))[material]
    uv = np.concatenate([part.uv.reshape(-1, 2) for part in own])
    return np.concatenate([part.vertices[part.faces].reshape(-1, 3) for part in own]), colours_at(image, uv)


@pytest.mark.parametrize("body", [Body(), Body(1.6, 60, 1.0), Body(2.0, 90), body_at(0, 6)])
def test_a_belt_goes_round_the_waist_of_those_whose_shirt_is_tucked_in(body):
    band = 0.074 * body.stature - 0.018
    for untucked in (True, False):
        corners, colours = worn(body, replace(LIGHT, untucked=untucked), "bottom")
        sides = corners[:, 0] < 0  # The buckle is in front.
        around = colours[sides & (np.abs(corners[:, 2] - band) < 0.010)]
        assert untucked == (around.mean() > 0.4 if len(around) else True)


@pytest.mark.parametrize("body", [Body(), Body(1.6, 60, 1.0), body_at(0, 6)])
def test_trousers_have_a_seam_up_each_side(body):
    looks = replace(LIGHT, bottom=replace(LIGHT.bottom, long=True))
    image = paint_clothes(body, looks, 256, rng=rng())["bottom"].mean(2)
    dark = np.median(image, 0)
    assert set(np.flatnonzero(dark < 0.75 * np.median(dark))) <= {127, 128, 383, 384}
    for part in parts(body, looks):
        if (part.material, part.segment) == ("bottom", "l_thigh"):
            corners, uv = part.vertices[part.faces].reshape(-1, 3), part.uv.reshape(-1, 2)
            outer = corners[(np.abs(uv[:, 0] - 0.25) < 0.02)]
            assert outer[:, 1].min() > corners[:, 1].mean()


def test_buttons_are_in_front_and_hems_of_sweaters_are_ribbed():
    checked = replace(LIGHT, top=Garment(True, "checks", ((0.2,) * 3, (0.3,) * 3)))
    found = [paint_clothes(Body(), checked, 256, rng=np.random.default_rng(seed))["top"] for seed in range(20)]
    white = [np.flatnonzero((image.min(2) > 200).any(0)) for image in found]
    assert 9 < sum(len(each) > 0 for each in white) < 19
    for columns in white:
        assert np.minimum(columns, 768 - columns).max(initial=0) < 8
    plain = replace(LIGHT, top=Garment(True, "plain", ((0.5,) * 3, (0.5,) * 3)), untucked=True)
    found = [paint_clothes(Body(), plain, 256, rng=np.random.default_rng(seed))["top"] for seed in range(20)]
    # Heights of 10 mm below and 100 mm above the hip joints
    hem, above = (np.array([image[row].std() for image in found]) for row in (-9, 85))
    assert 3 < (hem > 1.5 * above).sum() < 17
