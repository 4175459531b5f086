"""Joints hidden behind objects."""

import numpy as np

from dmae.data.clip import Clip
from dmae.evaluation.corruption.detections import undetected_nearest
from dmae.evaluation.corruption.people import by_detection
from dmae.evaluation.corruption.registry import corruption

_PILLARS = 6
_DRAWN = 40
"""Number of candidate places for pillars; the ones farthest from all people are used."""


@corruption("objects", order=10, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100)
def objects(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Joints hidden behind pillars that stand in the scene, % of the detected joints.

    Six round pillars from floor to ceiling stand between cameras and people, where people leave most room. All are as
    thick as it takes to hide that share of the joints. What a pillar hides is not detected.
    """
    centres, people = (clip.true_rig or clip.rig).centers[:, :2], clip.poses.xyz[..., :2].astype(np.float64)
    places = _places(centres, people, rng)
    if not len(places):
        return clip
    sight = people[:, None] - centres[:, None, None]  # (F, V, P, J, 2)
    length2 = np.maximum((sight**2).sum(-1), 1e-9)
    margin = np.full(length2.shape, np.inf)
    for place in places:
        to_place = place - centres
        along = np.clip(np.einsum("fvpjk,vk->fvpj", sight, to_place) / length2, 0, 1)
        margin = np.minimum(margin, np.linalg.norm(to_place[:, None, None] - along[..., None] * sight, axis=-1))
    return undetected_nearest(clip, by_detection(clip, np.where(np.isnan(length2), np.nan, margin)), level)


def _places(centres: np.ndarray, people: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the places of pillars, (N, 2) m, between cameras (V, 2) and people (F, P, J, 2)."""
    known = people[~np.isnan(people).any(-1)]
    cameras, joints = rng.integers(len(centres), size=_DRAWN), rng.random(_DRAWN)
    along = rng.uniform(0.2, 0.8, (_DRAWN, 1))
    if not len(known):
        return np.empty((0, 2))
    places = centres[cameras] * (1 - along) + known[(joints * len(known)).astype(int)] * along
    room = [np.linalg.norm(known - place, axis=-1).min() for place in places]
    return places[np.argsort(room)[-_PILLARS:]]
