"""Fault injection: every flipped bit and every structural damage is found, and the same command repairs it."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dmae.data.store import read_manifest
from dmae.files.checksums import refuse_damaged
from synth.datasets.exporters.export import export
from synth.datasets.generate import generate
from synth.datasets.verify import verify
from tests.endurance.damages import damage_often, data_set, flip_often
from tests.support.commands import dmae
from tests.support.damages import OWN, contents, kinds, structural

pytestmark = [pytest.mark.filterwarnings("ignore:no OpenGL"), pytest.mark.slow]


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Path:
    """Return a data set of three clips in three frames of two cameras, with all images."""
    out = tmp_path_factory.mktemp("sound") / "data"
    generate(data_set(out))
    return out


@pytest.fixture
def data(sound, tmp_path) -> Path:
    return Path(shutil.copytree(sound, tmp_path / "data"))


def test_every_flipped_bit_is_found(data, sound):
    """One in each kind of file."""
    assert flip_often(len(kinds(sound)), data, sound, seed=5) == []


def test_every_structural_damage_is_found(data, sound):
    assert damage_often(len(list(structural(data, np.random.default_rng(6)))), data, sound, seed=6) == []


def test_the_same_command_repairs_damages(data, sound):
    """Missing files, other sizes and changed labels are seen at once, images of the same size with `recheck`."""
    before, rng = contents(sound), np.random.default_rng(7)
    done = dict(structural(data, rng))
    for name in ("an image is missing", "clips exchanged", "a cut image", "checksums of a clip are missing"):
        dict(structural(data, rng))[name]()
        assert verify(data, fast=True).problems, name
        generate(data_set(data))
        assert contents(data) == before, name
    text = (data / "000001/clip.json").read_text()
    (data / "000001/clip.json").write_text(text.replace('"fps": 25.0', '"fps": 50.0'))
    generate(data_set(data))
    assert contents(data) == before
    assert done.keys() >= {"images exchanged"}
    video = data / "000000/images/rgb/ring0.mp4"
    changed = bytearray(video.read_bytes())
    changed[-1] ^= 1
    video.write_bytes(changed)
    generate(data_set(data))
    assert video.read_bytes() == changed
    generate(data_set(data, recheck=True))
    assert contents(data) == before


def test_what_does_not_verify_is_refused(data):
    refuse_damaged(data, "x=true")
    refuse_damaged(data / "000001", "x=true")
    (data / "000001/images/rgb/ring0.mp4").unlink()
    for path in (data, data / "000001"):
        with pytest.raises(ValueError, match=r"1 file is not as it was written: .*ring0.mp4: missing.*by x=true"):
            refuse_damaged(path, "x=true")


def test_training_and_export_refuse_damaged_data_unless_told_otherwise(data, sound, tmp_path):
    (data / "000001/notes.txt").write_text("?")
    for arguments in (("train", f"data={data}"), ("train", f"data={sound}", f"extra_data=[{data}]")):
        done = dmae(tmp_path, *arguments, "out=model")
        assert done.returncode == 1
        assert "notes.txt: a file that does not belong" in done.stderr
        assert "damaged=true" in done.stderr
    with pytest.raises(ValueError, match="damaged=true"):
        export(data, tmp_path / "out", "panoptic")
    assert not (tmp_path / "out").exists()
    export(data, tmp_path / "out", "panoptic", damaged=True)
    assert (tmp_path / "out").is_dir()


def test_damaged_files_of_the_data_set_are_replaced(data, sound):
    for name in ("config.json", "manifest.jsonl", "checksums.json"):
        (data / name).write_text("{")
        problems = verify(data).problems
        assert {problem.clip for problem in problems} == OWN
        assert all(name in problem.what for problem in problems if problem.check == "checksums")
        if name == "config.json":
            shutil.copy(sound / name, data)
        else:
            (data / name).unlink()
        generate(data_set(data))
        assert contents(data) == contents(sound)


def test_nothing_that_is_no_file_hangs(data):
    image = next((data / "000001/images").rglob("*.png"))
    image.unlink()
    os.mkfifo(image)
    (data / "000000/clip.json").unlink()
    (data / "000000/clip.json").symlink_to("nowhere")
    assert set(verify(data).again) == set(verify(data, fast=True).again) == {"000000", "000001"}


def test_continued_data_sets_are_as_made_at_once(sound, tmp_path):
    parts = tmp_path / "data"
    generate(replace(data_set(parts), clips=1))
    generate(replace(data_set(parts), first=2, clips=1))
    assert [line["id"] for line in read_manifest(parts)] == ["000000", "000002"]
    assert verify(parts).problems == []
    generate(data_set(parts))
    assert contents(parts) == contents(sound)
