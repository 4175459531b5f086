"""Submissions that do not fit the benchmark are refused, and the error names the mismatch."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dmae.data.clip import Poses3D
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25, COCO17, Skeleton
from dmae.data.store import save_clip
from dmae.evaluation.benchmark.hand_in import HandIn, Task, check_poses
from dmae.formats.npz import export_npz
from tests.support.clips import full_clip, walkers

NAME = "1_self/apart/000000"
GIVEN = walkers()
ODD = Skeleton("odd", ("tail",), (-1,))


def scaled(poses: Poses3D, factor: float) -> Poses3D:
    return replace(poses, xyz=poses.xyz * np.float32(factor))


@pytest.mark.parametrize(
    ("poses", "message"),
    [
        (GIVEN.xyz, "expected dmae.Poses3D, found ndarray"),
        (GIVEN.select(slice(1, None)), "expected 12 frames .*found 11"),
        (walkers(persons=3), "expected 2 persons.*found 3"),
        (Poses3D(ODD, np.zeros((12, 2, 1, 3))), "no way from skeleton 'odd' to 'body25'"),
        (scaled(GIVEN, 1000), "1000 times as long as the true ones, as if in mm"),
        (scaled(GIVEN, 100), "as if in cm"),
        (replace(GIVEN, xyz=np.where(GIVEN.xyz > 1.6, np.inf, GIVEN.xyz)), "infinite coordinates"),
    ],
)
def test_what_does_not_fit_is_named(poses, message):
    with pytest.raises(ValueError, match=f"mine: .*{message}|mine: {message}"):
        check_poses(poses, GIVEN, Task.completion, "mine")


def test_poses_on_another_skeleton_are_converted():
    found = check_poses(convert(GIVEN, COCO17), GIVEN, Task.completion, "mine")
    wrist = BODY25.index("r_wrist")
    np.testing.assert_array_equal(found.xyz[:, :, wrist], GIVEN.xyz[:, :, wrist])
    assert found.skeleton == BODY25


def test_captures_may_have_any_number_of_persons_and_nothing_may_be_handed_in():
    check_poses(walkers(persons=3), GIVEN, Task.capture, "mine")
    check_poses(GIVEN.without(np.ones(GIVEN.source.shape, bool)), GIVEN, Task.completion, "mine")


@pytest.mark.parametrize("kind", ["npz", "clip"])
def test_folders_of_poses_are_read(tmp_path: Path, kind: str):
    clip = replace(full_clip(), poses=GIVEN)
    if kind == "npz":
        export_npz(GIVEN, 25.0, tmp_path / f"{NAME}.npz")
    else:
        save_clip(clip, tmp_path / NAME)
    hand_in = HandIn(str(tmp_path), Task.completion)
    hand_in.check([NAME])
    np.testing.assert_array_equal(hand_in.poses(NAME, clip).xyz, GIVEN.xyz)
    with pytest.raises(ValueError, match=r"clip 1_self/apart/000000: expected 50 frames per second, found 25"):
        hand_in.poses(NAME, replace(clip, fps=50.0))


def test_clips_that_a_folder_lacks_are_named(tmp_path: Path):
    export_npz(GIVEN, 25.0, tmp_path / f"{NAME}.npz")
    others = [f"2_edge/standing/00000{number}" for number in range(5)]
    with pytest.raises(FileNotFoundError, match=r"lacks 5 of 6 clips: 2_edge/standing/000000, .* and 2 more"):
        HandIn(str(tmp_path), Task.completion).check([NAME, *others])


def test_a_clip_without_poses_is_named(tmp_path: Path):
    save_clip(full_clip(), tmp_path / NAME)
    with pytest.raises(ValueError, match="000000"):
        HandIn(str(tmp_path), Task.completion).poses(NAME, replace(full_clip(), poses=GIVEN))


@pytest.mark.parametrize(
    ("name", "task", "message"),
    [
        ("linar", Task.completion, "did you mean 'linear'"),
        ("no_such_module:fill", Task.completion, "cannot import no_such_module"),
        ("triangulate", Task.capture, "captures=triangulate: expected capture, package.module:function, or a folder"),
        ("tests.support.clips:nothing", Task.capture, "has no function 'nothing'"),
    ],
)
def test_unknown_hand_ins_are_refused_before_anything_is_computed(name, task, message):
    with pytest.raises(ValueError, match=message):
        HandIn(name, task).check([NAME])


def test_a_folder_called_as_a_method_does_not_hide_it(tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "linear").mkdir()
    assert HandIn("linear", Task.completion).folder is None
    assert HandIn("./linear", Task.completion).folder is not None


def test_what_a_function_raises_is_told_with_the_function_and_the_clip(tmp_path: Path, monkeypatch):
    (tmp_path / "breaking_fill.py").write_text("def fill(poses, fps):\n    return poses.nothing\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    hand_in = HandIn("breaking_fill:fill", Task.completion)
    with pytest.raises(ValueError, match=r"breaking_fill:fill, clip 1_self/apart/000000: AttributeError: .*nothing"):
        hand_in.poses(NAME, replace(full_clip(), poses=GIVEN))
