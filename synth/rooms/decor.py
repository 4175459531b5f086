"""The look of a room: coverings, colours and light. It is random in every clip, or as in the room's file."""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from dmae.files.contents import cached_until_changed
from synth.rooms.room import read_mjcf

Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Finish:
    """The covering of a floor or wall: a pattern of `synth.textures` and its two RGB colours."""

    pattern: str
    colours: tuple[Colour, Colour]


@dataclass(frozen=True)
class Light:
    """Changes of a room's own lights."""

    turn: float = 0.0  # Turn of all lights about the vertical through the origin, rad
    strength: float = 1.0  # Factor of the brightness of all lights
    tint: Colour = (1.0, 1.0, 1.0)  # Factors of the red, green and blue of all lights


@dataclass(frozen=True)
class Decor:
    """The coverings of floor and walls, the light, and the colours of the room's tinted materials, by name."""

    floor: Finish
    wall: Finish
    light: Light = Light()
    tints: tuple[tuple[str, Colour], ...] = ()


def _plain(pattern: str, colour: Colour, shade: float = 0.9) -> Finish:
    red, green, blue = (round(shade * c, 3) for c in colour)
    return Finish(pattern, (colour, (red, green, blue)))


FINISHES = {
    "oak": Finish("planks", ((0.58, 0.42, 0.28), (0.42, 0.28, 0.17))),
    "ash": Finish("planks", ((0.66, 0.58, 0.47), (0.52, 0.44, 0.34))),
    "tiles": Finish("tiles", ((0.66, 0.66, 0.64), (0.50, 0.50, 0.49))),
    "grey_carpet": Finish("carpet", ((0.36, 0.39, 0.44), (0.26, 0.28, 0.33))),
    "sand_carpet": Finish("carpet", ((0.50, 0.45, 0.40), (0.38, 0.34, 0.30))),
    "concrete": Finish("concrete", ((0.56, 0.56, 0.55), (0.44, 0.44, 0.43))),
    "dark_concrete": Finish("concrete", ((0.42, 0.43, 0.45), (0.32, 0.33, 0.35))),
    "paving": Finish("paving", ((0.60, 0.56, 0.50), (0.44, 0.41, 0.37))),
    "cobbles": Finish("paving", ((0.48, 0.48, 0.50), (0.33, 0.33, 0.35))),
    "cream": _plain("plaster", (0.82, 0.81, 0.77)),
    "sky": _plain("plaster", (0.72, 0.77, 0.80)),
    "sand": _plain("plaster", (0.80, 0.76, 0.68)),
    "sage": _plain("plaster", (0.70, 0.74, 0.68)),
    "grey": _plain("plaster", (0.62, 0.62, 0.64)),
    "white": _plain("plaster", (0.88, 0.88, 0.87), 0.95),
    "brick": Finish("bricks", ((0.56, 0.33, 0.26), (0.68, 0.64, 0.60))),
    "pale_brick": Finish("bricks", ((0.72, 0.66, 0.58), (0.60, 0.57, 0.53))),
    "sheet": Finish("sheet", ((0.66, 0.69, 0.72), (0.50, 0.53, 0.56))),
}
_USUAL = {
    "floor": ("oak", "ash", "tiles", "grey_carpet", "sand_carpet"),
    "wall": ("cream", "sky", "sand", "sage", "grey"),
}
_TINTS = ((0.55, 0.42, 0.29), (0.24, 0.36, 0.52), (0.58, 0.20, 0.18), (0.30, 0.44, 0.34), (0.78, 0.74, 0.66),
          (0.35, 0.35, 0.38), (0.80, 0.60, 0.24), (0.70, 0.45, 0.36), (0.45, 0.52, 0.58))  # fmt: skip


@cached_until_changed(32)
def _choices(arena: Path) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Return the possible finishes of the floor and of the walls, and the materials that take any colour."""
    room = read_mjcf(arena)
    texts = {text.name: tuple(text.data.split()) for text in room.texts}
    finishes = []
    for name, usual in _USUAL.items():
        finishes.append(texts.get(name, usual))
        unknown = sorted(set(finishes[-1]) - set(FINISHES))
        if unknown or not finishes[-1]:
            raise ValueError(f"arena {arena}: text {name!r} names {unknown}; expected some of {sorted(FINISHES)}")
    floor, walls = finishes
    return floor, walls, tuple(sorted(m.name for m in room.materials if m.name.startswith("tint")))


def sample_decor(arena: Path, *, randomize: bool, rng: np.random.Generator) -> Decor:
    """Return the look of a room's MJCF file, drawn at random if `randomize`.

    A custom text "floor" or "wall" in it lists the possible finishes, with the default finish first; ValueError if one
    is unknown. Materials with names that start with "tint" take any colour.
    """
    floors, walls, materials = _choices(arena)
    if not randomize:
        return Decor(FINISHES[floors[0]], FINISHES[walls[0]])
    floor, wall = (FINISHES[str(rng.choice(names))] for names in (floors, walls))
    warmth = rng.uniform(-0.06, 0.06)
    light = Light(
        turn=float(rng.uniform(-np.pi, np.pi)),
        strength=float(rng.uniform(0.85, 1.12)),
        tint=(1 + warmth, 1.0, 1 - warmth),
    )
    # Two materials get the same colour only if there are more materials than colours.
    order = np.resize(rng.permutation(len(_TINTS)), len(materials))
    return Decor(floor, wall, light, tuple((name, _TINTS[tint]) for name, tint in zip(materials, order, strict=True)))


def sample_tint(*, rng: np.random.Generator) -> Colour:
    """Return a random colour of paint or cloth."""
    return _TINTS[rng.integers(len(_TINTS))]


def decorate(world: mujoco.MjSpec, decor: Decor) -> None:
    """Change the lights and colours of a room. `synth.scene.build` paints the coverings."""
    for name, colour in decor.tints:
        world.material(name).rgba = [*colour, 1]
    tint = decor.light.strength * np.array(decor.light.tint)
    turn = Rotation.from_rotvec((0, 0, decor.light.turn)).as_matrix()
    for light in world.lights:
        light.diffuse = np.clip(light.diffuse * tint, 0, 1)
        light.dir, light.pos = turn @ light.dir, turn @ light.pos
    head = world.visual.headlight
    head.ambient = np.clip(head.ambient * tint, 0, 1)
