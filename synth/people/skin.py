"""Textures of skin, eyes and lips. Where each is on the body is told by the texture coordinates from here as well."""

import numpy as np

from synth.people.body import Body
from synth.people.clothing import PersonLooks
from synth.textures import noise

_SIDE = 512
"""Side of the texture of skin, px. Its upper half is the head, once around; its lower half is all other segments."""
_TALL = 0.45
"""Height on the head that the side of the texture covers, fractions of stature and of the head's size."""
_EYES = 0.75
"""Height of the eyes in the texture."""
_LONG = 0.45
"""Greatest distance of skin from the origin of its segment along it, m; it covers nearly a quarter of the texture."""
_MARGIN = 0.01


def around_head(angle: np.ndarray, above_eyes: np.ndarray) -> np.ndarray:
    """Return texture coordinates (..., 2) on the head.

    Args:
        angle: From the face to the left, rad.
        above_eyes: Height above the eyes, fractions of stature and of the head's size.
    """
    return np.stack([angle / (2 * np.pi) + 0.5, np.clip(_EYES + above_eyes / _TALL, 0.5 + _MARGIN, 1 - _MARGIN)], -1)


def around_limb(angle: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Return texture coordinates (..., 2) on any other segment, from the angle around it, rad, and the place along it,
    m."""
    return np.stack([angle / (2 * np.pi) + 0.5, 0.25 + (0.25 - _MARGIN) * np.clip(along / _LONG, -1, 1)], -1)


def paint_skin(body: Body, looks: PersonLooks, *, rng: np.random.Generator) -> np.ndarray:
    """Return the texture of skin, (512, 512, 3) uint8 RGB: blotches, red cheeks, nose and ears, darker eye sockets, and
    the shadow of a beard on some men."""
    y, x = (np.mgrid[:_SIDE, :_SIDE] + 0.5) / _SIDE
    angle, above = np.degrees(2 * np.pi * (x - 0.5)), (y - _EYES) * _TALL
    head = y > 0.5

    def spot(aside: float, height: float, wide: float, tall: float) -> np.ndarray:
        """Return a spot on both sides of the face, 1 in the middle: degrees, and fractions as of `around_head`."""
        return head * np.exp(-(((np.abs(angle) - aside) / wide) ** 2) - ((above - height) / tall) ** 2)

    # A pixel of limbs is 4 mm long and about 0.5 mm wide.
    blotches = np.where(head, noise(x, rng, (5, 4)), noise(x, rng, (2, 15)))
    grain = np.where(head, noise(x, rng, 0.8), noise(x, rng, (0.6, 5)))
    red = (
        0.25 * blotches
        + 0.9 * spot(38, -0.022, 14, 0.013)
        + 0.8 * spot(0, -0.022, 7, 0.008)
        + spot(90, -0.01, 12, 0.02)
    )
    dark = 0.012 * grain + 0.012 * blotches
    dark += 0.16 * spot(18, -0.001, 7, 0.006) + 0.06 * spot(18, -0.010, 7, 0.005)
    colour = np.array(looks.skin) * (1 - dark[..., None])
    # Blood takes green and blue from light skin; on dark skin it hardly shows.
    colour = colour * (1 - 0.10 * max(looks.skin) * np.clip(red, -1, 1.2)[..., None] * (0.1, 1, 0.9))
    if body.figure < 0.5 and body.age >= 18:
        beard = head * np.clip((-0.024 - above) / 0.008, 0, 1) * np.clip((above + 0.078) / 0.012, 0, 1)
        beard *= np.clip((88 - np.abs(angle)) / 14, 0, 1) * rng.uniform(0, 0.30)
        colour += (beard * (1 + 0.2 * noise(x, rng, 0.7)))[..., None] * (0.6 * np.array(looks.hair_colour) - colour)
    return _bytes(colour)


_IRISES = ((0.17, 0.10, 0.06), (0.28, 0.17, 0.09), (0.33, 0.27, 0.14), (0.34, 0.42, 0.48), (0.30, 0.36, 0.27))
_LIGHT = 1.7
"""Sum of a skin's colour above which irises may be other than brown."""


def paint_iris(looks: PersonLooks, *, rng: np.random.Generator) -> np.ndarray:
    """Return the texture of an iris, (64, 64, 3) uint8 RGB: its edge is the circle in the square."""
    x, y, away = _disc(64)
    colour = np.array(_IRISES[rng.integers(len(_IRISES) if sum(looks.skin) > _LIGHT else 2)])
    rays = 1 + 0.25 * np.sin(17 * np.arctan2(y, x) + 2 * np.sin(5 * np.arctan2(y, x)))
    shade = np.interp(away, (0.36, 0.44, 0.7, 0.85, 1), (0.12, 0.9, 1.3, 1.0, 0.35)) * np.where(away > 0.4, rays, 1)
    # The upper lid throws a shadow.
    image = colour * (shade * np.interp(y, (0.1, 0.7), (1, 0.5)))[..., None]
    glint = np.clip(1.5 - np.hypot(x + 0.3, y - 0.3) / 0.12, 0, 1)[..., None]
    return _bytes(image + glint * (0.85 - image))


def paint_lips(body: Body, looks: PersonLooks, *, rng: np.random.Generator) -> np.ndarray:
    """Return the texture of the mouth, (128, 128, 3) uint8 RGB: an ellipse of lips with skin around them."""
    x, y, _ = _disc(128)
    arch = np.clip(1 - (x / 0.94) ** 2, 0, 1)
    upper = 0.80 * arch**0.8 * (1 - 0.22 * np.exp(-((x / 0.13) ** 2)))
    lower = 0.85 * arch
    inside = np.clip(np.where(y > 0, upper - y, lower + y) / 0.14, 0, 1)[..., None]
    skin, red = np.array(looks.skin), rng.uniform(0.8, 1.2) * (1.0 if body.figure > 0.5 else 0.7)
    lip = skin * (1 - red * np.array((0.12, 0.36, 0.38)))
    image = skin + inside * (lip * np.where(y > 0, 0.9, 1.04 - 0.25 * (y + 0.35) ** 2)[..., None] - skin)
    line = np.exp(-(((y - 0.08 * arch + 0.04 * np.cos(9 * x)) / 0.07) ** 2)) * arch
    return _bytes(image * (1 - 0.6 * line)[..., None])


def on_disc(places: np.ndarray) -> np.ndarray:
    """Return texture coordinates (T, 3, 2) that spread places (T, 3, 2), to the left and up, over a square texture."""
    low, high = places.min((0, 1)), places.max((0, 1))
    return (places - low) / (high - low)


def _disc(side: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return x, y and the distance from the middle of a square texture, (side, side), from -1 to 1."""
    y, x = (np.mgrid[:side, :side] + 0.5) / side * 2 - 1
    return x, y, np.hypot(x, y)


def _bytes(image: np.ndarray) -> np.ndarray:
    return np.round(np.clip(image, 0, 1) * 255).astype(np.uint8)
