"""Errors by what hides a joint: planted ones are counted where they are."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Clip, Detections2D
from dmae.data.labels import OcclusionLabels, Visibility
from dmae.data.resources import read_preset
from dmae.data.skeleton import BODY25
from dmae.data.store import save_clip
from synth.detector.config import DetectorConfig
from synth.recognition.detector_errors import draw_errors, numbers, observe, pooled, study, tables
from tests.support.clips import looking_at_origin, walkers

FRAMES, VIEWS = 4, 3
WRIST, KNEES = BODY25.index("l_wrist"), BODY25.index("l_knee", "r_knee")


@pytest.fixture
def clip() -> Clip:
    """Two people, detected without error, of the first the left wrist hidden by an object 0.2 m before it."""
    rig, truth = looking_at_origin(VIEWS), walkers(FRAMES)
    xy, _ = rig.project(truth.xyz)
    visibility = np.full((FRAMES, VIEWS, 2, 25), Visibility.VISIBLE)
    visibility[:, :, 0, WRIST] = Visibility.HIDDEN_BY_OBJECT
    hidden = visibility == Visibility.HIDDEN_BY_OBJECT
    labels = OcclusionLabels(visibility, np.where(hidden, 0, -1), np.where(hidden, 0.2, np.nan), objects=("box",))
    return Clip("0", 25.0, rig, Detections2D(BODY25, xy, np.full(xy.shape[:-1], 0.8)), truth=truth, occlusion=labels)


def rows(clip: Clip) -> dict:
    found = numbers(observe(clip))
    return found | {(row["heading"], row["group"]): row for row in (*found["joints"], *found["people"])}


def with_detections(clip: Clip, xy: np.ndarray, score: np.ndarray) -> Clip:
    return replace(clip, detections=Detections2D(BODY25, xy, score))


def test_exact_detections_have_no_errors(clip):
    found = rows(clip)
    images = FRAMES * VIEWS
    assert (found["images"], found["ghosts"], found["duplicates"]) == (images, 0, 0)
    visible, hidden = found["cause", "visible"], found["cause", "hidden by an object"]
    assert (visible["joints"], hidden["joints"]) == (49 * images, images)
    for row in (visible, hidden):
        assert (row["missed"], row["near"], row["inverted"]) == (0, 1, 0)
        assert row["median"] == pytest.approx(0, abs=1e-4)
        assert row["confidence"] == pytest.approx(0.8)
    assert found["margin of hidden joints", "0.15 to 0.3 m"]["joints"] == images
    assert found["in plain sight", ""] == {
        "heading": "in plain sight", "group": "", "people": 2 * images, "found": 1.0
    }  # fmt: skip


def test_planted_errors_are_counted_where_they_are(clip):
    xy, score = clip.detections.xy.copy(), clip.detections.score.copy()
    xy[:, :, 0, WRIST, 0] += 40
    score[:, :, 0, WRIST] = 0.3
    score[:, :, 1, BODY25.index("nose")] = np.nan
    xy[np.isnan(score)] = np.nan
    # Cameras at 120 and 240 degrees see the knees well apart.
    xy[:, 1:, 1, KNEES] = xy[:, 1:, 1, KNEES[::-1]]
    found = rows(with_detections(clip, xy, score))
    hidden = found["cause", "hidden by an object"]
    assert (hidden["near"], hidden["confidence"]) == (0, pytest.approx(0.3))
    assert hidden["median"] == pytest.approx(40 / 227, rel=0.2)
    assert found["joint, visible", "nose"]["missed"] == pytest.approx(0.5)
    assert found["joint, visible", "knee"]["near"] < 1
    assert found["joint, visible", "elbow"]["near"] == 1


def test_exchanged_sides_are_inverted(clip):
    xy = clip.detections.xy.copy()
    xy[:, 0, 0] = xy[:, 0, 0][:, list(BODY25.mirror)]
    found = rows(with_detections(clip, xy, clip.detections.score))
    # Seen from the front, elbows and shoulders lie more than a tenth of the height from each other; eyes do not.
    assert found["joint, visible", "elbow"]["inverted"] == pytest.approx(1 / 6)
    assert found["joint, visible", "eye"]["inverted"] == 0


def test_ghosts_duplicates_and_missed_people(clip):
    xy, score = (np.repeat(each, 2, axis=2) for each in (clip.detections.xy, clip.detections.score))
    xy[:, :, 1] = xy[:, :, 0] + 3  # the first person twice
    xy[:, :, 2] = xy[:, :, 0] + (0, 400)  # a ghost
    score[:, :, 3] = np.nan  # the second person is missed
    xy[np.isnan(score)] = np.nan
    found = rows(with_detections(clip, xy, score))
    assert (found["ghosts"], found["duplicates"]) == (FRAMES * VIEWS, FRAMES * VIEWS)
    assert found["visible joints", "0.8 or more"]["found"] == 0.5


def test_joints_that_the_skeleton_lacks_are_no_misses(clip):
    xy, score = clip.detections.xy.copy(), clip.detections.score.copy()
    toes = BODY25.index("l_small_toe", "r_small_toe")
    xy[..., toes, :], score[..., toes] = np.nan, np.nan
    found = rows(with_detections(clip, xy, score))
    assert found["cause", "visible"]["missed"] == 0
    assert ("joint, visible", "small_toe") not in found


def test_simulated_detectors_beside_the_measured_one(clip, tmp_path):
    save_clip(clip, tmp_path)
    found = study([tmp_path], ["clean", "terrible"])
    assert list(found) == ["detections (measured)", "clean", "terrible"]
    errors = {
        name: {row["group"]: row for row in each["joints"] if row["heading"] == "cause"} for name, each in found.items()
    }
    assert errors["clean"]["visible"]["near"] == 1
    assert errors["terrible"]["visible"]["near"] < 0.95
    # The clean detector misses what is hidden.
    assert errors["clean"]["hidden by an object"]["missed"] == 1
    assert errors["clean"]["hidden by an object"]["near"] is None
    made = tables(found)
    assert len(made) == 7
    assert all(len(row) == len(table.header) for table in made for row in table.rows)
    assert len(draw_errors(found).axes) == 12


def test_pooling_adds_up(clip):
    one = observe(clip)
    both = pooled([one, one])
    assert both.images == 2 * one.images
    assert len(both.joints.error) == 2 * len(one.joints.error)


def test_unknown_presets_are_answered_with_those_there_are():
    with pytest.raises(ValueError, match=r"detector=nosuch: no preset .*clean, .* or a YAML file"):
        read_preset(DetectorConfig, "detector", "nosuch")
