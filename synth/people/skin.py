"""Textures of skin, eyes, lips and shoes. Where each is on the body is told by the texture coordinates from here as
well."""

import cv2
import numpy as np
from scipy.interpolate import LinearNDInterpolator

from synth.people.body import SEGMENTS, Body
from synth.people.clothing import PersonLooks
from synth.people.surface import bare_body
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
# From the forehead over temples, sideburns and ears to the nape, and round the crown: ahead of the eyes and above them,
# fractions of stature and of the head's size.
HAIRLINE = ((0.05, 0.043), (0.0, 0.040), (-0.020, 0.036), (-0.028, 0.020), (-0.029, -0.003), (-0.036, -0.005),
            (-0.041, 0.017), (-0.067, 0.021), (-0.075, -0.010), (-0.081, -0.032), (-0.2, -0.046), (-0.2, 0.2),
            (0.05, 0.2))  # fmt: skip
BEARD_LINE = ((-0.035, 0.001), (-0.026, -0.002), (-0.020, -0.018), (-0.010, -0.031), (0.002, -0.033), (0.010, -0.0295),
              (0.06, -0.0295), (0.06, -0.10), (0.000, -0.088), (-0.024, -0.066), (-0.037, -0.036))  # fmt: skip
"""Around a full beard from the sideburns over cheeks, moustache and throat, as `HAIRLINE`."""
_SHADOWS = {"stubble": 0.42, "short": 0.4, "goatee": 0.2, "full": 0.4}
"""How dark the hair of beards makes the skin, 0 to 1."""
_FADE = 0.007
"""Width of the skin before the hairline on which hair grows sparsely, fraction of stature."""


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
        0.15 * blotches
        + 0.9 * spot(38, -0.022, 14, 0.013)
        + 0.8 * spot(0, -0.022, 7, 0.008)
        + spot(90, -0.01, 12, 0.02)
    )
    dark = 0.012 * grain + 0.012 * blotches
    dark += 0.16 * spot(18, -0.001, 7, 0.006) + 0.06 * spot(18, -0.010, 7, 0.005)
    colour = np.array(looks.skin) * (1 - dark[..., None])
    # Blood takes green, and less of blue, from light skin; on dark skin it hardly shows.
    colour = colour * (1 - 0.10 * max(looks.skin) * np.clip(red, -1, 1.2)[..., None] * (0.1, 1, 0.7))
    if body.figure < 0.5 and body.age >= 18:
        beard = head * np.clip((-0.024 - above) / 0.008, 0, 1) * np.clip((above + 0.078) / 0.012, 0, 1)
        shadow = rng.uniform(0, 0.30)
        beard *= np.clip((88 - np.abs(angle)) / 14, 0, 1) * _SHADOWS.get(looks.beard or "", shadow)
        colour += (beard * (1 + 0.2 * noise(x, rng, 0.7)))[..., None] * (0.6 * np.array(looks.hair_colour) - colour)
    sparse = np.zeros_like(x)
    sparse[_SIDE // 2 :] = _sparse_hair(body, looks, rng=rng)
    # Ears are bare.
    sparse *= 1 - spot(96, 0, 24, 0.028)
    colour += (sparse * (1 + 0.25 * noise(x, rng, (2, 0.5))))[..., None].clip(0, 1) * (looks.hair_colour - colour)
    return _bytes(colour)


def _sparse_hair(body: Body, looks: PersonLooks, *, rng: np.random.Generator) -> np.ndarray:
    """Return how much hair covers the skin of the head, 0 to 1, in the upper half of the texture, (256, 512): less and
    less before the hairline, and a shaved shadow within it on the bald."""
    bare, head, size = bare_body(body, looks.hands), SEGMENTS.index("head"), body.stature * body.head
    own = bare.vertices[bare.weights[:, head] > 0.8][::4]
    x, y, z = (own - bare.origins[head]).T
    eye = bare.eyes.mean((0, 1)) - bare.origins[head]
    # How far ahead of the eyes the skin is, by the angle around the head and the height; it is smooth.
    rows, columns = _SIDE // 16, _SIDE // 8
    angle, above = np.arctan2(y, x), (z - eye[2]) / size
    around = np.concatenate([angle - 2 * np.pi, angle, angle + 2 * np.pi])
    ahead = LinearNDInterpolator(np.column_stack([around, 20 * np.tile(above, 3)]), np.tile((x - eye[0]) / size, 3))
    height = ((np.arange(rows) + 0.5) / rows / 2 + 0.5 - _EYES) * _TALL
    turn = 2 * np.pi * ((np.arange(columns) + 0.5) / columns - 0.5)
    place = np.nan_to_num(ahead(*np.meshgrid(turn, 20 * height)), nan=float(ahead(0.0, 0.0)))
    step = 0.001
    corners = np.round(np.array(HAIRLINE) / step + 250).astype(np.int32)
    inside = cv2.fillPoly(np.zeros((500, 500), np.uint8), [corners], 1)
    field = cv2.distanceTransform(inside, cv2.DIST_L2, 5) - cv2.distanceTransform(1 - inside, cv2.DIST_L2, 5)
    grid = [cv2.resize(each, (_SIDE, _SIDE // 2)) for each in (place, np.repeat(height[:, None], columns, 1))]
    column, row = (np.round(each / step + 250).astype(int).clip(0, 499) for each in grid)
    within = step * field[row, column]
    if looks.hair == "bald":
        # Around the crown nothing grows.
        return rng.uniform(0, 0.3) * np.clip(within / 0.012, 0, 1) * np.clip((0.075 - grid[1]) / 0.02, 0, 1)
    return 0.8 * np.clip(1 + within / _FADE, 0, 1)


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
    # The corners of the mouth are higher than the middle of the line between the lips.
    between = arch * (0.04 * np.cos(9 * x) - 0.14)
    image = skin + inside * (lip * np.where(y > between, 0.9, 1.04 - 0.25 * (y + 0.35) ** 2)[..., None] - skin)
    line = np.exp(-(((y - between) / 0.07) ** 2)) * arch
    return _bytes(image * (1 - 0.6 * line)[..., None])


def paint_shoe(looks: PersonLooks, *, rng: np.random.Generator) -> np.ndarray:
    """Return the texture of a shoe seen from above, (128, 128, 3) uint8 RGB, from the heel to the toes: a cap over the
    toes, a counter around the heel, a tongue and laces."""
    y, x = (np.mgrid[:128, :128] + 0.5) / 128
    aside = np.abs(y - 0.5)
    colour = np.array(looks.shoes) * (1 + 0.02 * noise(x, rng, 0.7) + 0.02 * noise(x, rng, 6))[..., None]
    seam = np.exp(-(((x - 0.84 + 0.9 * aside**2) / 0.012) ** 2)) + np.exp(-(((x - 0.2) / 0.012) ** 2))
    tongue = np.clip((0.15 - aside) / 0.02, 0, 1) * np.clip((0.76 - x) / 0.02, 0, 1) * np.clip((x - 0.34) / 0.02, 0, 1)
    colour *= (1 - 0.35 * np.clip(seam, 0, 1) - 0.22 * tongue)[..., None]
    laces = tongue * np.clip(3 * np.sin(2 * np.pi * (x - 0.34) / 0.07) - 1.5, 0, 1)
    bright = 0.88 if sum(looks.shoes) < 1.5 or rng.random() < 0.5 else 0.2
    return _bytes(colour + laces[..., None] * (bright - colour))


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
