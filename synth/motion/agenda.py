"""What somebody does when, and where: actions drawn from a list, with the turns and ways between them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from synth.motion.act import Action, Stance
from synth.motion.actions import Manner, bend, crouch, lift, reach, sit, stand, wave
from synth.motion.journey import WalkTo, walk_to
from synth.motion.legs import HIP_HEIGHT
from synth.motion.lively import dance, kick, punch
from synth.motion.turning import TurnTo

_ON_THE_SPOT = {
    "stand": stand, "reach": reach, "wave": wave, "bend": bend, "crouch": crouch, "lift": lift, "sit": sit,
    "kick": kick, "punch": punch, "dance": dance,
}  # fmt: skip
ACTIONS = ("walk", "turn", *_ON_THE_SPOT)
"""What there is to do."""
_ROOMY = {"crouch", "lift", "kick", "punch", "dance"}
"""What no seat may stand in the way of."""
_ROOM = 1.3
"""How far from where they begin people walk, m."""
_SHORTEST = 0.9
"""What is worth walking, m."""
_TIGHTEST = 0.8
"""Radius of the sharpest bow of a walk, m."""
_FREE, _ROOMILY = 0.34, 0.75
"""Between a seat and the hips of who passes, or does something roomy, m."""
_GESTURES = 0.4
"""Share of the walks in which people would reach out or wave."""
_HIGHEST = 0.8
"""Greatest height of the hips in sitting over that in standing."""
_TRIES = 12


@dataclass(frozen=True)
class Part:
    """Something done from one time to another, s.

    Attributes:
        stance: That it begins in.
        doing: What.
        name: For people to read.
        gesture: What the arms do meanwhile.
        late: How long after `begin` they begin, s.
    """

    begin: float
    end: float
    stance: Stance
    doing: Action | WalkTo | TurnTo
    name: str
    gesture: Action | None = None
    late: float = 0.0


class _Ground:
    """Where somebody has been, and what they have sat on, so that no seat stands where they pass."""

    def __init__(self):
        self._trail, self._seats = np.empty((2, 0, 2))

    def admits(self, place: np.ndarray) -> bool:
        """Whether a seat may stand at a place (2,): nobody has passed there."""
        return bool((np.linalg.norm(self._trail - place, axis=1) > _FREE).all())

    def passes(self, way: np.ndarray, room: float = _FREE) -> bool:
        """Whether a way (K, 2) keeps clear of the seats."""
        return bool((np.linalg.norm(way[:, None] - self._seats, axis=-1) > room).all())

    def take(self, way: np.ndarray, seat: np.ndarray | None = None) -> None:
        """Remember a way (K, 2) and a seat (2,)."""
        self._trail = np.concatenate([self._trail, way])
        if seat is not None:
            self._seats = np.concatenate([self._seats, seat[None]])


def plan(
    actions: Sequence[str],
    weights: Mapping[str, float],
    manner: Manner,
    *,
    seconds: float,
    rng: np.random.Generator,
) -> tuple[list[Part], float]:
    """What is done one after the other, and when in that a clip of a given length begins, s.

    What there is no room for, as a kick beside one's seat, is left for something else; if nothing fits, people stand.

    Args:
        actions: Names of `ACTIONS`, at least one that weighs.
        weights: How often each is done relative to the others, 1 if it is not named.
        manner: How.
        seconds: Of the clip.
        rng: Draws everything.
    """
    share = np.array([weights.get(name, 1.0) for name in actions])
    names, share = list(actions), share / share.sum()
    stance = Stance.at(0.0, 0.0, rng.uniform(-np.pi, np.pi), manner.apart, np.radians(rng.uniform(3, 12)))
    ground, parts, start = _Ground(), [], 0.0
    while not parts or parts[-1].end < start + seconds:
        left = start + seconds - parts[-1].end if parts else np.inf
        found = None
        for _ in range(_TRIES):
            found = _draw(str(rng.choice(names, p=share)), stance, manner, ground, left, rng=rng)
            if found:
                break
        for doing, name in found or [(stand(manner, rng=rng), "stand")]:
            begin = parts[-1].end if parts else 0.0
            part = Part(begin, begin + doing.seconds, stance, doing, name)
            walks = isinstance(doing, WalkTo)
            parts.append(_gesturing(part, names, manner, rng=rng) if walks else part)
            stance = stance if isinstance(doing, Action) else doing.stop
        if not start:
            # Not so late that somebody would get up from a seat that the clip has not seen.
            start = rng.uniform(0, 0.55) * parts[0].end
    return parts, start


def _gesturing(walk: Part, names: Sequence[str], manner: Manner, *, rng: np.random.Generator) -> Part:
    """The walk, maybe with a gesture on the way, if there is one among the actions for which it lasts long enough."""
    gestures = [name for name in ("reach", "wave") if name in names]
    if not gestures or rng.uniform() > _GESTURES:
        return walk
    action, side = _ON_THE_SPOT[str(rng.choice(gestures))](manner, rng=rng), int(rng.integers(2))
    spare = walk.doing.seconds - action.seconds
    if spare < 0:
        return walk
    name = f"{walk.name} with {action.name} {'lr'[side]}"
    return replace(walk, name=name, gesture=action.mirrored() if side else action, late=rng.uniform(0, spare))


def _draw(
    name: str, stance: Stance, manner: Manner, ground: _Ground, left: float, *, rng: np.random.Generator
) -> list[tuple[Action | WalkTo | TurnTo, str]] | None:
    """An action with the turn that it may need first; None if there is no room for it, or no time to sit down."""
    here = stance.middle[:2]
    if name == "turn":
        ground.take(here[None])
        return [_turn(stance, rng.uniform(0.6, np.pi) * rng.choice((-1, 1)), manner)]
    if name == "walk":
        return _walk(stance, manner, ground, rng=rng)
    action = _ON_THE_SPOT[name](manner, rng=rng)
    if name in _ROOMY and not ground.passes(here[None], _ROOMILY):
        return None
    side = int(rng.integers(2))
    done = [(action.mirrored() if side else action, f"{action.name} {'lr'[side]}")]
    if not action.seat:
        behind = _behind(stance, np.array((0.0, 0.25, 0.5))) if name in _ROOMY else here[None]
        ground.take(behind)
        return done
    # Nor do those sit whose feet would hang.
    if action.seat.begin + 0.3 > left or manner.seat > _HIGHEST * HIP_HEIGHT:
        return None
    for angle in (0.0, *np.radians(rng.permutation((-150, -110, 110, 150))), np.pi):
        turned = _turn(stance, angle, manner)
        before = turned[0].stop if angle else stance
        seat = _behind(before, np.array([action.seat.behind]))[0]
        if ground.admits(seat) and (not angle or turned[0].seconds + action.seat.begin + 0.3 < left):
            ground.take(here[None], seat)
            return [turned, *done] if angle else done
    return None


def _behind(stance: Stance, distance: np.ndarray) -> np.ndarray:
    """(K, 2) places so far behind a stance, m."""
    x, y, heading = stance.middle
    return np.array((x, y)) - distance[:, None] * np.array((np.cos(heading), np.sin(heading)))


def _turn(stance: Stance, angle: float, manner: Manner) -> tuple[TurnTo, str]:
    return TurnTo(stance, angle, manner.pace), f"turn by {np.degrees(angle):.0f} degrees"


def _walk(
    stance: Stance, manner: Manner, ground: _Ground, *, rng: np.random.Generator
) -> list[tuple[WalkTo | TurnTo, str]] | None:
    """A walk to somewhere about the origin, on a bow that begins straight ahead, after a turn if it must."""
    radius, angle = _ROOM * np.sqrt(rng.uniform()), rng.uniform(-np.pi, np.pi)
    way = radius * np.array((np.cos(angle), np.sin(angle))) - stance.middle[:2]
    length = float(np.linalg.norm(way))
    if length < _SHORTEST:
        return None
    done = []
    bearing = (np.arctan2(way[1], way[0]) - stance.middle[2] + np.pi) % (2 * np.pi) - np.pi
    # The chord of a bow makes half its angle with either end.
    sharpest = 0.8 * np.arcsin(min(1.0, length / (2 * _TIGHTEST)))
    bow = np.clip(bearing, -sharpest, sharpest)
    if abs(bearing) > np.pi / 2:
        bow *= rng.uniform(0, 0.5)
    if abs(bearing - bow) > np.radians(12):
        done.append(_turn(stance, bearing - bow, manner))
        stance = done[0][0].stop
    walk = walk_to(
        stance,
        speed=manner.speed,
        width=manner.width,
        # Into a bend with the foot inside it.
        first=int(bow < 0) if abs(bow) > 0.2 else int(rng.integers(2)),
        distance=length * (bow / np.sin(bow) if abs(bow) > 1e-3 else 1.0),
        curvature=2 * np.sin(bow) / length,
        apart=manner.apart,
    )
    passed = walk.passage(np.linspace(0, walk.seconds, 40)).root[:, :2]
    if not ground.passes(passed):
        return None
    ground.take(passed)
    return [*done, (walk, f"walk at {manner.speed:.1f} m/s")]
