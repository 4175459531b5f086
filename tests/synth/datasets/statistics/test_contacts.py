"""Contacts between people, against a state in which each contact is known."""

import numpy as np

from synth.datasets.statistics import clip_contacts, spread
from synth.people.body import SEGMENTS, Body
from synth.physics.body_state import BodyState


def state(contacts: list[tuple[int, int, int, float]]) -> BodyState:
    """A state of 10 frames with contacts of frame, both indices of names, and force, N."""
    frame, one, other, force = np.array(contacts, float).reshape(-1, 4).T
    empty = np.zeros((10, 2, 3), np.float32)
    return BodyState(
        qpos=np.zeros((10, 7)),
        root=empty,
        rotations=np.zeros((10, 2, len(SEGMENTS), 4), np.float32),
        forces=np.zeros((10, 2, len(SEGMENTS) + 1, 3), np.float32),
        shapes=(Body(), Body()),
        actions=np.zeros((10, 2), np.int16),
        action_names=("hug",),
        contact_frame=frame.astype(np.int32),
        contact_between=np.stack([one, other], 1).astype(np.int16),
        contact_names=("person0/l_hand", "person0/chest", "person1/chest", "box"),
        contact_point=np.zeros((len(frame), 3), np.float32),
        contact_force=np.stack([0 * force, force, 0 * force], 1).astype(np.float32),
        contact_depth=np.zeros(len(frame), np.float32),
    )


def test_only_contacts_between_different_people_count():
    # A hand on one's own chest and on a box, then on the other's chest, twice.
    found = clip_contacts(state([(0, 0, 1, 9), (1, 0, 3, 9), (2, 0, 2, 5), (3, 2, 0, 7), (3, 1, 2, 3), (8, 0, 2, 6)]))
    assert found == (10, 3, 2, 6.0)
    assert clip_contacts(state([])) == (10, 0, 0, 0.0)


def test_the_spread_of_clips():
    found = spread([clip_contacts(state([(k, 0, 2, 4.0) for k in range(n)])) for n in (2, 5, 9)])
    assert [found[f"share_{which}"] for which in ("least", "median", "most")] == [0.2, 0.5, 0.9]
    assert found["clips"] == 3
    assert found["touches_most"] == 1
