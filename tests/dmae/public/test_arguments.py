"""Arguments of another type are answered with the name of the argument and what to do."""

from pathlib import Path

import numpy as np
import pytest

import dmae
import synth
from tests.support.clips import full_clip

CLIP = full_clip()
POSES = CLIP.poses or CLIP.truth
ARRAY = np.zeros((12, 2, 25, 3))


def data_set() -> str:
    """Return the path of a data set without clips, below the current folder's parent."""
    folder = Path("../set")
    folder.mkdir(exist_ok=True)
    (folder / "manifest.jsonl").touch()
    return str(folder)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: dmae.capture("runs/walk"), r"capture: clip: expected a dmae\.Clip, found 'runs/walk'; dmae\.load"),
        (lambda: dmae.capture(Path("runs/walk")), r"found PosixPath\('runs/walk'\); dmae\.load"),
        (lambda: dmae.capture(ARRAY), r"an array of shape \(12, 2, 25, 3\); dmae\.Clip is made of cameras"),
        (lambda: dmae.capture([CLIP]), r"expected a dmae\.Clip, found a list; give one of them"),
        (
            lambda: dmae.complete(CLIP),
            r"complete: poses: expected a dmae\.Poses3D, found a Clip; dmae\.capture\(clip\)",
        ),
        (lambda: dmae.complete(ARRAY, 25), r"dmae\.Poses3D\(skeleton, xyz\) is made of an array"),
        (lambda: dmae.complete(poses=ARRAY, fps=25), r"complete: poses: expected a dmae\.Poses3D"),
        (lambda: dmae.evaluate(POSES, CLIP), r"evaluate: clip: .* found a Poses3D; dataclasses\.replace"),
        (lambda: dmae.evaluate(CLIP, "poses.npz"), r"evaluate: poses: .* dmae\.read_poses"),
        (lambda: dmae.completer("body25"), r"completer: skeleton: expected a dmae\.Skeleton, .* dmae\.get_skeleton"),
        (lambda: dmae.triangulate(CLIP, ARRAY, ARRAY), r"triangulate: rig: .* found a Clip; give clip\.rig"),
        (lambda: dmae.export(POSES, "x.npz"), r"export: clip: .* found a Poses3D"),
        (lambda: dmae.train("runs/data", "model"), r"train: clips: expected several clips, .* dmae\.load_dataset"),
        (lambda: dmae.train([CLIP, POSES], "model"), r"train: clips\[1\]: expected a dmae\.Clip, found a Poses3D"),
        (lambda: dmae.stress(CLIP), r"stress: clips: expected several clips, found a Clip; give \[clip\]"),
        (lambda: dmae.report(ARRAY, "x.html"), r"report: clip: expected several clips, found an array"),
        (lambda: dmae.corrupt(CLIP, "objects"), r"levels: expected levels by name"),
        (lambda: synth.contact_sheet(ARRAY, "x.png"), r"contact_sheet: clip: expected a dmae\.Clip"),
        (lambda: synth.compare(CLIP, CLIP), r"compare: sim: expected several clips, found a Clip"),
        (lambda: synth.compare_motion("takes", "sim"), r"compare_motion: sim: expected several clips, found 'sim'"),
        (lambda: dmae.Clip("x", 25, CLIP.rig, ARRAY), r"Clip\.detections: expected a Detections2D, found ndarray"),
        (lambda: dmae.Poses3D("body25", ARRAY), r"Poses3D\.skeleton: expected a Skeleton, found str; get_skeleton"),
    ],
)
def test_an_argument_of_another_type_is_named(call, said: str):
    with pytest.raises(TypeError, match=said):
        call()


@pytest.mark.parametrize(
    ("call", "error", "said"),
    [
        (lambda: dmae.capture(CLIP, "th_v=3"), ValueError, r"config='th_v=3': expected a preset"),
        (lambda: dmae.draw(CLIP, POSES, frame=99), ValueError, r"frame=99: clip '.*' has frames 0 to 11"),
        (lambda: dmae.show(CLIP, "pictures", frames=0), ValueError, r"frames=0: expected 1 or more"),
        (lambda: dmae.export(CLIP, "x.trc"), ValueError, r"x\.trc: format=npz, but \.trc is of format=trc"),
        (lambda: dmae.get_skeleton("body26"), KeyError, "did you mean 'body25'"),
        (
            lambda: dmae.read("nowhere", format="openpose"),
            FileNotFoundError,
            "^nowhere: no such file or folder",
        ),
        (lambda: CLIP.select(views=["left"]), IndexError, r"cameras \['left'\]: expected a slice or a list of indices"),
        (
            lambda: dmae.load(data_set()),
            FileNotFoundError,
            "set: expected a clip folder .* name the folder of one clip",
        ),
        (lambda: synth.plan(arena="nowhere.xml"), FileNotFoundError, r"nowhere\.xml: no such file; expected an MJCF"),
    ],
)
def test_a_wrong_value_is_named(call, error: type, said: str, tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error, match=said):
        call()
    assert not list(tmp_path.iterdir())


def test_a_missing_argument_is_named_by_python():
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'fps'"):
        dmae.complete(POSES)
    with pytest.raises(TypeError, match="unexpected keyword argument 'th_v'"):
        dmae.capture(CLIP, th_v=3)
