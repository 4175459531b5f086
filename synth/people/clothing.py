"""Clothes, hair and colours of people."""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from dmae.files.checks import check_numbers
from synth.people.body import ADULT_AGE, SIDES, Body

HAIRSTYLES = ("short", "bald", "bob", "long", "bun")
HANDS = ("relaxed", "open", "grip", "fist", "point", "clasp")
PATTERNS = ("plain", "stripes", "checks", "melange", "camouflage")
HATS = ("cap", "beanie")
BEARDS = ("stubble", "short", "goatee", "full")
BAGS = ("backpack", "shoulder_bag")
WARDROBE = ("caps", "beards", "bags", "skirts", "coats")
"""What people may wear besides shirts, trousers and shoes. New words go last: each draws from a stream by its place."""


@dataclass(frozen=True)
class Garment:
    """A shirt or a pair of trousers."""

    long: bool  # Whether sleeves reach the wrists or legs the ankles, rather than elbows or knees
    pattern: str  # One of `PATTERNS`
    colours: tuple[tuple[float, float, float], tuple[float, float, float]]  # Two RGB triples, 0..1

    def __post_init__(self):
        if self.pattern not in PATTERNS:
            raise ValueError(f"no pattern {self.pattern!r}; expected one of {', '.join(PATTERNS)}")
        check_numbers("colours of a garment", self.colours, 1, 0)


@dataclass(frozen=True)
class Hat:
    """A hat: a cap with a brim, or a woollen hat, a beanie."""

    kind: str  # One of `HATS`
    colours: tuple[tuple[float, float, float], tuple[float, float, float]]  # Two RGB triples, 0..1

    def __post_init__(self):
        if self.kind not in HATS:
            raise ValueError(f"no hat {self.kind!r}; expected one of {', '.join(HATS)}")
        check_numbers("colours of a hat", self.colours, 1, 0)


@dataclass(frozen=True)
class Bag:
    """A backpack, or a bag at the hip with a strap over the other shoulder."""

    kind: str  # One of `BAGS`
    side: str  # Hip that a shoulder bag is at, `l` or `r`
    colours: tuple[tuple[float, float, float], tuple[float, float, float]]  # RGB of the bag and its straps, 0..1

    def __post_init__(self):
        if self.kind not in BAGS or self.side not in SIDES:
            raise ValueError(f"bag {self.kind!r} on side {self.side!r}; expected one of {', '.join(BAGS)}, and l or r")
        check_numbers("colours of a bag", self.colours, 1, 0)


@dataclass(frozen=True)
class Coat:
    """A coat or a jacket over the shirt."""

    cloth: Garment  # If long, it reaches the knees rather than the hips
    open: bool  # Whether it is open in front


@dataclass(frozen=True)
class PersonLooks:
    """Colours, hair and clothes of a person; colours are RGB, 0..1."""

    skin: tuple[float, float, float]  # Colour of the skin
    hair: str  # One of `HAIRSTYLES`
    hair_colour: tuple[float, float, float]  # Colour of hair and brows
    top: Garment  # Shirt
    bottom: Garment  # Trousers
    shoes: tuple[float, float, float]  # Colour of the shoes
    sole: tuple[float, float, float]  # Colour of their soles
    untucked: bool  # Whether the shirt hangs over the trousers
    # Shapes of the left and the right hand, of `HANDS`; None for a surface whose fingers follow bones
    hands: tuple[str, str] | None = ("relaxed", "relaxed")
    hat: Hat | None = None  # Hat, if any; hair above its rim is not seen
    beard: str | None = None  # One of `BEARDS`, if any
    bag: Bag | None = None  # Bag, if any
    coat: Coat | None = None  # Coat, if any
    skirt: bool = False  # Whether `bottom` is a skirt, to the knees or, if long, to the calves; `top` is tucked into it

    def __post_init__(self):
        if self.hands is not None and (len(self.hands) != 2 or set(self.hands) - set(HANDS)):
            raise ValueError(f"hands {self.hands!r}: expected two of {', '.join(HANDS)}")
        if self.hair not in HAIRSTYLES:
            raise ValueError(f"no hairstyle {self.hair!r}; expected one of {', '.join(HAIRSTYLES)}")
        if self.beard is not None and self.beard not in BEARDS:
            raise ValueError(f"no beard {self.beard!r}; expected one of {', '.join(BEARDS)}")
        check_numbers("colours of a person", (self.skin, self.hair_colour, self.shoes, self.sole), 1, 0)


