"""Somebody who does one thing after another, of random style."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from synth.motion import Motion
from synth.motion.act import Action, on_the_spot
from synth.motion.actions import Manner
from synth.motion.agenda import ACTIONS, plan
from synth.motion.course import SIDES, Course, joined, lowered, over_feet
from synth.motion.journey import Passage
from synth.motion.legs import HIP_HEIGHT
from synth.motion.upper import hang, swing_width, wander

WEIGHTS = dict.fromkeys(ACTIONS, 1.0) | {"walk": 8.0, "stand": 2.0, "crouch": 0.5}
"""How often each action is done relative to the others."""
SEATED = 0.64
"""Height of the hips in sitting on a stool of 0.45 m over that in standing, of somebody of average stature."""


def check_actions(actions: Sequence[str], weights: Mapping[str, float]) -> None:
    """Whether all are actions, and their weights what can be drawn by.

    Raises:
        ValueError: one is not; the message lists what there is.
    """
    for what, names in (("actions", actions), ("weights", weights)):
        unknown = ", ".join(repr(name) for name in names if name not in ACTIONS)
        if unknown:
            raise ValueError(f"motion.{what}: expected some of {', '.join(ACTIONS)}; found {unknown}")
    for name, weight in weights.items():
        if not 0 <= weight < np.inf:
            raise ValueError(f"motion.weights.{name}: expected 0 or more, got {weight}")
    if actions and not any(weights.get(name, 1) for name in actions):
        raise ValueError(f"motion.weights: expected one above 0 among motion.actions, {list(actions)}; all are 0")


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
    """Somebody of random style who does one thing after another, see `agenda.plan`.

    Args:
        actions: Names of `ACTIONS`, at least one that weighs.
        weights: How often each is done relative to the others, 1 if it is not named.
        speed: Least and greatest speed of walking, m/s.
        seconds: Length wanted.
        fps: Frames per second.
        rng: Draws everything.
        seated: Height of the hips in sitting over that in standing.

    Returns:
        round(seconds * fps) frames.
    """
    pace = rng.uniform(*speed)
    manner = Manner(
        pace=rng.uniform(0.85, 1.2),
        speed=pace,
        width=rng.uniform(0.06, 0.13),
        apart=rng.uniform(0.14, 0.26),
        swing=swing_width(pace) * rng.uniform(0.6, 1.3),
        lean=np.radians(rng.uniform(0, 6)),
        seat=seated * HIP_HEIGHT,
    )
    times = np.arange(max(round(seconds * fps), 1)) / fps
    parts, start = plan(actions, weights, manner, seconds=times[-1] + 1 / fps, rng=rng)
    ease = np.stack([hang(rng, times, np.zeros(len(times))) for _ in SIDES], axis=1)
    courses, names, seats = [], [], []
    going, swing, swung = np.zeros(len(times)), np.zeros(len(times)), np.ones((len(times), 2))
    for part in parts:
        frames = np.flatnonzero((times + start >= part.begin) & (times + start < part.end))
        if not len(frames):
            continue
        names.append(part.name)
        since = times[frames] + start - part.begin
        if isinstance(part.doing, Action):
            courses.append(on_the_spot(part.doing, since, part.stance, ease[frames], fps))
            seats += frames[part.doing.seated(since)][:1].tolist()
        else:
            passage = part.doing.passage(since)
            arms = ease[frames]
            if part.gesture:
                act = part.gesture.act(since - part.late)
                arms = arms + act.raised[..., None] * (act.arms - arms)
                swung[frames] = 1 - act.raised
            courses.append(_upright(passage, arms, manner))
            going[frames], swing[frames] = passage.going, manner.swing * passage.swing
    course = _alive(joined(courses), going, swing, swung, times, fps, rng=rng)
    motion = replace(course, root=lowered(course, fps)).motion(", ".join(names), fps)
    return replace(motion, seats=tuple(seats))


def _upright(passage: Passage, arms: np.ndarray, manner: Manner) -> Course:
    """Trunk and head over a lower body that is on its way."""
    level = np.zeros(len(arms))
    return Course(
        root=passage.root,
        pelvis=passage.pelvis,
        ankles=passage.ankles,
        feet=passage.feet,
        knees=over_feet(passage.pelvis, passage.feet),
        chest=np.stack([passage.heading, manner.lean * passage.going, level], axis=1),
        head=np.stack([passage.heading, level], axis=1),
        arms=arms,
    )


def _alive(
    course: Course,
    going: np.ndarray,
    swing: np.ndarray,
    swung: np.ndarray,
    times: np.ndarray,
    fps: float,
    *,
    rng: np.random.Generator,
) -> Course:
    """With arms that swing in walking, each by its share (F, 2), and the sway of standing; nobody holds quite still."""
    still = gaussian_filter1d(1 - np.minimum(1, 2 * going), 0.2 * fps, mode="nearest")
    root, chest, head, arms = course.root.copy(), course.chest.copy(), course.head.copy(), course.arms.copy()
    # As in standing: Prieto et al., IEEE Trans. Biomed. Eng. 43 (1996).
    root[:, :2] += still[:, None] * np.stack([wander(rng, times, 0.005, fastest) for fastest in (0.3, 0.5)], axis=1)
    chest[:, 0] += -0.3 * swing + wander(rng, times, np.radians(2), 0.25)
    chest[:, 1] += wander(rng, times, np.radians(1), 0.3)
    head[:, 0] += wander(rng, times, np.radians(10), 0.3)
    head[:, 1] += wander(rng, times, np.radians(4), 0.3)
    for arm, (_, sign) in enumerate(SIDES):
        ahead = sign * swing * swung[:, arm]
        arms[:, arm, 0] += ahead
        # The elbow bends as the arm comes forward.
        arms[:, arm, 3] += 0.5 * (np.abs(ahead) + ahead)
    return replace(course, root=root, chest=chest, head=head, arms=arms)
