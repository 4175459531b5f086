"""Hats cover hair, and stand off no head; beards leave lips bare."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from synth.people.accessories import Crown
from synth.people.body import Body, body_at
from synth.people.clothing import BEARDS, HAIRSTYLES, HATS, Hat
from synth.people.outfit import parts
from synth.people.skin import paint_skin
from synth.people.surface import bare_body
from tests.synth.people.test_surfaces import BARE

_RED = ((0.6, 0.1, 0.1), (0.4, 0.1, 0.1))


@pytest.mark.parametrize("kind", HATS)
@pytest.mark.parametrize("body", [Body(), Body(1.6, 60, 1.0), body_at(0, 5)])
def test_no_hair_and_no_skin_comes_through_a_hat(kind, body):
    size, eyes = body.stature * body.head, bare_body(body).eyes.mean((0, 1))
    for style in HAIRSTYLES:
        found = {}
        for part in parts(body, replace(BARE, hair=style, hat=Hat(kind, _RED))):
            if part.segment == "head":
                found.setdefault(part.material, []).append(part.vertices)
        points = {material: np.concatenate(each) for material, each in found.items()}
        head = points["skin"][points["skin"][:, 2] > eyes[2] - 0.1 * size]
        crown = Crown.of(kind, head, eyes, size)
        inside = np.concatenate([head, *found.get("hair", [])])
        inside = inside[crown.above(inside) > 0.002 * size]
        out = inside - crown.middle
        far = np.linalg.norm(out, axis=1)
        room = crown.radius(out / far[:, None]) + crown.clearance(np.pi, np.zeros(len(out)))
        assert (far < room).all(), style
        # Hair that falls reaches as far down as without a hat.
        assert style in ("short", "bald") or points["hair"][:, 2].min() < eyes[2] - 0.015 * size
        gap = cKDTree(head).query(points["hat"])[0]
        assert gap.max() < 0.035 * size
        # Eyes and brows are bare.
        assert points["hat"][:, 2].min() > eyes[2] - 0.05 * size
        front = points["hat"][points["hat"][:, 0] > eyes[0]]
        assert front[:, 2].min() > eyes[2] + 0.015 * size


@pytest.mark.parametrize("body", [Body(), Body(1.9, 110)])
def test_beards_grow_around_the_mouth(body):
    size, eyes = body.stature * body.head, bare_body(body).eyes.mean((0, 1))
    reach = {}
    for beard in (None, *BEARDS):
        found = [part for part in parts(body, replace(BARE, beard=beard)) if part.segment == "head"]
        hair = [part.vertices for part in found if part.material == "hair"]
        if beard in (None, "stubble"):
            assert not hair
            continue
        points, faces = np.concatenate(hair), [part for part in found if part.material == "lip"]
        lips = np.concatenate([part.vertices for part in faces])
        inner = np.hypot(*((lips[:, 1:] - lips[:, 1:].mean(0)) / np.ptp(lips[:, 1:], axis=0)).T) < 0.35
        assert cKDTree(points).query(lips[inner])[0].min() > 0.0008 * size
        assert points[:, 2].max() < eyes[2] + 0.01 * size
        reach[beard] = points[:, 2].min() - eyes[2], np.ptp(points[:, 1]), points[:, 0].max()
    assert reach["goatee"][1] < 0.7 * reach["full"][1]
    assert reach["full"][2] > reach["short"][2] + 0.003 * size


def test_a_beard_darkens_the_skin_and_draws_nothing():
    images = [paint_skin(Body(), replace(BARE, hair_colour=(0.1,) * 3, beard=beard), rng=np.random.default_rng(4))
              for beard in (None, "stubble")]  # fmt: skip
    chin, arm = np.s_[280:330, 200:312], np.s_[:250]
    assert images[1][chin].mean() < images[0][chin].mean()
    np.testing.assert_array_equal(images[0][arm], images[1][arm])