# One tone for each class of skin by its individual typology angle in CIELAB, arctan((L* - 50) / b*): 58, 48, 34, 19,
# -10 and -49 degrees (Chardon et al., International Journal of Cosmetic Science 13, 1991). No skin is much lighter.
_SKINS = ((0.79, 0.65, 0.57), (0.76, 0.61, 0.52), (0.71, 0.56, 0.47), (0.66, 0.50, 0.40), (0.55, 0.40, 0.33),
          (0.42, 0.31, 0.26))  # fmt: skip
_HAIRS = ((0.07, 0.06, 0.05), (0.17, 0.11, 0.07), (0.33, 0.21, 0.12), (0.52, 0.36, 0.20), (0.72, 0.57, 0.36),
          (0.45, 0.20, 0.10), (0.55, 0.55, 0.55))  # fmt: skip
_TOPS = ((0.85, 0.85, 0.83), (0.12, 0.13, 0.16), (0.62, 0.14, 0.15), (0.16, 0.28, 0.50), (0.20, 0.42, 0.28),
         (0.83, 0.66, 0.22), (0.50, 0.55, 0.60), (0.52, 0.30, 0.46), (0.80, 0.45, 0.25),
         (0.36, 0.60, 0.66))  # fmt: skip
_BOTTOMS = ((0.15, 0.20, 0.33), (0.24, 0.33, 0.48), (0.11, 0.11, 0.12), (0.45, 0.40, 0.31), (0.33, 0.33, 0.35),
            (0.25, 0.27, 0.20))  # fmt: skip
_DARK, _GREY = 1.3, 0.08
"""Sum of a skin's colour below which hair is dark, and contrast of a hair colour below which it counts as grey."""
_SHOES = ((0.10, 0.10, 0.10), (0.85, 0.85, 0.85), (0.35, 0.22, 0.14), (0.55, 0.14, 0.14), (0.18, 0.24, 0.40))


def sample_looks(feminine: float, *, child: bool = False, rng: np.random.Generator) -> PersonLooks:
    """Draw the looks of a person.

    Args:
        feminine: As in `Body`; above 0.5 hair tends to be longer.
        child: Whether the person is a child; children are neither bald nor grey.
    """
    weights = np.array((0.1, 0.0, 0.3, 0.35, 0.25)) if feminine > 0.5 else np.array((0.8, 0.12, 0.05, 0.03, 0.0))
    pattern = str(rng.choice(PATTERNS, p=(0.4, 0.22, 0.16, 0.17, 0.05)))
    first, second = _shade(_TOPS, rng=rng), _shade(_TOPS, rng=rng)
    top = Garment(bool(rng.random() < 0.5), pattern, (first, _darker(first) if pattern == "melange" else second))
    first = _shade(_BOTTOMS, rng=rng)
    bottom = Garment(bool(rng.random() < 0.75), str(rng.choice(("plain", "melange"))), (first, _darker(first)))
    skin, hair = _shade(_SKINS, 0.005, (0.85, 1.02), rng=rng), str(rng.choice(HAIRSTYLES, p=weights))
    colour = _shade(_HAIRS[:-1] if child else _HAIRS, rng=rng)
    if sum(skin) < _DARK and max(colour) - min(colour) > _GREY:
        colour = _darker(colour, 0.3)
    return PersonLooks(
        skin=skin,
        hair="short" if child and hair == "bald" else hair,
        hair_colour=colour,
        top=top,
        bottom=bottom,
        shoes=_shade(_SHOES, rng=rng),
        sole=(0.9, 0.9, 0.88) if rng.random() < 0.5 else (0.13, 0.12, 0.11),
        untucked=bool(rng.random() < 0.75),
    )


_CANVAS = ((0.12, 0.12, 0.14), (0.16, 0.20, 0.32), (0.30, 0.33, 0.24), (0.48, 0.36, 0.24), (0.50, 0.16, 0.16),
           (0.42, 0.42, 0.44))  # fmt: skip
_HATTED, _BEARDED, _LADEN = 0.15, 0.25, 0.2
"""Shares of people with a hat, of men with a beard, and of adults with a bag where nothing is against it."""
_COATS = ((0.09, 0.09, 0.10), (0.10, 0.13, 0.22), (0.22, 0.22, 0.24), (0.20, 0.22, 0.15), (0.28, 0.18, 0.12),
          (0.30, 0.09, 0.12), (0.62, 0.48, 0.32), (0.45, 0.46, 0.48))  # fmt: skip
