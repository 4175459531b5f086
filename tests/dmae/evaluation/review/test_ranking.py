"""Joints that are displaced come first in the ranking, with the sign that reveals them."""

from dataclasses import replace

import numpy as np
import pytest

import dmae
from dmae.data.clip import Source
from dmae.evaluation.review import (
    BONE,
    JUMP,
    RESIDUAL,
    STATED,
    UNSTATED,
    ReviewVerdict,
    check_ranking,
    rank_doubts,
    signs,
)
from tests.support.reported_clips import completed_clip

CLIP = completed_clip()
WRIST = CLIP.poses.skeleton.joints.index("r_wrist")
PRECISE = np.broadcast_to(np.eye(3, dtype=np.float32) * 1e-4, CLIP.poses.cov.shape)


def clip_with(xyz: np.ndarray | None = None, cov: np.ndarray = PRECISE):
    """The clip with joints elsewhere, all of them measured and precise."""
    poses = replace(CLIP.poses, cov=np.where(np.isnan(CLIP.poses.xyz[..., None]), np.nan, cov).astype(np.float32))
    return replace(CLIP, poses=poses if xyz is None else replace(poses, xyz=xyz))


def test_a_displaced_joint_comes_first():
    xyz = CLIP.poses.xyz.copy()
    frame = int(np.flatnonzero(np.isfinite(xyz[:, 0, WRIST, 0]))[20])
    xyz[frame, 0, WRIST] += (0, 0, 0.4)
    first = rank_doubts(clip_with(xyz))[0]
    assert (first.person, first.joint) == (0, "r_wrist")
    assert first.first <= frame <= first.last
    assert first.doubt > 0.05


def test_signs_are_distances():
    xyz = CLIP.poses.xyz.copy()
    before, clip = signs(clip_with()), clip_with(xyz)
    at = (slice(None), 0, WRIST)
    frame = int(np.flatnonzero(np.isfinite(xyz[:, 0, WRIST, 0]))[20])
    xyz[frame, 0, WRIST] += (0, 0, 0.4)
    after = signs(replace(clip, poses=replace(clip.poses, xyz=xyz)))
    assert after[JUMP][at][frame] == pytest.approx(0.4, abs=0.02)
    assert after[BONE][at][frame] > before[BONE][at][frame] + 0.05
    assert before[STATED][at][frame] == pytest.approx(np.sqrt(3e-4), rel=1e-3)
    np.testing.assert_array_equal(after[STATED], before[STATED])
    assert all((sign >= 0).all() and np.isfinite(sign).all() for sign in after.values())
    assert set(after) == {STATED, UNSTATED, BONE, JUMP, RESIDUAL}


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
        rank_doubts(replace(CLIP, poses=None))


@pytest.mark.slow
@pytest.mark.parametrize(("views", "least"), [([0, 1, 2, 3, 4], 0.5), ([0, 1, 2], 0.33)], ids=["five", "three"])
def test_it_finds_real_errors(shelf, views, least):
    """On Shelf the first tenth of the entries holds 52 % (five cameras) and 36 % (three) of what is over 10 cm off."""
    clip = shelf.select(views=views)
    clip = replace(clip, poses=dmae.complete(dmae.capture(clip), fps=clip.fps))
    found = check_ranking(clip, rank_doubts(clip))
    assert found.off > 50
    assert found.found / found.off > least
