"""Draw an agenda: the time and place of each action, with the turns and walks between actions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from synth.motion.procedural.actions import Style, bend, crouch, lift, reach, sit, stand, wave
from synth.motion.procedural.dynamic_actions import dance, kick, punch
from synth.motion.procedural.legs import HIP_HEIGHT, Stance
from synth.motion.procedural.pose_offsets import Action
from synth.motion.procedural.transitions import TurnTo, WalkTo, walk_to

_ON_THE_SPOT = {
    "stand": stand, "reach": reach, "wave": wave, "bend": bend, "crouch": crouch, "lift": lift, "sit": sit,
    "kick": kick, "punch": punch, "dance": dance,
}  # fmt: skip
ACTIONS = ("walk", "turn", *_ON_THE_SPOT)
"""Names of all actions."""
_ROOMY = {"crouch", "lift", "kick", "punch", "dance"}
"""Actions that need room around them, so that no seat may be near."""
_ROOM = 1.3
"""Greatest distance of the ends of walks from the origin, m."""
_SHORTEST = 0.9
"""Length of the shortest walk, m."""
_TIGHTEST = 0.8
"""Radius of the tightest curve of a walk, m."""
_PASSING_CLEARANCE, _ROOMY_CLEARANCE = 0.34, 0.75
"""Least distance between a seat and the hips of a passing person, and of a person in an action of `_ROOMY`, m."""
_GESTURES = 0.4
"""Share of the walks in which people may reach out or wave."""
_HIGHEST = 0.8
"""Greatest height of the hips in sitting, as a fraction of that in standing."""
_TRIES = 12
"""Number of actions that are drawn before the person stands because no action has enough room."""


@dataclass(frozen=True)
class AgendaItem:
    """An action or a transition with its time.

    Attributes:
        begin, end: Start and end, s.
        stance: Stance in which it begins.
        doing: The action or the transition.
        name: Label for reports.
        gesture: Action of the arms during a walk, if any.
        late: Delay of the gesture after `begin`, s.
    """

    begin: float
    end: float
    stance: Stance
    doing: Action | WalkTo | TurnTo
    name: str
    gesture: Action | None = None
    late: float = 0.0


class _Ground:
    """The parts of the floor that a person has used: paths and seats. No seat may be where the person passes."""

    def __init__(self):
        self._trail, self._seats = np.empty((2, 0, 2))

    def admits(self, place: np.ndarray) -> bool:
        """Return whether a seat may stand at a place (2,): the person has not passed there."""
        return bool((np.linalg.norm(self._trail - place, axis=1) > _PASSING_CLEARANCE).all())

    def passes(self, path: np.ndarray, room: float = _PASSING_CLEARANCE) -> bool:
        """Return whether a path (K, 2) keeps clear of all seats."""
        return bool((np.linalg.norm(path[:, None] - self._seats, axis=-1) > room).all())

    def take(self, path: np.ndarray, seat: np.ndarray | None = None) -> None:
        """Add a path (K, 2) and maybe a seat (2,)."""
        self._trail = np.concatenate([self._trail, path])
        if seat is not None:
            self._seats = np.concatenate([self._seats, seat[None]])


def draw_agenda(
    actions: Sequence[str],
    weights: Mapping[str, float],
    style: Style,
    *,
    seconds: float,
    rng: np.random.Generator,
) -> tuple[list[AgendaItem], float]:
    """Draw the actions of a person, one after another, and the time at which the clip begins.

    An action without enough room, such as a kick next to a seat, is replaced by another; if none fits, the
    person stands.

    Args:
        actions: Names of `ACTIONS`, at least one with a weight above 0.
        weights: Relative frequency of each action, 1 if it is not named.
        style: Style of the person.
        seconds: Length of the clip, s.
        rng: Draws everything.

    Returns:
        The items in order of time, and the time at which the clip begins, s.
    """
    share = np.array([weights.get(name, 1.0) for name in actions])
    names, share = list(actions), share / share.sum()
    stance = Stance.at(0.0, 0.0, rng.uniform(-np.pi, np.pi), style.apart, np.radians(rng.uniform(3, 12)))
    ground, items, start = _Ground(), [], 0.0
    while not items or items[-1].end < start + seconds:
        left = start + seconds - items[-1].end if items else np.inf
        found = None
        for _ in range(_TRIES):
            found = _draw(str(rng.choice(names, p=share)), stance, style, ground, left, rng=rng)
            if found:
                break
        for doing, name in found or [(stand(style, rng=rng), "stand")]:
            begin = items[-1].end if items else 0.0
            item = AgendaItem(begin, begin + doing.seconds, stance, doing, name)
            walks = isinstance(doing, WalkTo)
            items.append(_gesturing(item, names, style, rng=rng) if walks else item)
            stance = stance if isinstance(doing, Action) else doing.stop
        if not start:
            # Begin early enough that the clip shows the person walk up to a seat before sitting on it.
            start = rng.uniform(0, 0.55) * items[0].end
    return items, start


def _gesturing(walk: AgendaItem, names: Sequence[str], style: Style, *, rng: np.random.Generator) -> AgendaItem:
    """Return a walk with a gesture added at random, if the actions include a gesture that is short enough."""
    gestures = [name for name in ("reach", "wave") if name in names]
    if not gestures or rng.uniform() > _GESTURES:
        return walk
    action, side = _ON_THE_SPOT[str(rng.choice(gestures))](style, rng=rng), int(rng.integers(2))
    spare = walk.doing.seconds - action.seconds
    if spare < 0:
        return walk
    name = f"{walk.name} with {action.name} {'lr'[side]}"
    return replace(walk, name=name, gesture=action.mirrored() if side else action, late=rng.uniform(0, spare))


def _draw(
    name: str, stance: Stance, style: Style, ground: _Ground, left: float, *, rng: np.random.Generator
) -> list[tuple[Action | WalkTo | TurnTo, str]] | None:
    """Return an action, after a turn if it needs one; None if there is no room or no time to sit."""
    here = stance.middle[:2]
    if name == "turn":
        ground.take(here[None])
        return [_turn(stance, rng.uniform(0.6, np.pi) * rng.choice((-1, 1)), style)]
    if name == "walk":
        return _walk(stance, style, ground, rng=rng)
    action = _ON_THE_SPOT[name](style, rng=rng)
    if name in _ROOMY and not ground.passes(here[None], _ROOMY_CLEARANCE):
        return None
    side = int(rng.integers(2))
    done = [(action.mirrored() if side else action, f"{action.name} {'lr'[side]}")]
    if not action.seat:
        behind = _behind(stance, np.array((0.0, 0.25, 0.5))) if name in _ROOMY else here[None]
        ground.take(behind)
        return done
    # Feet must reach the floor.
    if action.seat.begin + 0.3 > left or style.seat > _HIGHEST * HIP_HEIGHT:
        return None
    for angle in (0.0, *np.radians(rng.permutation((-150, -110, 110, 150))), np.pi):
        turned = _turn(stance, angle, style)
        before = turned[0].stop if angle else stance
        seat = _behind(before, np.array([action.seat.behind]))[0]
        if ground.admits(seat) and (not angle or turned[0].seconds + action.seat.begin + 0.3 < left):
            ground.take(here[None], seat)
            return [turned, *done] if angle else done
    return None


def _behind(stance: Stance, distance: np.ndarray) -> np.ndarray:
    """Return places (K, 2) at distances (K,) behind a stance, m."""
    x, y, heading = stance.middle
    return np.array((x, y)) - distance[:, None] * np.array((np.cos(heading), np.sin(heading)))


def _turn(stance: Stance, angle: float, style: Style) -> tuple[TurnTo, str]:
    return TurnTo(stance, angle, style.pace), f"turn by {np.degrees(angle):.0f} degrees"


def _walk(
    stance: Stance, style: Style, ground: _Ground, *, rng: np.random.Generator
) -> list[tuple[WalkTo | TurnTo, str]] | None:
    """Draw a walk to a place near the origin, on an arc that begins straight ahead, after a turn where needed."""
    radius, angle = _ROOM * np.sqrt(rng.uniform()), rng.uniform(-np.pi, np.pi)
    chord = radius * np.array((np.cos(angle), np.sin(angle))) - stance.middle[:2]
    length = float(np.linalg.norm(chord))
    if length < _SHORTEST:
        return None
    done = []
    bearing = (np.arctan2(chord[1], chord[0]) - stance.middle[2] + np.pi) % (2 * np.pi) - np.pi
    # The chord of an arc forms half the arc's angle with the tangent at each end.
    sharpest = 0.8 * np.arcsin(min(1.0, length / (2 * _TIGHTEST)))
    bow = np.clip(bearing, -sharpest, sharpest)
    if abs(bearing) > np.pi / 2:
        bow *= rng.uniform(0, 0.5)
    if abs(bearing - bow) > np.radians(12):
        done.append(_turn(stance, bearing - bow, style))
        stance = done[0][0].stop
    walk = walk_to(
        stance,
        speed=style.speed,
        width=style.width,
        # The foot on the inside of the curve steps first.
        first=int(bow < 0) if abs(bow) > 0.2 else int(rng.integers(2)),
        distance=length * (bow / np.sin(bow) if abs(bow) > 1e-3 else 1.0),
        curvature=2 * np.sin(bow) / length,
        apart=style.apart,
    )
    passed = walk.lower_body(np.linspace(0, walk.seconds, 40)).root[:, :2]
    if not ground.passes(passed):
        return None
    ground.take(passed)
    return [*done, (walk, f"walk at {style.speed:.1f} m/s")]
