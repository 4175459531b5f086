"""From one stance to another: the first step, the published gait and the last step."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from synth.motion.act import Stance
from synth.motion.course import SIDES
from synth.motion.gait import LEGS, Path, Walk, rolled, smoothstep
from synth.motion.legs import ANKLE
from synth.motion.rotations import about

_EPS = 1e-3
"""Phase over which speeds are taken."""
_FLAT = 0.2
"""A phase at which a foot lies flat on the floor."""
_LIFT = 0.035
"""By how much the first step is lifted in its middle, m."""


@dataclass(frozen=True)
class Passage:
    """The lower body over F frames.

    Attributes:
        root, pelvis, ankles, feet: As `gait.Walk.lower_body`.
        heading: (F,) where the trunk faces, rad.
        going: (F,) share of walking against standing.
        swing: (F,) of the left arm to the front and the right arm to the back, 1 at its widest.
    """

    root: np.ndarray
    pelvis: np.ndarray
    ankles: np.ndarray
    feet: np.ndarray
    heading: np.ndarray
    going: np.ndarray
    swing: np.ndarray


@dataclass(frozen=True)
class WalkTo:
    """A walk from a stance: a first step, some steps at speed, and a last step that closes up. See `walk_to`.

    Attributes:
        walk: At speed.
        first: The phase of the walk at which the first step ends.
        last: That at which the last begins.
        start, stop: The stances at both ends.
    """

    walk: Walk
    first: float
    last: float
    start: Stance
    stop: Stance

    @cached_property
    def _rate(self) -> float:
        """Strides a second."""
        return self.walk.speed / self.walk.stride

    @cached_property
    def _spans(self) -> tuple[float, float, float]:
        """Length of the first step, of the steps at speed, and of the last, s."""
        swing = (1 - self.walk.stance) / self._rate
        # Speed is taken up, and given up, about evenly.
        begin, end = (
            even * float(np.linalg.norm((self._pace(phase)[0] - stance.root)[:2])) / self.walk.speed
            for even, phase, stance in ((2.6, self.first, self.start), (2.3, self.last, self.stop))
        )
        closing = (self.walk.stance - 0.5) / self._rate + 1.15 * swing + 0.1
        return max(begin, swing + 0.3), (self.last - self.first) / self._rate, max(end, closing)

    @property
    def seconds(self) -> float:
        """How long it takes."""
        return sum(self._spans)

    def passage(self, times: np.ndarray) -> Passage:
        """The lower body at times (F,) since the start, s."""
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
        going = smoothstep(times / begin) * smoothstep((self.seconds - times) / end)
        return Passage(root, pelvis, ankles, feet, heading, going, going * np.cos(2 * np.pi * phase))

    def _pace(self, phase: float) -> tuple[np.ndarray, np.ndarray]:
        """The root at a phase of the walk, (3,) m, and its velocity, (3,) m/s."""
        before, now, after = self._lower_body(phase + _EPS * np.array((-1, 0, 1)))[0]
        return now, (after - before) / (2 * _EPS) * self._rate

    def _lower_body(self, phase: np.ndarray) -> list[np.ndarray]:
        """As the walk's, as low as all of its steps ask for."""
        every = np.linspace(self.first, self.last, 25 * round(2 * (self.last - self.first)) + 1)
        return [part[: len(phase)] for part in self.walk.lower_body(np.concatenate([phase, every]))]


@dataclass(frozen=True)
class _Step:
    """A foot in the first step of a walk or in the last.

    Attributes:
        walk: At speed.
        leg: 0 for left.
        stride: Of the walk, in which it is planted.
        own: (F,) its phase in that.
        since: (F,) s, since the step began.
        span: Of the step, s.
        foot: (3,) where it stands before the walk, or after it, as in `Stance`.
    """

    walk: Walk
    leg: int
    stride: float
    own: np.ndarray
    since: np.ndarray
    span: float
    foot: np.ndarray

    def staying(self, within: slice) -> tuple[np.ndarray, np.ndarray]:
        """Where it is, flat but for the roll that leads into the walk or out of it: phases within bounds."""
        own = np.clip(self.own, within.start, within.stop)
        return self.walk.planted(self.leg, self._strides, own), self._turned(self.foot[2], self.walk.pitch(own))

    def setting_out(self) -> tuple[np.ndarray, np.ndarray]:
        """From where it stands to where its heel strikes."""
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
        """It pushes off as in walking, and comes down beside the other."""
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
        """At the first of two phases the ankle of the foot on the floor, (3,) m, and its velocity, (3,) m/s."""
        places = self.walk.planted(self.leg, np.full(2, self.stride), own)
        return places[0], (places[1] - places[0]) / (own[1] - own[0]) * self._rate

    def _above(self, xyz: np.ndarray, pitch: np.ndarray) -> np.ndarray:
        """The way through the air, heel and tip above the floor."""
        return np.column_stack([xyz[:, :2], np.maximum(xyz[:, 2], rolled(pitch)[1])])

    def _turned(self, yaw: np.ndarray | float, pitch: np.ndarray) -> np.ndarray:
        return about("z", yaw) @ about("y", -pitch)


def walk_to(
    start: Stance, *, speed: float, width: float, first: int, distance: float, curvature: float, apart: float
) -> WalkTo:
    """A walk about so far from a stance: in whole steps, of which the first and the last are half as long.

    Args:
        start: Where.
        speed: m/s, as `gait.Walk`.
        width: Of the walk, m, as there.
        first: The foot that steps first, 0 for left.
        distance: Along the path, m; at least three steps are made.
        curvature: Of the path, rad/m, left if positive.
        apart: Of the ankles in the stance at its end, m.
    """
    along = np.arange(-2.0, distance + 4.0, 0.01)
    walk = Walk(Path.bent(along, np.full(len(along), curvature)), speed, width, start.toe_out)
    steps = max(1, round(2 * distance / walk.stride) - 1)
    begin = 0.5 if first == 0 else 0.0
    # The path lies so that the foot which stays is in its place on it.
    foot = start.feet[1 - first]
    (printed,), (yaw,) = walk.footprint(1 - first, np.zeros(1))
    turn = about("z", foot[2] - yaw)[:2, :2]
    path = walk.path
    walk = replace(
        walk, path=Path(path.distance, path.heading + foot[2] - yaw, (path.xy - printed) @ turn.T + foot[:2])
    )
    last = begin + steps / 2
    leg = (first + steps) % 2
    (place,), (yaw,) = walk.footprint(leg, np.floor([last + LEGS[leg][1] + 1e-9]))
    side = SIDES[leg][1]
    heading = yaw - side * start.toe_out
    x, y = place - side * apart / 2 * np.array((-np.sin(heading), np.cos(heading)))
    return WalkTo(walk, begin, last, start, Stance.at(x, y, heading, apart, start.toe_out))
