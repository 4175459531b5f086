"""Assembly of 2D skeletons, from affinities made of people that are known."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dmae.data.skeleton import BODY25
from dmae.formats.recordings.candidate_assembly import BODY25_LINKS, assemble


def affinities(people: list[list[int]], strength=lambda a, b: 0.9) -> list[np.ndarray]:
    """Of people given by joint -> candidate (J,), -1 for none: full affinity within, none between them."""
    matrices = []
    for a, b in BODY25_LINKS:
        matrix = np.zeros((count(people, a), count(people, b)))
        for person in people:
            if person[a] >= 0 and person[b] >= 0:
                matrix[person[a], person[b]] = strength(a, b)
        matrices.append(matrix)
    return matrices


def count(people: list[list[int]], joint: int) -> int:
    return 1 + max((person[joint] for person in people), default=-1)


def counts(people: list[list[int]]) -> list[int]:
    return [count(people, joint) for joint in range(25)]


def as_set(skeletons: np.ndarray) -> set[tuple[int, ...]]:
    return {tuple(skeleton) for skeleton in np.asarray(skeletons).tolist()}


def test_no_candidates_give_no_skeletons():
    assert assemble([0] * 25, affinities([])).shape == (0, 25)


@settings(max_examples=50, deadline=None)
@given(st.integers(1, 5), st.integers(0, 2**32 - 1))
def test_whole_people_are_found_whatever_the_order_of_candidates(people, seed):
    rng = np.random.default_rng(seed)
    persons = np.stack([rng.permutation(people) for _ in range(25)], -1).tolist()
    assert as_set(assemble(counts(persons), affinities(persons))) == as_set(persons)


def test_part_of_a_person_is_kept_and_a_lone_joint_is_a_skeleton():
    whole, arm, lone = [0] * 25, [-1] * 25, [-1] * 25
    for joint in BODY25.index("l_shoulder", "l_elbow", "l_wrist"):
        arm[joint] = 1
    lone[BODY25.index("r_wrist")[0]] = 1
    people = [whole, arm, lone]
    found = assemble(counts(people), affinities(people))
    assert found.tolist() == people  # the larger first


def test_ear_hangs_on_the_shoulder_when_nose_and_eyes_are_hidden():
    """The face's way to the neck leads over the nose; the redundant link from the shoulder holds without it."""
    person = [0] * 25
    for joint in BODY25.index("nose", "l_eye", "r_eye"):
        person[joint] = -1
    assert assemble(counts([person]), affinities([person])).tolist() == [person]


def test_a_joint_goes_to_the_stronger_of_two_claims():
    one, two = [0] * 25, [1] * 25
    elbow, wrist = BODY25.index("l_elbow", "l_wrist")
    two[wrist] = -1
    people = [one, two]
    matrices = affinities(people)
    matrices[BODY25_LINKS.index((elbow, wrist))][:] = [[0.4], [0.8]]
    found = assemble(counts(people), matrices)
    one[wrist], two[wrist] = -1, 0
    assert as_set(found) == as_set(people)


def test_a_strong_false_link_does_not_join_two_people():
    """Both have a neck: what would have two of a joint is never one skeleton."""
    people = [[0] * 25, [1] * 25]
    matrices = affinities(people, lambda a, b: 0.5)
    matrices[BODY25_LINKS.index((2, 17))][0, 1] = 1.0
    found = assemble(counts(people), matrices)
    assert (found >= 0).sum() == 50
    torso = BODY25.index("neck", "mid_hip", "l_hip", "l_knee", "l_ankle", "l_shoulder", "r_elbow")
    assert as_set(found[:2, torso]) == {(0,) * 7, (1,) * 7}


def test_each_candidate_is_in_one_skeleton_whatever_the_affinities():
    rng = np.random.default_rng(0)
    for _ in range(50):
        number = rng.integers(0, 5, 25)
        matrices = [rng.random((number[a], number[b])) for a, b in BODY25_LINKS]
        found = assemble(number, matrices)
        for joint in range(25):
            assert sorted(found[found[:, joint] >= 0, joint]) == list(range(number[joint]))
