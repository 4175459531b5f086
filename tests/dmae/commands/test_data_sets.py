"""Counts of poses that are printed agree with the exported poses."""

import re
from dataclasses import replace

import numpy as np
import pytest

from dmae.commands.data_sets import Manifest, describe_joints, finished
from dmae.data.clip import Poses3D, Source
from dmae.data.skeleton import BODY25
from dmae.data.store import clip_folders, read_manifest, save_clip
from tests.support.clips import full_clip, walkers
from tests.support.commands import run_command


def with_absences() -> Poses3D:
    """Two people in 12 frames: the second is there in 9; of the first some joints are completed, some absent."""
    poses = walkers()
    xyz, source = poses.xyz.copy(), poses.source.copy()
    xyz[:3, 1], source[:3, 1] = np.nan, Source.ABSENT
    xyz[5, 0, :5], source[5, 0, :5] = np.nan, Source.ABSENT
    source[6, 0, :10] = Source.COMPLETED
    return Poses3D(BODY25, xyz, source)


def test_absent_joints_and_absent_people_are_counted_separately():
    said = describe_joints(with_absences())
    joints = 21 * 25
    assert said == (
        f"joints {1 - 15 / joints:.1%} measured, {10 / joints:.1%} completed, {5 / joints:.1%} absent; not counting 3 "
        f"of 24 person-frames (12.5%) in which the person is not present: with them {(3 * 25 + 5) / 600:.1%} of all "
        "joints are NaN"
    )
    assert "person-frames" not in describe_joints(walkers())
    assert describe_joints(walkers().without(np.ones((12, 2, 25), bool))) == "no person captured"


def test_the_printed_share_is_that_of_nan_in_the_export(tmp_path):
    save_clip(replace(full_clip(), poses=with_absences()), tmp_path / "clip")
    done = run_command(tmp_path, "dmae", "complete", "clip=clip", "out=full")
    assert done.returncode == 0, done.stderr
    assert run_command(tmp_path, "dmae", "export", "clip=full", "out=full.npz").returncode == 0
    with np.load(tmp_path / "full.npz") as archive:
        share = np.isnan(archive["joints"]).any(-1).mean()
    assert float(re.search(r"with them ([\d.]+)% of all joints", done.stdout)[1]) == pytest.approx(
        100 * share, abs=0.06
    )


def test_a_manifest_is_written_even_after_an_error(tmp_path):
    with pytest.raises(KeyboardInterrupt), Manifest(tmp_path, True) as manifest:
        save_clip(full_clip(), tmp_path / "a")
        manifest.write("a", lambda: None, persons=2)
        raise KeyboardInterrupt
    assert read_manifest(tmp_path) == [{"id": "a", "status": "ok", "persons": 2}]
    assert finished(tmp_path) == f"{tmp_path}: 1 whole clip, which can be used"
    with Manifest(tmp_path / "none", True):
        pass
    assert not (tmp_path / "none").exists()
    assert finished(tmp_path / "none") == "nothing was written"


def test_a_killed_overwrite_is_no_data_set(tmp_path):
    """Clips of two runs must not pass for a data set of one."""
    with Manifest(tmp_path, several=True) as manifest:
        for name in "ab":
            manifest.write(name, lambda name=name: save_clip(full_clip(frames=2), tmp_path / name))
    (tmp_path / "config.yaml").touch()
    assert len(clip_folders(tmp_path)) == 2
    second = Manifest(tmp_path, several=True)
    second.write("a", lambda: save_clip(full_clip(frames=3), tmp_path / "a"))
    assert not (tmp_path / "config.yaml").exists()
    with pytest.raises(FileNotFoundError, match="expected a clip"):
        clip_folders(tmp_path)
    second.__exit__()
    assert [folder.name for folder in clip_folders(tmp_path)] == ["a"]
