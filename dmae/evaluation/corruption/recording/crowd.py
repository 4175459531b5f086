"""Additional people, and people at a small distance from each other."""

import numpy as np

from dmae.data.clip import Clip
from dmae.evaluation.corruption.companions import companion, with_companions
from dmae.evaluation.corruption.registry import corruption

_DRAWN = 32
"""Number of people that are drawn. The first ones are added, so that a higher level only adds people."""
_DISTANCE = (1.0, 2.0)
"""m; distance of an added person from the copied person."""
_DELAY = (0.5, 2.0)
"""s; delay of the motion of an added person."""


@corruption("crowd", order=1, unit="people more", levels=(1, 2, 4, 8), small=(1, 4), most=32, whole=True)
def crowd(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """People added, who each keep 1 to 2 m from one of the clip's people.

    An added person is a copy of one of the clip's people, moved in the world and delayed in time. It is detected as
    well as the one copied was; what stands behind another body is not detected. Added people have no truth and are not
    scored.
    """
    angle, distance = rng.uniform(0, 2 * np.pi, _DRAWN), rng.uniform(*_DISTANCE, _DRAWN)
    delay = np.rint(rng.uniform(*_DELAY, _DRAWN) * clip.fps).astype(int)
    return _with_people(clip, distance[: int(level)], angle, delay)


@corruption("closeness", order=2, unit="1/m", levels=(0.5, 1, 2, 4), small=(1, 4))
def closeness(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """How close an added person keeps to each of the clip's people: 2 is half a metre, between the middles of bodies.

    People are added as with `crowd`.
    """
    people = clip.poses.xyz.shape[1]
    delay = np.rint(rng.uniform(*_DELAY, people) * clip.fps).astype(int)
    return _with_people(clip, np.full(people, 1 / level), rng.uniform(0, 2 * np.pi, people), delay)


def _with_people(clip: Clip, distance: np.ndarray, angle: np.ndarray, delay: np.ndarray) -> Clip:
    """Return the clip with additional copies of its people, one for each distance, m; the people are copied in turn."""
    people = clip.poses.xyz.astype(np.float64)
    if not people.shape[1]:
        return clip
    copied = [number % people.shape[1] for number in range(len(distance))]
    drawn = zip(copied, distance, angle, delay, strict=False)
    bodies = np.stack([companion(people, *each) for each in drawn], 1)
    return with_companions(clip, bodies, copied, delay[: len(copied)].tolist())
