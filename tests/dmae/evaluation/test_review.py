"""Decisions are kept with the poses they were made on; displaced joints come first in the ranking, with their sign."""

import json
from dataclasses import replace

import numpy as np
import pytest

import dmae
from dmae.data.clip import Source
from dmae.evaluation.report.findings import BONE, JUMP, RESIDUAL, STATED, UNSTATED, check_ranking, rank_doubts, signs
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
from tests.support.reported_clips import completed_clip

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


COMPLETED = completed_clip()
WRIST = COMPLETED.poses.skeleton.joints.index("r_wrist")
PRECISE = np.broadcast_to(np.eye(3, dtype=np.float32) * 1e-4, COMPLETED.poses.cov.shape)


def clip_with(xyz: np.ndarray | None = None, cov: np.ndarray = PRECISE):
    """The clip with joints elsewhere, all of them measured and precise."""
    poses = replace(
        COMPLETED.poses, cov=np.where(np.isnan(COMPLETED.poses.xyz[..., None]), np.nan, cov).astype(np.float32)
    )
    return replace(COMPLETED, poses=poses if xyz is None else replace(poses, xyz=xyz))


def test_a_displaced_joint_comes_first():
    xyz = COMPLETED.poses.xyz.copy()
    frame = int(np.flatnonzero(np.isfinite(xyz[:, 0, WRIST, 0]))[20])
    xyz[frame, 0, WRIST] += (0, 0, 0.4)
    first = rank_doubts(clip_with(xyz))[0]
    assert (first.person, first.joint) == (0, "r_wrist")
    assert first.first <= frame <= first.last
    assert first.doubt > 0.05
    # A joint that every camera detects, and on which none agree, does not look like one that nobody detected.
    views = np.zeros(COMPLETED.poses.source.shape, int)
    clip = clip_with(xyz)
    first = rank_doubts(replace(clip, poses=replace(clip.poses, views=views)))[0]
    seen = np.isfinite(COMPLETED.detections.score[first.worst, :, :, WRIST]).any(-1).sum()
    assert (first.detected, first.views) == (seen, 0) and seen > 1
    # Cameras that measured it detected it, also where it was smoothed away from there since.
    clip = clip_with(COMPLETED.poses.xyz + np.float32((0, 0, 3)))
    doubts = rank_doubts(replace(clip, poses=replace(clip.poses, views=views + 4)))
    assert {(each.detected, each.views) for each in doubts} <= {(4, 4), (5, 4)}


def test_signs_are_distances():
    xyz = COMPLETED.poses.xyz.copy()
    before, clip = signs(clip_with())[0], clip_with(xyz)
    at = (slice(None), 0, WRIST)
    frame = int(np.flatnonzero(np.isfinite(xyz[:, 0, WRIST, 0]))[20])
    xyz[frame, 0, WRIST] += (0, 0, 0.4)
    after, _ = signs(replace(clip, poses=replace(clip.poses, xyz=xyz)))
    assert after[JUMP][at][frame] == pytest.approx(0.4, abs=0.02)
    assert after[BONE][at][frame] > before[BONE][at][frame] + 0.05
    assert before[STATED][at][frame] == pytest.approx(np.sqrt(3e-4), rel=1e-3)
    np.testing.assert_array_equal(after[STATED], before[STATED])
    assert all((sign >= 0).all() and np.isfinite(sign).all() for sign in after.values())
    assert set(after) == {STATED, UNSTATED, BONE, JUMP, RESIDUAL}


def test_people_of_two_stills_are_not_compared():
    """Jumps of people who moved on between two stills would come before every joint far from its detection."""
    found, _ = signs(replace(clip_with(), fps=0.0133))
    assert not found[JUMP].any() and not found[BONE].any() and found[RESIDUAL].any()
    assert signs(replace(clip_with(), fps=1.0))[0][JUMP].any()


def test_a_joint_of_unknown_error_is_more_doubtful_than_a_precise_one():
    cov = PRECISE.copy()
    cov[:, 0, WRIST] = np.nan
    ranking = rank_doubts(clip_with(cov=cov))
    count = sum(doubt.joint == "r_wrist" and doubt.person == 0 for doubt in ranking)
    assert count > 2
    assert {(doubt.joint, doubt.person) for doubt in ranking[:count]} == {("r_wrist", 0)}
    assert ranking[0].reason == "no stated error 200 mm"


def test_entries_cover_the_poses_once_and_leave_out_what_is_decided():
    clip = clip_with()
    ranking = rank_doubts(clip)
    counted = np.zeros(clip.poses.source.shape, int)
    for doubt in ranking:
        counted[doubt.first : doubt.last + 1, doubt.person, clip.poses.skeleton.joints.index(doubt.joint)] += 1
    there = clip.poses.source != Source.ABSENT
    assert counted.max() == 1
    assert (counted[there] == 1).all()
    decisions = [doubt.decision("accept") for doubt in ranking[:3]]
    assert all(decision.verdict is ReviewVerdict.accept for decision in decisions)
    assert rank_doubts(clip, decisions) == ranking[3:]


def test_a_clip_that_is_not_captured_is_refused():
    with pytest.raises(ValueError, match="run dmae capture on it first"):
        rank_doubts(replace(COMPLETED, poses=None))


def test_the_first_tenth_of_a_short_ranking_is_one_entry():
    wrist = POSES.skeleton.joints.index("l_wrist")
    xyz = POSES.xyz.copy()
    xyz[:, 0, wrist, 0] += np.float32(0.3)
    clip = replace(CLIP, truth=POSES, poses=replace(POSES, xyz=xyz))
    ranking = sorted(rank_doubts(clip), key=lambda doubt: (doubt.person, doubt.joint) != (0, "l_wrist"))
    every = check_ranking(clip, ranking)
    assert (every.off, every.found, every.first, every.entries) == (12, 12, len(ranking) // 10, len(ranking))
    few = check_ranking(clip, ranking[:9])
    assert few.first == 1 and few.found == ranking[0].last - ranking[0].first + 1
    assert check_ranking(clip, []).first == 0


def test_joints_with_a_decision_are_no_longer_looked_for():
    wrist = POSES.skeleton.joints.index("l_wrist")
    xyz = POSES.xyz.copy()
    xyz[:, 0, wrist, 0] += np.float32(0.3)
    clip = replace(CLIP, truth=POSES, poses=replace(POSES, xyz=xyz))
    found = check_ranking(clip, rank_doubts(clip, [Decision(0, "l_wrist", 0, 7, ReviewVerdict.blank)]))
    assert found.off == 4


@pytest.mark.slow
@pytest.mark.parametrize(("views", "least"), [([0, 1, 2, 3, 4], 0.48), ([0, 1, 2], 0.33)], ids=["five", "three"])
def test_it_finds_real_errors(shelf, views, least):
    """On Shelf the first tenth of the entries holds 50 % (five cameras) and 36 % (three) of what is over 10 cm off."""
    clip = shelf.select(views=views)
    clip = replace(clip, poses=dmae.complete(dmae.capture(clip), fps=clip.fps))
    found = check_ranking(clip, rank_doubts(clip))
    assert found.off > 50
    assert found.found / found.off > least