_COATED = 0.2
"""Share of people with a coat or a jacket."""
_SKIRTED, _DRESSED = 0.36, 0.35
"""Share of women and girls with a skirt, and of those whose skirt is the lower half of a dress."""


def dressed(
    looks: PersonLooks, body: Body, wardrobe: Collection[str], bags: Collection[str], *, rng: np.random.Generator
) -> PersonLooks:
    """Return the looks with what chance gives a person out of a wardrobe.

    Each word draws from its own child stream, so that no word changes what another draws.

    Args:
        body: The person's body.
        wardrobe: Words of `WARDROBE`.
        bags: Those of `BAGS` that the person's motion has room for.
    """
    rngs = dict(zip(WARDROBE, rng.spawn(len(WARDROBE)), strict=True))
    if "caps" in wardrobe and (of_hats := rngs["caps"]).random() < _HATTED:
        first = _shade(_TOPS, rng=of_hats)
        second = _darker(first) if of_hats.random() < 0.6 else _shade(_TOPS, rng=of_hats)
        looks = replace(looks, hat=Hat(str(of_hats.choice(HATS, p=(0.65, 0.35))), (first, second)))
    man = body.feminine < 0.5 and body.age >= ADULT_AGE
    if "beards" in wardrobe and man and (of_beards := rngs["beards"]).random() < _BEARDED:
        looks = replace(looks, beard=str(of_beards.choice(BEARDS, p=(0.3, 0.3, 0.15, 0.25))))
    if "bags" in wardrobe and body.age >= ADULT_AGE and (of_bags := rngs["bags"]).random() < _LADEN:
        kind, side = str(of_bags.choice(BAGS, p=(0.6, 0.4))), str(of_bags.choice(list(SIDES)))
        colour = _shade(_CANVAS, rng=of_bags)
        if kind in bags:
            looks = replace(looks, bag=Bag(kind, side, (colour, _darker(colour, 0.6))))
    if "skirts" in wardrobe and body.feminine > 0.5 and (of_skirts := rngs["skirts"]).random() < _SKIRTED:
        looks = replace(looks, skirt=True, untucked=False, bottom=_skirt(looks.top, rng=of_skirts))
    if "coats" in wardrobe and (of_coats := rngs["coats"]).random() < _COATED:
        long, open_ = (bool(of_coats.random() < share) for share in (0.4, 0.4))
        pattern = str(of_coats.choice(("plain", "melange", "checks"), p=(0.65, 0.25, 0.1)))
        first = _shade(_COATS, rng=of_coats)
        # Straps lie on closed coats, and over skirts there are short ones.
        cloth = Garment(long and not looks.skirt, pattern, (first, _darker(first)))
        looks = replace(looks, coat=Coat(cloth, open_ and not looks.bag))
    return looks


def _skirt(top: Garment, *, rng: np.random.Generator) -> Garment:
    """Draw a skirt, below a shirt or as the lower half of a dress."""
    long = bool(rng.random() < 0.4)
    if rng.random() < _DRESSED:
        return replace(top, long=long)
    pattern = str(rng.choice(PATTERNS[:4], p=(0.55, 0.05, 0.2, 0.2)))
    first = _shade(_BOTTOMS + _TOPS, rng=rng)
    return Garment(
        long, pattern, (first, _shade(_TOPS, rng=rng) if pattern in ("stripes", "checks") else _darker(first))
    )


def sample_hands(*, rng: np.random.Generator) -> tuple[str, str]:
    """Draw the shapes of both hands of a person."""
    left, right = rng.choice(HANDS[:5], 2, p=(0.62, 0.16, 0.1, 0.06, 0.06)).tolist()
    return left, right


def _darker(colour: tuple[float, float, float], share: float = 0.78) -> tuple[float, float, float]:
    """Return the colour at a share of its brightness."""
    red, green, blue = (round(share * c, 3) for c in colour)
    return red, green, blue


def _shade(
    palette, hue: float = 0.015, bright: tuple[float, float] = (0.85, 1.12), *, rng: np.random.Generator
) -> tuple[float, float, float]:
    """Draw a colour of the palette, times a brightness, and off hue by a standard deviation of `hue`."""
    colour = np.array(palette[rng.integers(len(palette))]) * rng.uniform(*bright) + rng.normal(0, hue, 3)
    red, green, blue = np.round(np.clip(colour, 0.02, 0.98), 3).tolist()
    return red, green, blue
