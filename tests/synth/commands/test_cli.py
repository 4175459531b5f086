"""The command as users type it."""

import pytest

from dmae.data.store import clip_folders, load_clip, read_manifest
from tests.support.commands import dmae, synth


def test_generate_makes_a_data_set_of_clips(tmp_path):
    done = synth(tmp_path, "generate", "out=set", "seed=7", "clips=2", "scene.seconds=0.4", "scene.persons=[2,2]")
    assert done.returncode == 0, done.stderr
    assert "2 clips, 0 failed" in done.stdout
    assert [line["status"] for line in read_manifest(tmp_path / "set")] == ["ok", "ok"]
    clips = [load_clip(folder) for folder in clip_folders(tmp_path / "set")]
    assert [clip.rig.names for clip in clips] == [("0", "1", "2", "3", "4")] * 2
    assert all(clip.truth.xyz.shape == (10, 2, 39, 3) for clip in clips)
    assert "seed: 7" in (tmp_path / "set/config.yaml").read_text()


def test_verify_and_show_what_was_generated(tmp_path):
    small = ("clips=1", "scene.seconds=0.2", "scene.persons=[1,1]")
    assert synth(tmp_path, "generate", "out=set", *small).returncode == 0
    done = synth(tmp_path, "verify", "data=set", "out=found.json")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "found.json").is_file()
    assert synth(tmp_path, "verify", "data=set").returncode == 0
    assert (tmp_path / "set/verify.json").is_file()
    done = synth(tmp_path, "show", "data=set/000000", "out=shown", "width=200", "video=true")
    assert done.returncode == 0, done.stderr
    assert "not drawn" not in done.stdout
    assert {"sheet.png", "clip.mp4"} <= {path.name for path in (tmp_path / "shown").iterdir()}
    (tmp_path / "set/000000/arrays.safetensors").write_bytes(b"")
    done = synth(tmp_path, "verify", "data=set", "out=found.json")
    assert done.returncode == 1
    assert "1 problem in 1 of 1 clip" in done.stderr
    assert "000000: checksums: " in done.stdout


def test_a_data_set_is_not_continued_under_another_configuration(tmp_path):
    small = ("generate", "out=set", "clips=1", "scene.seconds=0.2", "scene.persons=[1,1]")
    assert synth(tmp_path, *small).returncode == 0
    done = synth(tmp_path, *small, "seed=8")
    assert done.returncode == 1
    assert "differs in seed" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["generate", "motion=bvh", "motion.path=nowhere"], "nowhere"),
        (["generate", "motion=bvh"], "motion.path"),
        (["generate", "scene.persons=[3,1]"], "scene.persons"),
        (["generate", "scene.arena=moon"], "moon"),
        (["generate", "detector.swap=2"], "swap"),
        (["generate", "clips=0"], "clips"),
    ],
)
def test_bad_input_is_one_clear_error_and_leaves_nothing_behind(tmp_path, arguments, said):
    done = synth(tmp_path, *arguments, "out=bad")
    assert done.returncode == 1
    assert said in done.stderr
    assert not (tmp_path / "bad").exists()


def test_presets_of_another_program_are_no_choices_of_this_one(tmp_path):
    """`data=` is a preset of `dmae capture` and the path of a data set here, in whatever order both run."""
    for _ in range(2):
        assert "none" in dmae(tmp_path, "capture", "data=shelf", "data.path=none", "out=captured").stderr
        assert "data=none: no such file" in synth(tmp_path, "stats", "data=none", "out=card").stderr
