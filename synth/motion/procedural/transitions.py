"""Transitions between stances: walk from one stance to another, or turn on the spot."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from synth.motion.easing import smoothstep
from synth.motion.path_planning import FloorPath
from synth.motion.procedural.gait import LEGS, Walk, rolled
from synth.motion.procedural.legs import ANKLE, SIDES, Stance
from synth.motion.procedural.pose_offsets import step_profile
from synth.motion.procedural.trajectory import LowerBody
from synth.motion.rotations import about

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
    """A walk from a stance to another: a first step, some steps at speed, and a last step. See `walk_to`.

    Attributes:
        walk: The walk at speed.
        first: Phase of the walk at which the first step ends.
        last: Phase at which the last step begins.
        start, stop: Stances at both ends.
    """

    walk: Walk
    first: float
    last: float
    start: Stance
    stop: Stance

    @cached_property
    def _rate(self) -> float:
        """Strides per second."""
        return self.walk.speed / self.walk.stride

    @cached_property
    def _spans(self) -> tuple[float, float, float]:
        """Durations of the first step, of the steps at speed, and of the last step, s."""
        swing = (1 - self.walk.stance) / self._rate
        # The hips speed up and slow down about evenly.
        begin, end = (
            even * float(np.linalg.norm((self._pace(phase)[0] - stance.root)[:2])) / self.walk.speed
            for even, phase, stance in ((2.6, self.first, self.start), (2.3, self.last, self.stop))
        )
        closing = (self.walk.stance - 0.5) / self._rate + 1.15 * swing + 0.1
        return max(begin, swing + 0.3), (self.last - self.first) / self._rate, max(end, closing)

    @property
    def seconds(self) -> float:
        """Duration, s."""
        return sum(self._spans)

    def lower_body(self, times: np.ndarray) -> LowerBody:
        """Return the lower body at times (F,) since the start, s."""
        begin, cruise, end = self._spans
        phase = self.first + self._rate * (times - begin)
        steady = np.clip(phase, self.first, self.last)
        root, pelvis, ankles, feet = self._lower_body(steady)
        heading = self.walk.path.heading_at(self.walk.stride * steady)
        for stance, at, span, since, share in (
            (self.start, self.first, begin, times, smoothstep(times / begin)),
            (self.stop, self.last, end, times - begin - cruise, smoothstep((self.seconds - times) / end)),
        ):
            ending = stance is self.stop
            within = since >= 0 if ending else since < span
            if not within.any():
                continue
            since, share, now = since[within], share[within], phase[within]
            moving, speed = self._pace(at)
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

    def _pace(self, phase: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the root, (3,) m, and its velocity, (3,) m/s, at a phase of the walk."""
        before, now, after = self._lower_body(phase + _EPS * np.array((-1, 0, 1)))[0]
        return now, (after - before) / (2 * _EPS) * self._rate

    def _lower_body(self, phase: np.ndarray) -> list[np.ndarray]:
        """Return the walk's lower body at phases, with the hips as low as all of its steps need."""
        every = np.linspace(self.first, self.last, 25 * round(2 * (self.last - self.first)) + 1)
        return [part[: len(phase)] for part in self.walk.lower_body(np.concatenate([phase, every]))]


@dataclass(frozen=True)
class _Step:
    """One foot in the first or the last step of a walk.

    Attributes:
        walk: The walk at speed.
        leg: 0 for left, 1 for right.
        stride: Number of the walk's stride in which the foot is planted.
        own: (F,) phase of the foot in that stride.
        since: (F,) time since the step began, s.
        span: Duration of the step, s.
        foot: (3,) stance of the foot before the walk or after it, as in `Stance`.
    """

    walk: Walk
    leg: int
    stride: float
    own: np.ndarray
    since: np.ndarray
    span: float
    foot: np.ndarray

    def staying(self, within: slice) -> tuple[np.ndarray, np.ndarray]:
        """Return the ankle and the orientation of a foot that stays and rolls, at phases limited to `within`."""
        own = np.clip(self.own, within.start, within.stop)
        return self.walk.planted(self.leg, self._strides, own), self._turned(self.foot[2], self.walk.pitch(own))

    def setting_out(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the ankle and the orientation of a foot that steps from its stance to where its heel strikes."""
        target, velocity = self._planted(np.array((0, _EPS)))
        length = 1.1 * (1 - self.walk.stance) / self._rate
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
        off = (stance - 0.5) / self._rate
        length = min(1.15 * (1 - stance) / self._rate, self.span - off - 0.05)
        u = np.clip((self.since - off) / length, 0, 1)
        place = np.array((*self.foot[:2], ANKLE))
        xyz = CubicHermiteSpline((0, length), (leaving, place), (velocity, np.zeros(3)))(u * length)
        own = np.minimum(self.own, stance)
        xyz = np.where((self.since < off)[:, None], self.walk.planted(self.leg, self._strides, own), xyz)
        pitch = (1 - smoothstep(u / 0.8)) * self.walk.pitch(own)
        printed = self.walk.footprint(self.leg, self._strides)[1]
        return self._above(xyz, pitch), self._turned(printed + smoothstep(u) * (self.foot[2] - printed), pitch)

    @property
    def _rate(self) -> float:
        return self.walk.speed / self.walk.stride

    @property
    def _strides(self) -> np.ndarray:
        return np.full(len(self.own), self.stride)

    def _planted(self, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the ankle, (3,) m, and its velocity, (3,) m/s, at the first of two phases of a foot on the floor."""
        places = self.walk.planted(self.leg, np.full(2, self.stride), own)
        return places[0], (places[1] - places[0]) / (own[1] - own[0]) * self._rate

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
        start: Stance at the beginning.
        speed: m/s, as in `gait.Walk`.
        width: m, as in `gait.Walk`.
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
    x, y = place - side * apart / 2 * np.array((-np.sin(heading), np.cos(heading)))
    return WalkTo(walk, begin, last, start, Stance.at(x, y, heading, apart, start.toe_out))


@dataclass(frozen=True)
class TurnTo:
    """A turn on the spot, step by step; the foot on the side of the turn steps first.

    Attributes:
        start: Stance at the beginning.
        angle: rad, left if positive.
        pace: Pace of the steps, 1 on average.
    """

    start: Stance
    angle: float
    pace: float

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
