"""The commands as users type them."""

import gc
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hydra._internal.hydra import Hydra
from hydra.core.config_store import ConfigStore

from dmae.command_line.options import Command
from dmae.data.clip import Source
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25, PANOPTIC19
from dmae.data.store import load_clip, save_clip, write_manifest
from dmae.formats import easymocap, panoptic
from dmae.formats.calibrations import write_calibration
from dmae.formats.own import read_npz
from dmae.formats.trc import read_trc
from tests.support.clips import full_clip, walkers
from tests.support.commands import dmae
from tests.support.recordings import recording, write_frames


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A working directory that holds a clip and a data set of two clips."""
    folder = tmp_path_factory.mktemp("work")
    save_clip(full_clip(frames=20), folder / "one")
    for name in ("a", "b"):
        save_clip(full_clip(frames=20), folder / "set" / name)
    write_manifest(folder / "set", [{"id": "a", "status": "ok"}, {"id": "b", "status": "ok"}])
    foreign(folder)
    return folder


def foreign(folder):
    """The same walk as an OpenPose, Pose2Sim, EasyMocap and Panoptic recording."""
    clip = recording(BODY25, 20)
    write_frames(clip, folder / "openpose")
    write_calibration(clip.rig, folder / "openpose/calibration.toml", "pose2sim")
    write_frames(clip, folder / "pose2sim/trial/pose", "{camera}_json/{camera}_{frame:06d}.json")
    write_calibration(clip.rig, folder / "pose2sim/calibration/Calib.toml", "pose2sim")
    (folder / "pose2sim/trial/Config.toml").write_text("project = {frame_rate = 25}\npose = {pose_model = 'BODY_25'}\n")
    easymocap.write_easymocap(clip, folder / "easymocap")
    panoptic.write_poses(convert(walkers(20), PANOPTIC19), 25.0, folder / "panoptic")
    write_calibration(clip.rig, folder / "panoptic/calibration_walk.json", "panoptic")
    write_frames(clip, folder / "panoptic/openpose")


def test_cameras_drawn_for_each_clip_are_kept_and_learned_from_with_other_sets(folder):
    done = dmae(folder, "capture", "data=set", "draw=[2,3]", "out=drawn")
    assert done.returncode == 0, done.stderr
    first = [load_clip(folder / "drawn" / name).rig.names for name in "ab"]
    assert {len(names) for names in first} <= {2, 3}
    dmae(folder, "capture", "data=set", "draw=[2,3]", "out=again")
    assert [load_clip(folder / "again" / name).rig.names for name in "ab"] == first
    done = dmae(
        folder,
        "train",
        "data=set",
        "extra_data=[drawn]",
        "validation_data=[again]",
        "learning.steps=1",
        "learning.epoch=1",
        "learning.batch=2",
        "out=learned",
    )
    assert done.returncode == 0, done.stderr
    # The losses, and no line for each clip or batch.
    assert "step 1: loss" in done.stderr and len((done.stdout + done.stderr).splitlines()) <= 10
    learned = json.loads((folder / "learned/model.json").read_text())
    assert learned["clips"] == 4 and learned["validation_clips"] == ["validation a", "validation b"]
    done = dmae(folder, "capture", "data=set", "draw=[9]", "out=undrawn")
    assert done.returncode == 1 and "draw=[9]: expected numbers from 2 to" in done.stderr


def test_a_clip_is_captured_exported_scored_and_reported(folder):
    done = dmae(folder, "capture", "data=one", "out=out")
    assert done.returncode == 0, done.stderr
    assert "frames/s" in done.stdout.splitlines()[-1]
    captured = load_clip(folder / "out")
    assert captured.poses.xyz.shape[:2] == (20, 2)
    assert "dmae-synth" in (folder / "out/config.yaml").read_text()

    done = dmae(folder, "export", "clip=out", "format=npz", "skeleton=shelf14", "out=out/pred.npz")
    assert done.returncode == 0, done.stderr
    poses, fps = read_npz(folder / "out/pred.npz")
    assert poses.xyz.shape == (20, 2, 14, 3)
    assert fps == 25

    done = dmae(folder, "evaluate", "data=out", "methods=[measured,linear]", "views=[3]", "out=scores")
    assert done.returncode == 0, done.stderr
    results = json.loads((folder / "scores/scores.json").read_text())["results"]
    assert [(result["method"], result["views"], len(result["runs"])) for result in results] == [
        ("measured", 3, 4),
        ("linear", 3, 4),
    ]

    done = dmae(folder, "report", "clip=out", "scores=[scores]", "out=page/report.html")
    assert done.returncode == 0, done.stderr
    assert "Strict PCP" in (folder / "page/report.html").read_text()
    done = dmae(folder, "report", "clip=one")
    assert done.returncode == 0, done.stderr
    assert "It is not captured yet: run dmae capture." in (folder / "one/report.html").read_text()
    done = dmae(folder, "report", "scores=[scores]")
    assert done.stdout.strip() == "scores/report.html" and (folder / "scores/report.html").is_file()


def test_a_data_set_is_captured_clip_by_clip_with_the_cameras_asked_for(folder):
    done = dmae(folder, "capture", "data=set", "data.cameras=[cam0,cam2]", "fill=linear", "out=both")
    assert done.returncode == 0, done.stderr
    assert [load_clip(folder / "both" / name).rig.names for name in "ab"] == [("cam0", "cam2")] * 2
    assert "a: data.cameras: 2 of 4 cameras: cam0, cam2\n" in done.stdout


def test_a_sweep_gives_every_job_a_folder(folder):
    done = dmae(folder, "capture", "-m", "data=one", "capture.th_v=2,3", "out=sweep")
    assert done.returncode == 0, done.stderr
    views = [load_clip(folder / "sweep" / job).poses.views for job in "01"]
    assert views[1][views[1] > 0].min() == 3
    assert not np.array_equal(*views)
    assert "th_v: 3" in (folder / "sweep/1/config.yaml").read_text()
    assert [line for line in done.stdout.splitlines() if "=" in line and "data" not in line] == [
        "capture.th_v=2",
        "capture.th_v=3",
    ]


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("openpose", ["data.path=openpose", "data.fps=25"]),
        ("pose2sim", ["data.path=pose2sim/trial"]),
        ("easymocap", ["data.path=easymocap", "data.fps=25"]),
        ("panoptic", ["data.path=panoptic"]),
    ],
)
def test_recordings_of_other_programs_are_captured(folder, name, options):
    done = dmae(folder, "capture", f"data={name}", *options, f"out=from_{name}")
    assert done.returncode == 0, done.stderr
    clip = load_clip(folder / f"from_{name}")
    assert clip.fps == 25
    assert clip.poses.xyz.shape[:2] == (20, 2)
    assert (clip.poses.source == Source.MEASURED).mean() > 0.9


def test_a_recording_is_converted_and_captured_and_exported(folder):
    done = dmae(folder, "convert", "data=openpose", "data.path=openpose", "data.fps=25", "format=coco", "out=coco")
    assert done.returncode == 0, done.stderr
    assert "20 frames at 25 frames/s, 4 cameras, body25" in done.stdout
    done = dmae(folder, "capture", "data=coco", "data.path=coco", "out=from_coco")
    assert done.returncode == 0, done.stderr
    done = dmae(folder, "export", "clip=from_coco", "format=trc", "unit=mm", "out=trc/walk.trc")
    assert done.returncode == 0, done.stderr
    poses, fps = read_trc(folder / "trc/walk_P2.trc")
    assert fps == 25
    np.testing.assert_allclose(poses.xyz[:, 0], load_clip(folder / "from_coco").poses.xyz[:, 1], atol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["capture", "data=clip", "data.path=nowhere", "out=bad"], "nowhere"),
        (["capture", "data=one", "capture.th_v=1", "out=bad"], "th_v=1"),
        (["capture", "data=one", "data.cameras=[0,9]", "out=bad"], "data.cameras=[0,9]: expected names of cameras"),
        (["capture", "data=shelf", "data.path=one", "out=bad"], "one/calibration.json"),
        (["export", "clip=one", "skeleton=lizard", "out=bad/x.npz"], "no skeleton 'lizard'; there are"),
        (["export", "clip=one"], "out=..."),
        (["capture", "data=openpose", "data.path=openpose", "out=bad"], "data.fps=..."),
        (["capture", "data=panoptic", "data.path=openpose/cam0", "out=bad"], "data.detections=..."),
        (["run", "videos=nosuch", "out=bad"], "videos=nosuch: no such file"),
        (["run", "videos=one", "out=bad"], "expected calibration=<file>"),
        (["capture", "data=pose2sim", "data.path=pose2sim", "out=bad"], "there are trials trial"),
        (["convert", "data=one", "data.fps=25", "out=bad"], "leave out data.fps"),
    ],
)
def test_bad_input_is_one_clear_error_and_leaves_nothing_behind(folder, arguments, said):
    done = dmae(folder, *arguments)
    assert done.returncode == 1
    assert said in done.stderr
    assert not (folder / "bad").exists()


def test_reprojection_errors_are_printed_after_every_capture(folder):
    done = dmae(folder, "capture", "data=one", "out=tables")
    assert done.returncode == 0, done.stderr
    for table in ("By camera", "By person", "tables: largest: "):
        assert table in done.stdout
    assert len(done.stdout.splitlines()) < 30
    (row,) = [line.split() for line in done.stdout.splitlines() if line.strip().startswith("P1")]
    assert float(row[2]) < 10
    # People of different clips are different people.
    assert "By person" not in dmae(folder, "capture", "data=set", "out=tables_of_set").stdout


def test_a_clip_that_is_replaced_is_named(folder):
    said = "replaced: the clip that was there is replaced"
    assert said not in dmae(folder, "capture", "data=one", "out=replaced").stdout
    assert said in dmae(folder, "capture", "data=one", "out=replaced").stdout


def test_a_capture_of_no_person_says_why_and_its_exit_status_tells(folder):
    clip = load_clip(folder / "one")
    poses = clip.rig.cam_from_world.copy()
    poses[:, :3, 3] *= 1000
    save_clip(replace(clip, rig=replace(clip.rig, cam_from_world=poses), poses=None), folder / "millimetres")
    done = dmae(folder, "capture", "data=millimetres", "out=no_person")
    assert done.returncode == 1
    assert "no person was captured; of the recording there are" in done.stdout
    assert "suggestion: lengths of the calibration are in mm: data.unit=mm" in done.stdout
    assert load_clip(folder / "no_person").poses.xyz.shape[1] == 0
    assert dmae(folder, "report", "clip=no_person").returncode == 0


def test_a_method_that_finds_no_one_is_not_explained_by_the_steps_of_another(folder):
    (folder / "nobody.py").write_text(
        "import numpy as np\nimport dmae\n\ndef nobody(clip, config):\n    skeleton = clip.detections.skeleton\n"
        "    return dmae.Poses3D(skeleton, np.empty((len(clip), 0, len(skeleton), 3)))\n"
    )
    done = dmae(folder, "capture", "data=one", "capture.method=nobody:nobody", "out=found_nobody")
    assert done.returncode == 1
    said = "captured by capture.method=nobody:nobody; here are the steps of capture.method=adaptive; of the recording"
    assert said in done.stdout


def test_garbage_is_looked_for_while_a_command_runs_but_not_while_it_is_loaded(folder, monkeypatch):
    collects = []

    def run(config, out):
        collects.append(gc.isenabled())
        out.mkdir()

    monkeypatch.setattr(
        Command, "module", property(lambda _: collects.append(gc.isenabled()) or SimpleNamespace(run=run))
    )
    assert dmae(folder, "capture", "data=one", "out=collects").returncode == 0
    assert collects == [False, True]


def test_a_command_is_composed_once_and_nothing_of_it_is_left_for_the_next_to_copy(folder, monkeypatch):
    before, composed, compose = {*ConfigStore.instance().repo}, [], Hydra.compose_config
    monkeypatch.setattr(Hydra, "compose_config", lambda *given, **how: composed.append(1) or compose(*given, **how))
    assert dmae(folder, "complete", "clip=nowhere").returncode == 1
    assert (len(composed), {*ConfigStore.instance().repo}) == (1, before)
