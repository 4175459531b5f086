"""Textures of skin, eyes and lips lie where their places on the body are."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from synth.people.body import Body, body_at
from synth.people.outfit import parts
from synth.people.skin import paint_iris, paint_lips, paint_skin
from synth.people.surface import bare_body
from tests.synth.people.test_surfaces import BARE

LIGHT = replace(BARE, skin=(0.77, 0.65, 0.58), hair_colour=(0.1, 0.1, 0.1))


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def colours_at(image: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Return the colours (..., 3), 0 to 1, at texture coordinates (..., 2) of an image whose first row is at 0."""
    column, row = np.floor(uv * len(image)).astype(int).T % len(image)
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
