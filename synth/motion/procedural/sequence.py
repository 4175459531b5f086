"""People who perform one action after another: transitions between stances, agendas, and the whole motion."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.ndimage import gaussian_filter1d

from synth.motion.geometry import about, forwards, leftwards, smoothstep
from synth.motion.motion import FloorPath, Motion
from synth.motion.procedural.actions import ON_THE_SPOT, Action, Style, stand, step_profile
from synth.motion.procedural.carriage import carried, perform_on_the_spot
from synth.motion.procedural.gait import LEGS, Walk, rolled
from synth.motion.procedural.trajectory import (
    ANKLE,
    HIP_HEIGHT,
    SIDES,
    BodyTrajectory,
    LowerBody,
    Stance,
    concatenate,
    hang,
    random_drift,
    reachable_root,
    swing_width,
)
from synth.people.hands import HandUse, uses_of

_EPS = 1e-3
"""Step in phase for numerical derivatives."""
_FLAT = 0.2
"""A phase at which the foot is flat on the floor."""
_LIFT = 0.035
"""Height of the foot in the middle of the first step, m."""
_LARGEST_TURN = np.radians(55)
"""Largest turn of a foot in one step on the spot, rad."""


@dataclass(frozen=True)
class WalkTo:
    """A walk from a stance to another: a first step, some steps at speed, and a last step. See `walk_to`."""

    walk: Walk  # The walk at speed
    first: float  # Phase of the walk at which the first step ends
    last: float  # Phase at which the last step begins
    # start, stop: Stances at both ends
    start: Stance
    stop: Stance

    @cached_property
    def _spans(self) -> tuple[float, float, float]:
        """Durations of the first step, of the steps at speed, and of the last step, s."""
        swing = (1 - self.walk.stance) / self.walk.rate
        # The hips speed up and slow down about evenly.
        begin, end = (
            even * float(np.linalg.norm((root - stance.root)[:2])) / self.walk.speed
            for even, (root, _), stance in zip((2.6, 2.3), self._paces, (self.start, self.stop), strict=True)
        )
        closing = (self.walk.stance - 0.5) / self.walk.rate + 1.15 * swing + 0.1
        return max(begin, swing + 0.3), (self.last - self.first) / self.walk.rate, max(end, closing)

    @property
    def seconds(self) -> float:
        """Duration, s."""
        return sum(self._spans)

    def lower_body(self, times: np.ndarray) -> LowerBody:
        """Return the lower body at times (F,) since the start, s."""
        begin, cruise, end = self._spans
        phase = self.first + self.walk.rate * (times - begin)
        steady = np.clip(phase, self.first, self.last)
        root, pelvis, ankles, feet = self._lower_body(steady)
        heading = self.walk.path.heading_at(self.walk.stride * steady)
        leaving, arriving = self._paces
        for stance, at, (moving, speed), span, since, share in (
            (self.start, self.first, leaving, begin, times, smoothstep(times / begin)),
            (self.stop, self.last, arriving, end, times - begin - cruise, smoothstep((self.seconds - times) / end)),
        ):
            ending = stance is self.stop
            within = since >= 0 if ending else since < span
            if not within.any():
                continue
            since, share, now = since[within], share[within], phase[within]
            ends = ((moving, stance.root), (speed, np.zeros(3)))
            root[within] = CubicHermiteSpline((0, span), *(pair if ending else pair[::-1] for pair in ends))(since)
            facing = stance.middle[2]
            heading[within] = facing + share * (self.walk.path.heading_at(self.walk.stride * now) - facing)
            *_, turn, tilt = self.walk.pelvis(now)
            pelvis[within] = about("z", heading[within] + share * turn) @ about("x", share * tilt)
            for leg, (_, early) in enumerate(LEGS):
                # One foot has just met the floor, the other is about to leave it.
                stride, own = divmod(at + early + 1e-9, 1)
                step_of = _Step(self.walk, leg, stride, own + now - at, since, span, stance.feet[leg])
                if (own < 0.25) == ending:
                    found = step_of.staying(slice(0, _FLAT) if ending else slice(_FLAT, 1))
                else:
                    found = step_of.closing() if ending else step_of.setting_out()
                ankles[within, leg], feet[within, leg] = found
        walking = smoothstep(times / begin) * smoothstep((self.seconds - times) / end)
        return LowerBody(root, pelvis, ankles, feet, heading, walking, walking * np.cos(2 * np.pi * phase))

    @cached_property
    def _paces(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The root, (3,) m, and its velocity, (3,) m/s, at the end of the first step and where the last begins."""
        found = []
        for phase in (self.first, self.last):
            before, now, after = self._lower_body(phase + _EPS * np.array((-1, 0, 1)))[0]
            found.append((now, (after - before) / (2 * _EPS) * self.walk.rate))
        return found

    def _lower_body(self, phase: np.ndarray) -> list[np.ndarray]:
        """Return the walk's lower body at phases, with the hips as low as all of its steps need."""
        every = np.linspace(self.first, self.last, 25 * round(2 * (self.last - self.first)) + 1)
        return [part[: len(phase)] for part in self.walk.lower_body(np.concatenate([phase, every]))]


