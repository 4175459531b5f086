"""Hats cover hair, and stand off no head."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from synth.people.accessories import Crown
from synth.people.body import Body, body_at
from synth.people.clothing import HAIRSTYLES, HATS, Hat
from synth.people.outfit import parts
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
