"""Decisions on joints are kept with the poses that they were made on, and change nothing else."""

import json
from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Source
from dmae.evaluation.review import (
    DECISIONS,
    Decision,
    ReviewVerdict,
    decided,
    load_decisions,
    save_decisions,
    with_decisions,
)
from tests.support.clips import full_clip, walkers

POSES = walkers(12, 2)
CLIP = replace(full_clip(12, 4), poses=POSES)
BLANKED = Decision(1, "neck", 2, 4, ReviewVerdict.blank)
ACCEPTED = Decision(0, "nose", 0, 11, ReviewVerdict.accept)
HANDED_BACK = Decision(0, "l_wrist", 11, 11, ReviewVerdict.hand_back)


def test_decisions_are_read_as_they_were_saved(tmp_path):
    assert load_decisions(tmp_path, POSES) == ()
    save_decisions(tmp_path, POSES, [BLANKED, ACCEPTED, HANDED_BACK])
    assert load_decisions(tmp_path, POSES) == (BLANKED, ACCEPTED, HANDED_BACK)


def test_only_what_is_blanked_or_handed_back_is_left_out(tmp_path):
    assert with_decisions(CLIP, tmp_path) is CLIP
    save_decisions(tmp_path, POSES, [BLANKED, ACCEPTED, HANDED_BACK])
    kept = with_decisions(CLIP, tmp_path).poses
    left_out = np.zeros(POSES.source.shape, bool)
    left_out[2:5, 1, POSES.skeleton.joints.index("neck")] = True
    left_out[11, 0, POSES.skeleton.joints.index("l_wrist")] = True
    np.testing.assert_array_equal(kept.source == Source.ABSENT, left_out)
    np.testing.assert_array_equal(kept.xyz[~left_out], POSES.xyz[~left_out])


def test_the_last_decision_on_a_joint_holds():
    again = replace(BLANKED, first=3, last=3, verdict=ReviewVerdict.accept)
    found = decided(POSES, [BLANKED, again], ReviewVerdict.blank)
    assert np.flatnonzero(found.any((1, 2))).tolist() == [2, 4]


def test_decisions_on_other_poses_are_refused(tmp_path):
    save_decisions(tmp_path, POSES, [BLANKED])
    moved = replace(POSES, xyz=POSES.xyz + np.float32(0.001))
    with pytest.raises(ValueError, match=r"decisions\.json: its decisions were made on other poses"):
        load_decisions(tmp_path, moved)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"joint": "tail"}, "body25 has no such joint"),
        ({"person": 2}, "expected 0 to 1"),
        ({"last": 12}, "frames 0 to 11"),
        ({"first": 5}, "expected an order"),
    ],
)
def test_decisions_on_what_is_not_there_are_refused(tmp_path, change, said):
    with pytest.raises(ValueError, match=said):
        save_decisions(tmp_path, POSES, [replace(BLANKED, **change)])
    assert not (tmp_path / DECISIONS).exists()
    save_decisions(tmp_path, POSES, [BLANKED])
    content = json.loads((tmp_path / DECISIONS).read_text())
    content["decisions"][0] |= change
    (tmp_path / DECISIONS).write_text(json.dumps(content))
    with pytest.raises(ValueError, match=rf"decisions\.json: .*{said}"):
        load_decisions(tmp_path, POSES)


@pytest.mark.parametrize("text", ["[]", "{", '{"format": 2}', '{"format": 1, "decisions": [{"verdict": "burn"}]}'])
def test_malformed_files_are_named(tmp_path, text):
    (tmp_path / DECISIONS).write_text(text)
    with pytest.raises(ValueError, match=r"decisions\.json: "):
        load_decisions(tmp_path, POSES)
