"""Textures of cloth, floors and walls, painted from noise. Each texture tiles without seams."""

import mujoco
import numpy as np
from scipy.ndimage import gaussian_filter


def paint(pattern: str, colours, size: int, *, rng: np.random.Generator) -> np.ndarray:
    """Return a painted texture, (size, size, 3) uint8 RGB, in two colours: RGB triples, 0..1.

    Patterns are "plain", "stripes", "checks", "melange", "camouflage", "knit" (cloth), "hair", "planks", "tiles",
    "plaster", "carpet", "concrete", "paving", "bricks", "sheet" (rooms); KeyError for others.
    """
    if pattern not in _BLENDS:
        raise KeyError(f"no pattern {pattern!r}; expected one of {', '.join(_BLENDS)}")
    y, x = np.mgrid[:size, :size] / size
    blend, grain = _BLENDS[pattern](x, y, rng)
    first, second = (np.asarray(colour, float) for colour in colours)
    image = first + blend[..., None] * (second - first)
    image = image * (1 + grain[..., None])
    return np.round(np.clip(image, 0, 1) * 255).astype(np.uint8)


def add_texture(spec: mujoco.MjSpec, material: mujoco.MjsMaterial, image: np.ndarray) -> None:
    """Cover a material of the scene with an image, (H, W, 3) uint8."""
    texture = spec.add_texture(
        name=material.name,
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        width=image.shape[1],
        height=image.shape[0],
        nchannel=3,
    )
    texture.data = image.tobytes()
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = texture.name


def noise(x: np.ndarray, rng: np.random.Generator, sigma) -> np.ndarray:
    """Return smooth periodic noise with the shape of `x` and a standard deviation of 1; sigma in px."""
    noise = gaussian_filter(rng.standard_normal(x.shape), sigma, mode="wrap")
    return noise / noise.std()


def _stripes(x, y, rng):
    count = int(rng.integers(3, 8))
    return (np.sin(2 * np.pi * count * y) > rng.uniform(-0.3, 0.6)).astype(float), _cloth(x, rng)


def _checks(x, y, rng):
    count = int(rng.integers(2, 6))
    bars = [(np.sin(2 * np.pi * count * axis) > 0.2).astype(float) for axis in (x, y)]
    return (bars[0] + bars[1]) / 2, _cloth(x, rng)


def _planks(x, y, rng):
    boards = 8
    board = np.floor(y * boards).astype(int)
    tone = rng.uniform(0, 0.5, boards)[board]
    ends = rng.random(boards)[board]
    edge = np.minimum((y * boards) % 1, 1 - (y * boards) % 1)
    joint = np.abs((x - ends + 0.5) % 1 - 0.5)
    gap = (edge < 0.03) | (joint < 0.003)
    return np.clip(tone + 0.18 * noise(x, rng, (1, 22)), 0, 1), np.where(gap, -0.45, 0.02 * noise(x, rng, 1))


def _tiles(x, y, rng):
    tiles = 4
    cell = rng.uniform(0, 0.3, (tiles, tiles))[np.floor(y * tiles).astype(int), np.floor(x * tiles).astype(int)]
    edge = np.minimum(*(np.minimum((a * tiles) % 1, 1 - (a * tiles) % 1) for a in (x, y)))
    return np.where(edge < 0.015, 1.0, cell), 0.025 * noise(x, rng, 2)


def _paving(x, y, rng):
    rows = 6
    row = np.floor(y * rows).astype(int)
    along = x * 4 + rng.random(rows)[row]
    edge = np.minimum(np.minimum((y * rows) % 1, 1 - (y * rows) % 1), np.minimum(along % 1, 1 - along % 1))
    tone = rng.uniform(0, 0.7, (rows, 4))[row, np.floor(along).astype(int) % 4]
    return np.clip(tone + 0.1 * noise(x, rng, 6), 0, 1), np.where(edge < 0.04, -0.3, 0.03 * noise(x, rng, 1))


def _bricks(x, y, rng):
    rows = 8
    row = np.floor(y * rows)
    along = x * rows / 2 + 0.5 * (row % 2)
    edge = np.minimum(np.minimum((y * rows) % 1, 1 - (y * rows) % 1), 2 * np.minimum(along % 1, 1 - along % 1))
    tone = rng.uniform(0, 0.35, (rows, rows // 2))[row.astype(int), np.floor(along).astype(int) % (rows // 2)]
    return np.where(edge < 0.06, 1.0, tone), 0.04 * noise(x, rng, 1) + 0.03 * noise(x, rng, 8)


def _hair(x, y, rng):
    strands, locks = noise(x, rng, (28, 0.5)), noise(x, rng, (48, 3))
    return np.clip(0.45 + 0.15 * strands + 0.1 * locks, 0, 1), 0.05 * noise(x, rng, (10, 0.4))


def _cloth(x, rng):
    """Return the relative brightness of a weave with soft folds."""
    return 0.015 * noise(x, rng, 0.6) + 0.02 * noise(x, rng, (30, 10))


def _knit(x, y, rng):
    """Return upright ribs of slanting stitches."""
    rib = np.abs(np.sin(2 * np.pi * 16 * x))
    stitch = np.sin(2 * np.pi * (40 * y + 0.6 * rib))
    return 0.9 * (1 - rib) ** 2 + 0.06 * stitch, 0.05 * stitch + _cloth(x, rng)


_BLENDS = {
    "hair": _hair,
    "knit": _knit,
    "plain": lambda x, y, rng: (np.zeros_like(x), _cloth(x, rng)),
    "stripes": _stripes,
    "checks": _checks,
    "melange": lambda x, y, rng: (np.clip(0.4 + 0.13 * noise(x, rng, (0.3, 1.2)), 0, 1), _cloth(x, rng)),
    "camouflage": lambda x, y, rng: (
        0.6 * np.clip(6 * noise(x, rng, 18) - 0.7, 0, 1) + 0.4 * np.clip(6 * noise(x, rng, 14) - 3.1, 0, 1),
        _cloth(x, rng),
    ),
    "planks": _planks,
    "tiles": _tiles,
    "plaster": lambda x, y, rng: (np.clip(0.3 + 0.15 * noise(x, rng, 20), 0, 1), 0.012 * noise(x, rng, 1)),
    "carpet": lambda x, y, rng: (np.clip(0.5 + 0.3 * noise(x, rng, 1), 0, 1), 0.05 * noise(x, rng, 16)),
    "concrete": lambda x, y, rng: (
        np.clip(0.4 + 0.22 * noise(x, rng, 24) + 0.12 * noise(x, rng, 5), 0, 1),
        0.02 * noise(x, rng, 1),
    ),
    "paving": _paving,
    "bricks": _bricks,
    # Corrugated steel with upright ribs
    "sheet": lambda x, y, rng: (0.5 + 0.5 * np.sin(2 * np.pi * 8 * x), 0.02 * noise(x, rng, (30, 3))),
}
"""Functions of x and y (S, S), 0..1, and of `rng`. Each returns the blend of the two colours, 0..1, and the relative
change of brightness, both (S, S)."""