@dataclass(frozen=True)
class _Step:
    """One foot in the first or the last step of a walk."""

    walk: Walk  # The walk at speed
    leg: int  # 0 for left, 1 for right
    stride: float  # Number of the walk's stride in which the foot is planted
    own: np.ndarray  # (F,) phase of the foot in that stride
    since: np.ndarray  # (F,) time since the step began, s
    span: float  # Duration of the step, s
    foot: np.ndarray  # (3,) stance of the foot before the walk or after it, as in `Stance`

    def staying(self, within: slice) -> tuple[np.ndarray, np.ndarray]:
        """Return the ankle and the orientation of a foot that stays and rolls, at phases limited to `within`."""
        own = np.clip(self.own, within.start, within.stop)
        return self.walk.planted(self.leg, self._strides, own), self._turned(self.foot[2], self.walk.pitch(own))

    def setting_out(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the ankle and the orientation of a foot that steps from its stance to where its heel strikes."""
        target, velocity = self._planted(np.array((0, _EPS)))
        length = 1.1 * (1 - self.walk.stance) / self.walk.rate
        u = np.clip((self.since - self.span) / length + 1, 0, 1)
        place = np.array((*self.foot[:2], ANKLE))
        xyz = CubicHermiteSpline((0, length), (place, target), (np.zeros(3), velocity))(u * length)
        pitch = smoothstep(u / 0.6) * self.walk.pitch(1 - (1 - u) * (1 - self.walk.stance))
        printed = self.walk.footprint(self.leg, self._strides)[1]
        # The heel rises first.
        xyz[:, 2] += (1 - u) * (rolled(pitch)[1] - ANKLE) + _LIFT * 16 * u**2 * (1 - u) ** 2
        return self._above(xyz, pitch), self._turned(self.foot[2] + smoothstep(u) * (printed - self.foot[2]), pitch)

    def closing(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the ankle and the orientation of a foot that pushes off as in walking and lands next to the other."""
        stance = self.walk.stance
        leaving, velocity = self._planted(np.array((stance, stance - _EPS)))
        off = (stance - 0.5) / self.walk.rate
        length = min(1.15 * (1 - stance) / self.walk.rate, self.span - off - 0.05)
        u = np.clip((self.since - off) / length, 0, 1)
        place = np.array((*self.foot[:2], ANKLE))
        xyz = CubicHermiteSpline((0, length), (leaving, place), (velocity, np.zeros(3)))(u * length)
        own = np.minimum(self.own, stance)
        xyz = np.where((self.since < off)[:, None], self.walk.planted(self.leg, self._strides, own), xyz)
        pitch = (1 - smoothstep(u / 0.8)) * self.walk.pitch(own)
        printed = self.walk.footprint(self.leg, self._strides)[1]
        return self._above(xyz, pitch), self._turned(printed + smoothstep(u) * (self.foot[2] - printed), pitch)

    @property
    def _strides(self) -> np.ndarray:
        return np.full(len(self.own), self.stride)

    def _planted(self, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the ankle, (3,) m, and its velocity, (3,) m/s, at the first of two phases of a foot on the floor."""
        places = self.walk.planted(self.leg, np.full(2, self.stride), own)
        return places[0], (places[1] - places[0]) / (own[1] - own[0]) * self.walk.rate

    def _above(self, xyz: np.ndarray, pitch: np.ndarray) -> np.ndarray:
        """Return the ankle raised so that heel and tip stay above the floor."""
        return np.column_stack([xyz[:, :2], np.maximum(xyz[:, 2], rolled(pitch)[1])])

    def _turned(self, yaw: np.ndarray | float, pitch: np.ndarray) -> np.ndarray:
        return about("z", yaw) @ about("y", -pitch)


def walk_to(
    start: Stance, *, speed: float, width: float, first: int, distance: float, curvature: float, apart: float
) -> WalkTo:
    """Plan a walk of about a given length from a stance, in whole steps; the first and the last are half as long.

    Args:
        speed, width: As in `gait.Walk`.
        first: Foot that steps first, 0 for left.
        distance: Length of the path, m; at least three steps are made.
        curvature: Curvature of the path, rad/m, left if positive.
        apart: Distance between the ankles in the stance at the end, m.
    """
    along = np.arange(-2.0, distance + 4.0, 0.01)
    walk = Walk(FloorPath.bent(along, np.full(len(along), curvature)), speed, width, start.toe_out)
    steps = max(1, round(2 * distance / walk.stride) - 1)
    begin = 0.5 if first == 0 else 0.0
    # Move the path so that the foot that stays is in its place.
    foot = start.feet[1 - first]
    (printed,), (yaw,) = walk.footprint(1 - first, np.zeros(1))
    turn = about("z", foot[2] - yaw)[:2, :2]
    path = walk.path
    walk = replace(
        walk, path=FloorPath(path.distance, path.heading + foot[2] - yaw, (path.xy - printed) @ turn.T + foot[:2])
    )
    last = begin + steps / 2
    leg = (first + steps) % 2
    (place,), (yaw,) = walk.footprint(leg, np.floor([last + LEGS[leg][1] + 1e-9]))
    side = SIDES[leg][1]
    heading = yaw - side * start.toe_out
    x, y = place - side * apart / 2 * leftwards(heading)
    return WalkTo(walk, begin, last, start, Stance.at(x, y, heading, apart, start.toe_out))


@dataclass(frozen=True)
class TurnTo:
    """A turn on the spot, step by step; the foot on the side of the turn steps first."""

    start: Stance  # Stance at the beginning
    angle: float  # rad, left if positive
    pace: float  # Pace of the steps, 1 on average

    @property
    def stop(self) -> Stance:
        """Stance at the end."""
        return self._turned(1.0)

    @property
    def seconds(self) -> float:
        """Duration, s."""
        return (2 * self._rounds + 0.4) * self._beat

    @property
    def _rounds(self) -> int:
        return max(1, int(np.ceil(abs(self.angle) / _LARGEST_TURN)))

    @property
    def _beat(self) -> float:
        return 0.45 / self.pace

    def _turned(self, share: float) -> Stance:
        x, y, heading = self.start.middle
        return Stance.at(x, y, heading + share * self.angle, self.start.width, self.start.toe_out)

    def lower_body(self, times: np.ndarray) -> LowerBody:
        """Return the lower body at times (F,) since the start, s."""
        rounds, beat = self._rounds, self._beat
        places = np.tile(self.start.feet, (len(times), 1, 1))
        up, aside = np.zeros((2, len(times), 2))
        leading = 0 if self.angle > 0 else 1
        for number in range(rounds):
            before, after = self._turned(number / rounds).feet, self._turned((number + 1) / rounds).feet
            for order, leg in enumerate((leading, 1 - leading)):
                begin = (2 * number + order + 0.2) * beat
                gone, height = step_profile(times, begin, begin + 0.95 * beat, 0.045)
                places[:, leg] += gone[:, None] * (after[leg] - before[leg])
                up[:, leg] += height
                # The hips shift over the other foot.
                aside[:, 1 - leg] += smoothstep((times - begin + 0.2 * beat) / (0.6 * beat))
                aside[:, 1 - leg] -= smoothstep((times - begin - 0.6 * beat) / (0.6 * beat))
        root = np.tile(self.start.root, (len(times), 1))
        middle = places.mean(1)
        root[:, :2] = middle[:, :2] + 0.3 * (aside[..., None] * (places[..., :2] - middle[:, None, :2])).sum(1)
        heading = middle[:, 2]
        ahead = self.start.middle[2] + self.angle * smoothstep((times - 0.1) / (self.seconds - 0.5))
        return LowerBody(
            root=root,
            pelvis=about("z", heading + 0.25 * (ahead - heading)),
            ankles=np.concatenate([places[..., :2], up[..., None] + ANKLE], axis=2),
            feet=about("z", places[..., 2]),
            heading=heading + 0.6 * (ahead - heading),
            walking=0.5 * smoothstep(times / 0.4) * smoothstep((self.seconds - times) / 0.4),
            swing=0.5 * (aside[:, 0] - aside[:, 1]),
        )


# Agendas: the time and place of each action, with turns and walks between them

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
    """An action or a transition with its time."""

    # begin, end: Start and end, s
    begin: float
    end: float
    stance: Stance  # Stance in which it begins
    doing: Action | WalkTo | TurnTo  # The action or the transition
    name: str  # Label for reports
    gesture: Action | None = None  # Action of the arms during a walk, if any
    late: float = 0.0  # Delay of the gesture after `begin`, s


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
    actions: Sequence[str], weights: Mapping[str, float], style: Style, *, seconds: float, rng: np.random.Generator
) -> tuple[list[AgendaItem], float]:
    """Draw the actions of a person, one after another in order of time, and the time at which the clip begins, s.

    An action without enough room, such as a kick next to a seat, is replaced by another; if none fits, the person
    stands. At least one of the actions has a weight above 0; the weight is 1 if it is not named.
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
    action, side = ON_THE_SPOT[str(rng.choice(gestures))](style, rng=rng), int(rng.integers(2))
    spare = walk.doing.seconds - action.seconds
    if spare < 0:
        return walk
    name = f"{walk.name} with {action.name} {'lr'[side]}"
    return replace(walk, name=name, gesture=action.mirrored() if side else action, late=rng.uniform(0, spare))


def _draw(
    name: str, stance: Stance, style: Style, ground: _Ground, left: float, *, rng: np.random.Generator
) -> Sequence[tuple[Action | WalkTo | TurnTo, str]] | None:
    """Return an action, after a turn if it needs one; None if there is no room or no time to sit."""
    here = stance.middle[:2]
    if name == "turn":
        ground.take(here[None])
        return [_turn(stance, rng.uniform(0.6, np.pi) * rng.choice((-1, 1)), style)]
    if name == "walk":
        return _walk(stance, style, ground, rng=rng)
    action = ON_THE_SPOT[name](style, rng=rng)
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
    return np.array((x, y)) - distance[:, None] * forwards(heading)


def _turn(stance: Stance, angle: float, style: Style) -> tuple[TurnTo, str]:
    return TurnTo(stance, angle, style.pace), f"turn by {np.degrees(angle):.0f} degrees"


def _walk(
    stance: Stance, style: Style, ground: _Ground, *, rng: np.random.Generator
) -> list[tuple[WalkTo | TurnTo, str]] | None:
    """Draw a walk to a place near the origin, on an arc that begins straight ahead, after a turn where needed."""
    radius, angle = _ROOM * np.sqrt(rng.uniform()), rng.uniform(-np.pi, np.pi)
    chord = radius * forwards(angle) - stance.middle[:2]
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


# The whole motion

SEATED = 0.64
"""Default hip height in sitting, as a fraction of the standing hip height: an average adult on a 0.45 m stool."""


def make_sequence(
    actions: Sequence[str],
    weights: Mapping[str, float],
    *,
    speed: Sequence[float],
    seconds: float,
    fps: float,
    rng: np.random.Generator,
    seated: float = SEATED,
) -> Motion:
    """Return round(seconds * fps) frames of a person of random style who performs one action after another.

    Args:
        actions, weights: As for `draw_agenda`.
        speed: Least and greatest walking speed, m/s.
        seated: Hip height in sitting, as a fraction of the standing hip height.
    """
    style = _random_style(speed, seated, rng=rng)
    times = np.arange(max(round(seconds * fps), 1)) / fps
    items, start = draw_agenda(actions, weights, style, seconds=times[-1] + 1 / fps, rng=rng)
    ease = np.stack([hang(rng, times, np.zeros(len(times))) for _ in SIDES], axis=1)
    done = _perform(items, times + start, style, ease, fps)
    _add_sway(done, times, fps, rng=rng)
    trajectory = carried(done.trajectory, done.walking, done.raised, times, fps, rng=rng)
    motion = replace(trajectory, root=reachable_root(trajectory, fps)).motion(
        ", ".join(name for _, name in done.actions), fps
    )
    return replace(motion, seats=done.seats, actions=done.actions, hands=done.hands)


def _random_style(speed: Sequence[float], seated: float, *, rng: np.random.Generator) -> Style:
    """Draw a style; arguments as for `make_sequence`."""
    walks = rng.uniform(*speed)
    return Style(
        pace=rng.uniform(0.85, 1.2),
        speed=walks,
        width=rng.uniform(0.06, 0.13),
        apart=rng.uniform(0.14, 0.26),
        swing=swing_width(walks) * rng.uniform(0.6, 1.3),
        lean=np.radians(rng.uniform(0, 6)),
        seat=seated * HIP_HEIGHT,
    )


@dataclass(frozen=True)
class _Performance:
    """An agenda performed over F frames, before small movements."""

    trajectory: BodyTrajectory
    walking: np.ndarray  # (F,) from 0, standing, to 1, walking at speed
    swing: np.ndarray  # (F,) rad, swing of the arms in walking
    raised: np.ndarray  # (F, 2) weight of the action of each arm against the arm at ease
    actions: tuple[tuple[int, str], ...]  # First frame and name of each action
    seats: tuple[int, ...]  # Frames in which the person begins to sit on a stool
    hands: tuple[HandUse, ...]  # What hands are needed for


def _perform(
    items: Sequence[AgendaItem], times: np.ndarray, style: Style, ease: np.ndarray, fps: float
) -> _Performance:
    """Perform the items of an agenda one after another.

    Args:
        times: (F,) s of the agenda.
        ease: (F, 2, 5) angles of arms at ease, as `HANGING`.
    """
    trajectories, actions, seats, hands = [], [], [], []
    walking, swing, raised = np.zeros(len(times)), np.zeros(len(times)), np.zeros((len(times), 2))
    for item in items:
        frames = np.flatnonzero((times >= item.begin) & (times < item.end))
        if not len(frames):
            continue
        actions.append((int(frames[0]), item.name))
        since = times[frames] - item.begin
        if isinstance(item.doing, Action):
            trajectories.append(perform_on_the_spot(item.doing, since, item.stance, ease[frames], fps))
            raised[frames] = item.doing.offsets(since).raised
            seats += frames[item.doing.seated(since)][:1].tolist()
        else:
            lower_body = item.doing.lower_body(since)
            arms = ease[frames]
            if item.gesture:
                offsets = item.gesture.offsets(since - item.late)
                arms = arms + offsets.raised[..., None] * (offsets.arms - arms)
                raised[frames] = offsets.raised
            # Trunk and head are upright.
            heading, level = lower_body.heading, np.zeros(len(frames))
            chest = np.stack([heading, style.lean * lower_body.walking, level], axis=1)
            trajectories.append(lower_body.with_upper_body(chest, np.stack([heading, level], axis=1), arms))
            walking[frames], swing[frames] = lower_body.walking, style.swing * lower_body.swing
        gesture = item.doing if isinstance(item.doing, Action) else item.gesture
        for arm, (side, _) in enumerate(SIDES):
            if gesture and gesture.hands[arm]:
                alone = np.zeros(len(times))
                alone[frames] = raised[frames, arm]
                hands += uses_of(side, alone, gesture.hands[arm])
    performed = tuple(actions), tuple(seats), tuple(hands)
    return _Performance(concatenate(trajectories), walking, swing, raised, *performed)


def _add_sway(done: _Performance, times: np.ndarray, fps: float, *, rng: np.random.Generator) -> None:
    """Add the swing of arms that are at ease in walking, the sway of standing, and drifts of trunk and head."""
    trajectory, swing = done.trajectory, done.swing
    still = gaussian_filter1d(1 - np.minimum(1, 2 * done.walking), 0.2 * fps, mode="nearest")
    # Sway of quiet standing: Prieto et al., IEEE Trans. Biomed. Eng. 43 (1996).
    sway = [random_drift(rng, times, 0.005, fastest) for fastest in (0.3, 0.5)]
    trajectory.root[:, :2] += still[:, None] * np.stack(sway, axis=1)
    trajectory.chest[:, 0] += -0.3 * swing + random_drift(rng, times, np.radians(2), 0.25)
    trajectory.chest[:, 1] += random_drift(rng, times, np.radians(1), 0.3)
    trajectory.head[:, 0] += random_drift(rng, times, np.radians(10), 0.3)
    trajectory.head[:, 1] += random_drift(rng, times, np.radians(4), 0.3)
    for arm, (_, sign) in enumerate(SIDES):
        ahead = sign * swing * (1 - done.raised[:, arm])
        trajectory.arms[:, arm, 0] += ahead
        # The elbow bends as the arm comes forward.
        trajectory.arms[:, arm, 3] += 0.5 * (np.abs(ahead) + ahead)
