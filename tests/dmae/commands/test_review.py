"""Entries of the ranking are decided on by number; exports and completion follow the decisions."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from dmae.commands import complete, export, review
from dmae.commands.config import CompleteCommand, ExportCommand, ReviewCommand
from dmae.data.clip import Source
from dmae.data.store import load_clip, save_clip
from dmae.evaluation.review import DECISIONS, load_decisions
from dmae.formats.own import read_npz
from tests.support.circling_people import circling_people, clip_of


@pytest.fixture
def folder(tmp_path):
    poses = circling_people(30, 2, rng=np.random.default_rng(0))
    save_clip(replace(clip_of(poses, "walk"), poses=poses), tmp_path / "walk")
    return tmp_path / "walk"


def decide(folder, **entries) -> list[dict]:
    """Run the command, and return the ranking that it writes."""
    config = ReviewCommand(clip=str(folder), **entries)
    review.run(config, review.default_out(config))
    with (folder.parent / "walk_review.csv").open() as file:
        return list(csv.DictReader(file))


def test_the_ranking_of_the_current_folder_is_written_beside_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert review.default_out(ReviewCommand(clip=".")) == tmp_path.parent / f"{tmp_path.name}_review.csv"


def joints(folder, *entries: dict) -> tuple:
    """Index of the joints of one entry after another."""
    poses = load_clip(folder).poses
    found = np.zeros(poses.source.shape, bool)
    for each in entries:
        frames = slice(int(each["first"]), int(each["last"]) + 1)
        found[frames, int(each["person"][1:]) - 1, poses.skeleton.joints.index(each["joint"])] = True
    return found


def test_exports_leave_out_what_is_blanked_and_handed_back(folder, tmp_path, capsys):
    before = decide(folder)
    after = decide(folder, accept=[1], blank=[2], hand_back=[4])
    assert [entry["joint"] for entry in after[:2]] == [before[2]["joint"], before[4]["joint"]]
    assert len(after) == len(before) - 3
    export.run(ExportCommand(clip=str(folder)), tmp_path / "poses.npz")
    left_out = joints(folder, before[1], before[3])
    np.testing.assert_array_equal(np.isnan(read_npz(tmp_path / "poses.npz")[0].xyz).any(-1), left_out)
    assert f"{left_out.sum()} joints are left out by the decisions of dmae review" in capsys.readouterr().out


def test_completion_fills_what_is_handed_back_and_leaves_out_what_is_blanked(folder, tmp_path):
    before = decide(folder)
    decide(folder, blank=[2], hand_back=[4])
    complete.run(CompleteCommand(clip=str(folder)), tmp_path / "completed")
    source = load_clip(tmp_path / "completed").poses.source
    np.testing.assert_array_equal(source == Source.ABSENT, joints(folder, before[1]))
    np.testing.assert_array_equal(source == Source.COMPLETED, joints(folder, before[3]))


def test_completion_after_a_review_leaves_accepted_and_smoothed_joints_as_they_are(folder, tmp_path):
    """They were smoothed a second time, and moved by centimetres."""
    decide(folder, hand_back=[1, 2])
    complete.run(CompleteCommand(clip=str(folder)), tmp_path / "completed")
    review.run(config := ReviewCommand(clip=str(tmp_path / "completed")), review.default_out(config))
    with (tmp_path / "completed_review.csv").open() as file:
        ranking = list(csv.DictReader(file))
    completed = next(entry for entry, row in enumerate(ranking, 1) if row["source"] == "completed")
    other = next(entry for entry, row in enumerate(ranking, 1) if row["source"] != "completed")
    review.run(replace(config, accept=[completed], hand_back=[other]), review.default_out(config))
    complete.run(CompleteCommand(clip=str(tmp_path / "completed")), tmp_path / "again")
    before, after = (load_clip(tmp_path / name).poses for name in ("completed", "again"))
    back = joints(tmp_path / "completed", ranking[other - 1])
    kept = joints(tmp_path / "completed", ranking[completed - 1]) | ((before.source == Source.DENOISED) & ~back)
    np.testing.assert_array_equal(after.xyz[kept], before.xyz[kept])
    np.testing.assert_array_equal(after.source[kept], before.source[kept])
    assert (after.source[back] == Source.COMPLETED).all()


def test_decisions_add_up(folder):
    decide(folder, blank=[1])
    decide(folder, blank=[1])
    assert len(load_decisions(folder, load_clip(folder).poses)) == 2


@pytest.mark.parametrize(
    ("entries", "said"),
    [
        ({"blank": [0]}, "entry 0: expected 1 to"),
        ({"accept": [10_000]}, "entry 10000"),
        ({"accept": [3], "blank": [3]}, "one decision on"),
    ],
)
def test_wrong_entries_are_refused_and_nothing_is_written(folder, entries, said):
    with pytest.raises(ValueError, match=said):
        decide(folder, **entries)
    assert not (folder / DECISIONS).exists()


def test_decisions_do_not_follow_a_clip_that_is_captured_anew(folder):
    decide(folder, blank=[1])
    clip = load_clip(folder)
    save_clip(replace(clip, poses=replace(clip.poses, xyz=clip.poses.xyz + np.float32(0.01))), folder)
    with pytest.raises(ValueError, match="made on other poses"):
        decide(folder)
