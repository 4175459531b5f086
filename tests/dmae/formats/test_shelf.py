"""The Shelf reader, on a bundle of two cameras and two frames and on the real one."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25, SHELF14
from dmae.formats.shelf import ANNOTATION_ERROR, BODY25_LINKS, assemble, read_shelf
from dmae.metrics.comparison import match, take_matched
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture

SIZE = (101, 51)


def detections(frames: list[dict[int, list[tuple]]], linked: float = 0.9) -> str:
    """Text of frames that give some joints candidates (x, y, confidence); the k-th of all joints belong together."""
    lines = [f"4 {len(frames)}"]
    for frame in frames:
        for joint in range(25):
            found = frame.get(joint, [])
            lines.append(str(len(found)))
            lines += [" ".join(str(candidate[row]) for candidate in found) for row in range(3)]
        for a, b in BODY25_LINKS:
            count_a, count_b = len(frame.get(a, [])), len(frame.get(b, []))
            lines += [" ".join(str(linked * (i == k)) for k in range(count_b)) for i in range(count_a)]
    return "\n".join(lines) + "\n"


def truth(persons: list[list[int]]) -> str:
    """Text of frames with some actors; joint j of actor a is at (a, j, 1), and its wrists are not valid."""
    lines = [f"15 {len(persons)}"]
    for actors in persons:
        lines.append(str(len(actors)))
        for actor in actors:
            valid = [int(SHELF14.joints[j] not in ("l_wrist", "r_wrist")) if j < 14 else 1 for j in range(15)]
            rows = ([actor] * 15, range(15), [1] * 15, valid)
            lines += [str(actor), *(" ".join(map(str, row)) for row in rows)]
    return "\n".join(lines) + "\n"


def calibration() -> dict:
    camera = {"K": [100, 0, 50, 0, 100, 25, 0, 0, 1], "RT": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 3], "imgSize": [*SIZE]}
    return {"0": camera, "1": camera}


FIRST = {0: [(0.5, 0.5, 0.8)], 1: [(0.5, 0.6, 0.9), (0.1, 0.2, 0.3)], 8: [(0.5, 0.8, 0.7), (0.1, 1.0, 0.6)]}


@pytest.fixture
def bundle(tmp_path: Path) -> Path:
    folder = tmp_path / "bundle"
    (folder / "detection").mkdir(parents=True)
    (folder / "calibration.json").write_text(json.dumps(calibration()))
    (folder / "detection" / "0.txt").write_text(detections([FIRST, {}]))
    (folder / "detection" / "1.txt").write_text(detections([{}, FIRST]))
    (folder / "gt.txt").write_text(truth([[2, 0], []]))
    return folder


def test_pixels_scores_and_people_are_those_of_the_text(bundle):
    clip = read_shelf(bundle)
    nose, neck, mid_hip = BODY25.index("nose", "neck", "mid_hip")
    assert clip.detections.xy.shape == (2, 2, 2, 25, 2)
    np.testing.assert_allclose(clip.detections.xy[0, 0, 0, [nose, neck, mid_hip]], [[50, 25], [50, 30], [50, 40]])
    np.testing.assert_allclose(clip.detections.xy[1, 1, 1, [neck, mid_hip]], [[10, 10], [10, 50]], atol=1e-5)
    np.testing.assert_allclose(clip.detections.score[1, 1, 0, [nose, neck, mid_hip]], [0.8, 0.9, 0.7])
    assert clip.detections.observed.sum() == 2 * 5
    assert not clip.detections.observed[0, 1].any()
    np.testing.assert_array_equal(clip.rig.size, [SIZE, SIZE])


def test_truth_has_a_row_for_each_actor(bundle):
    xyz = read_shelf(bundle).truth.xyz
    known = ~np.isnan(xyz).any(-1)
    assert xyz.shape == (2, 4, 14, 3)
    assert known.any(-1).tolist() == [[True, False, True, False], [False] * 4]
    np.testing.assert_array_equal(xyz[0, 2, SHELF14.index("top_head")[0]], [2, 13, 1])
    assert not known[0, 0, SHELF14.index("l_wrist", "r_wrist")].any()


def test_without_truth_there_is_none(bundle):
    (bundle / "gt.txt").unlink()
    assert read_shelf(bundle).truth is None


def cut(text: str, numbers: int) -> str:
    return " ".join(text.split()[:numbers])


GOOD = detections([FIRST, {}])

MALFORMED = {
    "a camera's detections are missing": ("detection/1.txt", None, [r"1\.txt: no such file"]),
    "no calibration": ("calibration.json", None, [r"calibration\.json: no such file"]),
    "no cameras": ("calibration.json", "[]", ["expected an object of cameras", r"found \[\]"]),
    "empty": ("detection/0.txt", "", [r"0\.txt, line 1, number 1, header", "found the end of the file"]),
    "another skeleton": ("detection/0.txt", "1 2", ["number 1", "expected skeleton type 4", "found 1"]),
    "no frames": ("detection/0.txt", "4 0", ["number 2", "at least one frame"]),
    "not a number": (
        "detection/0.txt",
        GOOD.replace("0.6", "O.6", 1),
        ["line 8, number 10, frame 0, neck: expected a finite number", "found O.6"],
    ),
    "not finite": ("detection/0.txt", GOOD.replace("0.6", "nan", 1), ["frame 0, neck", "finite", "found nan"]),
    "half a candidate": ("detection/0.txt", "4 1 1.5", ["line 1, number 3", "frame 0, nose", "whole number", "1.5"]),
    "cut in the candidates": (
        "detection/0.txt",
        cut(GOOD, 11),
        ["frame 0, neck", r"expected 6 numbers \(x, y and confidence", "the end of the file"],
    ),
    "cut in the affinities": (
        "detection/0.txt",
        cut(GOOD, 44),
        ["frame 0, affinity 1-8", "expected 4 numbers", "the end of the file"],
    ),
    "cut after a frame": ("detection/0.txt", detections([FIRST]).replace("4 1", "4 2", 1), ["frame 1, nose"]),
    "more than announced": ("detection/0.txt", GOOD + "7 7\n", ["after frame 1", "2 more numbers"]),
    "one frame too many": ("detection/1.txt", detections([{}] * 3), [r"1\.txt", "expected 2 frames", "found 3"]),
    "truth of other frames": ("gt.txt", truth([[]]), [r"gt\.txt, line 1, number 2", "2 frames", "found 1"]),
    "unknown actor": ("gt.txt", truth([[7], []]), ["frame 0", "actor id", "found 7"]),
    "an actor twice": ("gt.txt", truth([[1, 1], []]), ["frame 0", "an actor once a frame"]),
    "truth cut": ("gt.txt", cut(truth([[1], []]), 20), ["frame 0", "joints of actor 1", "the end of the file"]),
}


@pytest.mark.parametrize(("name", "text", "message"), MALFORMED.values(), ids=MALFORMED)
def test_malformed_files_are_named_with_the_place(bundle, name, text, message):
    if text is None:
        (bundle / name).unlink()
    else:
        (bundle / name).write_text(text)
    with pytest.raises((ValueError, FileNotFoundError)) as error:
        read_shelf(bundle)
    for part in [name.rpartition("/")[2].replace(".", r"\."), *message]:
        assert error.match(part)


def test_the_recording_has_the_people_that_are_in_it(shelf):
    """Five views of 301 frames; three to four people, of whom up to four are annotated in 174 frames."""
    assert shelf.detections.xy.shape[:2] == (301, 5)
    assert shelf.fps == 25
    people = (shelf.detections.observed.sum(-1) >= 8).sum(-1)
    assert (np.median(people, 0) >= 2).all()
    assert (people <= 6).all()
    annotated = ~np.isnan(shelf.truth.xyz).any((-1, -2))
    assert annotated.sum(0).tolist() == [174, 19, 78, 16]
    assert not annotated[150:216].any()


def test_assembled_joints_of_the_recording_lie_on_the_annotated_people(shelf):
    """Whole skeletons, not joints here and there: of each visible limb both ends are in one detection."""
    ends = ["r_shoulder", "r_elbow", "l_hip", "l_knee", "r_knee", "r_ankle"]
    pixels, depth = shelf.rig.project(shelf.truth.xyz[:, :1, SHELF14.index(*ends)])
    found = shelf.detections.xy[:, :, :, BODY25.index(*ends)]
    scale = depth / shelf.rig.K[:, 0, 0, None, None]
    near = np.linalg.norm(found - pixels, axis=-1) * scale < 0.15
    together = near.reshape(*near.shape[:3], 3, 2).all(-1).any(2).sum((0, 1))
    alone = near.any(2).reshape(*near.shape[:2], 3, 2).all(-1).sum((0, 1))
    assert (together > 0.95 * alone).all()
    assert (alone > 300).all()


# Assembly of 2D skeletons, from affinities made of people that are known.


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


def test_the_error_of_annotations_is_that_of_joints_on_which_cameras_agree(data_folder):
    """By the median of squared distances, less the stated variance of measured joints; left and right together."""
    clip = read_shelf(data_folder / "shelf")
    poses = convert(capture(clip, CaptureConfig()), SHELF14)
    matches = match(poses.xyz, clip.truth.xyz)
    xyz, cov, views = (take_matched(each, matches) for each in (poses.xyz, poses.cov, poses.views.astype(float)))
    squared = ((clip.truth.xyz.astype(np.float64) - xyz) ** 2).sum(-1)
    agreed = (views >= 3) & ~np.isnan(squared)
    for name, error in ANNOTATION_ERROR.items():
        at = [i for i, joint in enumerate(SHELF14.joints) if joint.endswith(name)]
        stated = np.trace(cov[:, :, at], axis1=-2, axis2=-1)[agreed[:, :, at]] / 3
        variance = np.median(squared[:, :, at][agreed[:, :, at]]) / chi2.ppf(0.5, 3) - np.nan_to_num(np.median(stated))
        assert error == pytest.approx(variance**0.5, rel=0.15), (name, variance**0.5)
