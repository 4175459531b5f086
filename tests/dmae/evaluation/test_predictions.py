"""Poses made elsewhere are scored like our own; poses that do not fit are refused, and the error names both sides."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dmae as verbs
from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25, SHELF14, Skeleton, get_skeleton
from dmae.data.store import save_clip, write_manifest
from dmae.evaluation.evaluate import evaluate
from dmae.formats.own import export_npz
from tests.support.commands import dmae
from tests.support.scored_clips import config, seen


def true_poses(clip: Clip) -> Poses3D:
    return convert(clip.truth, BODY25)


@pytest.fixture
def clip(tmp_path: Path) -> Clip:
    clip = seen()
    save_clip(clip, tmp_path / "data")
    return clip


def scored(tmp_path: Path, poses: Poses3D, fps: float = 25.0, **changes) -> dict:
    export_npz(poses, fps, tmp_path / "poses.npz")
    return evaluate(config(tmp_path / "data", poses=str(tmp_path / "poses.npz"), **changes))


def test_what_we_capture_scores_the_same_as_a_file(clip: Clip, tmp_path: Path):
    poses = verbs.capture(clip)
    (handed,) = scored(tmp_path, poses)["results"]
    (own,) = evaluate(config(tmp_path / "data", methods=["measured"]))["results"]
    assert (handed["method"], handed["views"]) == ("poses", 4)
    assert handed["mean"] == own["mean"]
    assert handed["mean"]["pcp"] == verbs.evaluate(clip, poses)["pcp"]


def test_the_true_poses_are_perfect_whoever_is_first(clip: Clip, tmp_path: Path):
    poses = true_poses(clip)
    scores = scored(tmp_path, Poses3D(BODY25, poses.xyz[:, ::-1]))
    (result,) = scores["results"]
    assert scores["poses"] == "poses of poses.npz"
    assert result["mean"]["pcp"] == 100
    assert result["mean"]["mpjpe"]["all"] < 1


def test_files_of_several_people_are_named_as_their_export_was(clip: Clip, tmp_path: Path):
    verbs.export(clip, tmp_path / "walk.trc", poses=true_poses(clip))
    assert not (tmp_path / "walk.trc").exists() and (tmp_path / "walk_P2.trc").is_file()
    done = dmae(tmp_path, "evaluate", "data=data", "poses=walk.trc", "out=scores")
    assert done.returncode == 0, done.stderr
    (result,) = json.loads((tmp_path / "scores/scores.json").read_text())["results"]
    assert result["mean"]["pcp"] == 100


def test_a_completed_clip_is_told_how_its_poses_are_scored(clip: Clip, tmp_path: Path):
    poses = true_poses(clip)
    save_clip(
        replace(clip, poses=replace(poses, source=np.full_like(poses.source, Source.COMPLETED))), tmp_path / "full"
    )
    line = "Scored is a new capture of the detections; poses=full scores the completed poses there"
    assert line in dmae(tmp_path, "evaluate", "data=full", "methods=[measured]").stdout
    assert line not in dmae(tmp_path, "evaluate", "data=full", "poses=full", "out=own").stdout


def test_it_is_said_that_joints_are_converted_for_their_score(clip: Clip, tmp_path: Path):
    """As on simulated people, whose truth has the joints of OpenPose and of Shelf."""
    parts = [convert(true_poses(clip), each).xyz for each in (BODY25, SHELF14)]
    truth = Poses3D(get_skeleton("body25+shelf14"), np.concatenate(parts, 2))
    save_clip(replace(clip, truth=truth), tmp_path / "both")
    converted, own = (
        dmae(tmp_path, "evaluate", "data=both", "methods=[measured]", *more).stdout
        for more in ((), ("skeleton=body25",))
    )
    assert (
        "scored on shelf14, to which joints of body25 are converted, with errors of its own; skeleton=body25"
        in converted
    )
    assert "converted" not in own


def test_completed_joints_are_those_that_were_hidden(clip: Clip, tmp_path: Path):
    poses = true_poses(clip)
    source = poses.source.copy()
    source[8:12, 0, BODY25.index("l_wrist")[0]] = Source.COMPLETED
    (result,) = scored(tmp_path, replace(poses, source=source))["results"]
    assert result["mean"]["gaps"][0]["hidden"] == 4
    assert result["mean"]["hidden"]["recall"] == 100


def test_poses_of_nothing_are_missed_people_and_errors_that_are_not_measured(clip: Clip, tmp_path: Path):
    nothing = Poses3D(BODY25, np.full_like(true_poses(clip).xyz, np.nan))
    (result,) = scored(tmp_path, nothing)["results"]
    mean = result["mean"]
    assert (mean["pcp"], mean["pck"]["recall"]) == (0, 0)
    assert mean["mpjpe"]["all"] is mean["pck"]["precision"] is mean["hidden"]["mpjpe"] is None


def test_a_truth_of_nothing_is_not_measured(clip: Clip, tmp_path: Path):
    """A clip of nobody has nothing to compare with: neither 0 nor 100."""
    poses = true_poses(clip)
    xyz = clip.truth.xyz[:, :0]
    save_clip(replace(clip, truth=Poses3D(clip.truth.skeleton, xyz)), tmp_path / "data")
    export_npz(poses, 25.0, tmp_path / "poses.npz")
    done = dmae(tmp_path, "evaluate", "data=data", "poses=poses.npz", "out=scores")
    assert done.returncode == 0, done.stderr
    (result,) = json.loads((tmp_path / "scores/scores.json").read_text())["results"]
    assert result["mean"]["pcp"] is result["mean"]["pck"]["recall"] is result["mean"]["mpjpe"]["all"] is None
    assert "not measured" in done.stdout


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda poses: poses.select(slice(0, 15)), "expected 20 frames of poses as of truth, found 15"),
        (
            lambda poses: Poses3D(BODY25, 1000 * poses.xyz),
            r"in m; their bones are 1000 times as long as .*, as if in mm. Divide .* by 1000, unless it is the truth",
        ),
        (lambda poses: Poses3D(BODY25, 3.3 * poses.xyz), "3.3 times as long as the true ones, as if in feet"),
        (
            lambda poses: Poses3D(BODY25, 0 * poses.xyz),
            "found joints at one place; joints that are not known must be NaN",
        ),
        (lambda poses: Poses3D(BODY25, 0.2 * poses.xyz), r"are 0.2 times as long as the true ones. Divide .* by 0.2"),
    ],
)
def test_poses_that_do_not_fit_are_refused_with_both_sides(clip: Clip, tmp_path: Path, wrong, message: str):
    poses = wrong(true_poses(clip))
    with pytest.raises(ValueError, match=f"poses.npz: clip 'seen': .*{message}"):
        scored(tmp_path, poses)
    with pytest.raises(ValueError, match=message):
        verbs.evaluate(clip, poses)


def test_poor_poses_are_scored_and_not_refused(clip: Clip, tmp_path: Path):
    poses = true_poses(clip)
    noise = np.random.default_rng(0).normal(0, 0.1, poses.xyz.shape)
    (result,) = scored(tmp_path, Poses3D(BODY25, poses.xyz + noise))["results"]
    assert 100 < result["mean"]["mpjpe"]["all"] < 250


def test_another_rate_is_refused(clip: Clip, tmp_path: Path):
    with pytest.raises(ValueError, match=r"expected 25 frames a second as in clip 'seen', found 30; resample"):
        scored(tmp_path, true_poses(clip), fps=30.0)


def test_a_skeleton_without_a_conversion_is_refused(clip: Clip):
    tail = Skeleton("tail", ("tip",), (-1,))
    with pytest.raises(ValueError, match="no way from skeleton 'tail' to 'shelf14': it has none of"):
        verbs.evaluate(clip, Poses3D(tail, np.zeros((20, 1, 1, 3))))


def test_tracks_need_as_many_persons(clip: Clip, tmp_path: Path):
    """With synthetic gaps person i is true person i."""
    poses = true_poses(clip)
    (result,) = scored(tmp_path, poses, input="true_poses")["results"]
    assert result["mean"]["pcp"] == 100
    with pytest.raises(ValueError, match="expected 2 persons, each of the index of the true one, found 1"):
        scored(tmp_path, Poses3D(BODY25, poses.xyz[:, :1]), input="true_poses")


def test_options_that_poses_exclude_are_refused(clip: Clip, tmp_path: Path):
    for changes in ({"views": [3]}, {"views": [3], "reference": "capture"}):
        with pytest.raises(ValueError, match="leave out views, reference"):
            scored(tmp_path, true_poses(clip), **changes)


def two_clips(tmp_path: Path) -> None:
    for name in "ab":
        save_clip(seen(name=name), tmp_path / "data" / name)
    write_manifest(tmp_path / "data", [{"id": name, "status": "ok"} for name in "ab"])


def test_a_folder_holds_the_poses_of_each_clip(tmp_path: Path):
    two_clips(tmp_path)
    for name in "ab":
        export_npz(convert(seen().truth, SHELF14), 25.0, tmp_path / "mine" / f"{name}.npz")
    scores = evaluate(config(tmp_path / "data", poses=str(tmp_path / "mine")))
    assert [run["clip"] for run in scores["results"][0]["runs"]] == ["a", "b"]
    assert scores["results"][0]["mean"]["pcp"] == 100


def test_ids_that_do_not_match_are_refused(tmp_path: Path):
    two_clips(tmp_path)
    poses = convert(seen().truth, SHELF14)
    for name in "ac":
        export_npz(poses, 25.0, tmp_path / "mine" / f"{name}.npz")
    with pytest.raises(ValueError, match="of the clips a, b, found a, c; without poses: b; of no clip: c"):
        evaluate(config(tmp_path / "data", poses=str(tmp_path / "mine")))
    with pytest.raises(ValueError, match="expected poses of the 2 clips a, b, found poses of one"):
        evaluate(config(tmp_path / "data", poses=str(tmp_path / "mine/a.npz")))
    save_clip(replace(seen(name="b"), poses=convert(seen().truth, BODY25)), tmp_path / "swapped")
    with pytest.raises(
        ValueError, match=r"expected poses of clip 'a', found poses of clip 'b'; if .*dmae export clip="
    ):
        evaluate(config(tmp_path / "data/a", poses=str(tmp_path / "swapped")))
    save_clip(replace(seen(name="session"), poses=convert(seen().truth, BODY25)), tmp_path / "taken/a")
    evaluate(config(tmp_path / "data/a", poses=str(tmp_path / "taken/a")))


def test_folders_that_are_swapped_are_refused_with_both_ids(tmp_path: Path):
    two_clips(tmp_path)
    for id, folder in ("ab", "ba"):
        save_clip(replace(seen(name=id), poses=convert(seen().truth, BODY25)), tmp_path / "mine" / folder)
    wrong = r"mine/a: expected poses of clip 'a', found poses of clip 'b'; name each folder as its clip"
    for data, mine in (("data", "mine"), ("data/a", "mine/a")):
        with pytest.raises(ValueError, match=wrong):
            evaluate(config(tmp_path / data, poses=str(tmp_path / mine)))


def test_folders_of_trials_that_keep_their_ids_are_told_apart(tmp_path: Path):
    """Folders called a and b may hold trials that were recorded as b and c."""
    two_clips(tmp_path)
    for id, folder in ("ba", "cb"):
        clip = replace(seen(name=id), poses=convert(seen().truth, BODY25))
        save_clip(replace(clip, poses=None), tmp_path / "data" / folder)
        save_clip(clip, tmp_path / "mine" / folder)
    scores = evaluate(config(tmp_path / "data", poses=str(tmp_path / "mine")))
    assert scores["results"][0]["mean"]["pcp"] == 100
    (tmp_path / "mine/a").rename(tmp_path / "mine/swap")
    (tmp_path / "mine/b").rename(tmp_path / "mine/a")
    (tmp_path / "mine/swap").rename(tmp_path / "mine/b")
    with pytest.raises(ValueError, match="mine/a: expected poses of clip 'b', found poses of clip 'c'; name each"):
        evaluate(config(tmp_path / "data", poses=str(tmp_path / "mine")))
