"""Motion of a person of random style who performs one action after another."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from synth.motion.motion import Motion
from synth.motion.procedural.actions import Style
from synth.motion.procedural.agenda import ACTIONS, draw_agenda
from synth.motion.procedural.balance import perform_on_the_spot
from synth.motion.procedural.carriage import carried, draw_carriage
from synth.motion.procedural.legs import HIP_HEIGHT, SIDES, knee_directions
from synth.motion.procedural.pose_offsets import Action
from synth.motion.procedural.trajectory import BodyTrajectory, LowerBody, concatenate, reachable_root
from synth.motion.procedural.upper_body import hang, random_drift, swing_width

WEIGHTS = dict.fromkeys(ACTIONS, 1.0) | {
    "walk": 28.0, "turn": 0.5, "crouch": 0.5, "kick": 4.0, "punch": 2.5, "dance": 6.0
}  # fmt: skip
"""Default relative frequency of each action. With it, people move about as much as in the CMU database."""
SEATED = 0.64
"""Default hip height in sitting, as a fraction of the standing hip height: an average adult on a 0.45 m stool."""


def check_actions(actions: Sequence[str], weights: Mapping[str, float]) -> None:
    """Check that all names are actions and that actions can be drawn by these weights.

    Raises:
        ValueError: an action is unknown, a weight is negative, or no weight is above 0.
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
    """Return the motion of a person of random style who performs one action after another; see `agenda.draw_agenda`.

    Args:
        actions: Names of `ACTIONS`, at least one with a weight above 0.
        weights: Relative frequency of each action, 1 if it is not named.
        speed: Least and greatest walking speed, m/s.
        seconds: Length, s.
        fps: Frames per second.
        rng: Draws everything.
        seated: Hip height in sitting, as a fraction of the standing hip height.

    Returns:
        round(seconds * fps) frames.
    """
    pace = rng.uniform(*speed)
    style = Style(
        pace=rng.uniform(0.85, 1.2),
        speed=pace,
        width=rng.uniform(0.06, 0.13),
        apart=rng.uniform(0.14, 0.26),
        swing=swing_width(pace) * rng.uniform(0.6, 1.3),
        lean=np.radians(rng.uniform(0, 6)),
        seat=seated * HIP_HEIGHT,
    )
    times = np.arange(max(round(seconds * fps), 1)) / fps
    items, start = draw_agenda(actions, weights, style, seconds=times[-1] + 1 / fps, rng=rng)
    ease = np.stack([hang(rng, times, np.zeros(len(times))) for _ in SIDES], axis=1)
    trajectories, actions, seats = [], [], []
    walking, swing, swing_share = np.zeros(len(times)), np.zeros(len(times)), np.ones((len(times), 2))
    raised = np.zeros((len(times), 2))
    for item in items:
        frames = np.flatnonzero((times + start >= item.begin) & (times + start < item.end))
        if not len(frames):
            continue
        actions.append((int(frames[0]), item.name))
        since = times[frames] + start - item.begin
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
                raised[frames], swing_share[frames] = offsets.raised, 1 - offsets.raised
            trajectories.append(_upright(lower_body, arms, style))
            walking[frames], swing[frames] = lower_body.walking, style.swing * lower_body.swing
    trajectory = _with_sway(concatenate(trajectories), walking, swing, swing_share, times, fps, rng=rng)
    trajectory = carried(trajectory, draw_carriage(rng=rng), walking, raised, times, fps, rng=rng)
    motion = replace(trajectory, root=reachable_root(trajectory, fps)).motion(
        ", ".join(name for _, name in actions), fps
    )
    return replace(motion, seats=tuple(seats), actions=tuple(actions))


def _upright(lower_body: LowerBody, arms: np.ndarray, style: Style) -> BodyTrajectory:
    """Put an upright trunk and head on a lower body in transition."""
    level = np.zeros(len(arms))
    return BodyTrajectory(
        root=lower_body.root,
        pelvis=lower_body.pelvis,
        ankles=lower_body.ankles,
        feet=lower_body.feet,
        knees=knee_directions(lower_body.pelvis, lower_body.feet),
        chest=np.stack([lower_body.heading, style.lean * lower_body.walking, level], axis=1),
        head=np.stack([lower_body.heading, level], axis=1),
        arms=arms,
    )


def _with_sway(
    trajectory: BodyTrajectory,
    walking: np.ndarray,
    swing: np.ndarray,
    swing_share: np.ndarray,
    times: np.ndarray,
    fps: float,
    *,
    rng: np.random.Generator,
) -> BodyTrajectory:
    """Add arm swing in walking, each arm by its share (F, 2), the sway of standing, and drifts of trunk and head."""
    still = gaussian_filter1d(1 - np.minimum(1, 2 * walking), 0.2 * fps, mode="nearest")
    root, chest, head, arms = (
        trajectory.root.copy(),
        trajectory.chest.copy(),
        trajectory.head.copy(),
        trajectory.arms.copy(),
    )
    # Sway of quiet standing: Prieto et al., IEEE Trans. Biomed. Eng. 43 (1996).
    root[:, :2] += still[:, None] * np.stack(
        [random_drift(rng, times, 0.005, fastest) for fastest in (0.3, 0.5)], axis=1
    )
    chest[:, 0] += -0.3 * swing + random_drift(rng, times, np.radians(2), 0.25)
    chest[:, 1] += random_drift(rng, times, np.radians(1), 0.3)
    head[:, 0] += random_drift(rng, times, np.radians(10), 0.3)
    head[:, 1] += random_drift(rng, times, np.radians(4), 0.3)
    for arm, (_, sign) in enumerate(SIDES):
        ahead = sign * swing * swing_share[:, arm]
        arms[:, arm, 0] += ahead
        # The elbow bends as the arm comes forward.
        arms[:, arm, 3] += 0.5 * (np.abs(ahead) + ahead)
    return replace(trajectory, root=root, chest=chest, head=head, arms=arms)
