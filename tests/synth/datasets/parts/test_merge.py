"""Parts of a data set: joined they are, byte for byte, the data set that is made at once."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from dmae.data.store import read_manifest
from dmae.files.checksums import number_of
from dmae.parts import SHARD, clip_numbers
from synth.datasets.clip import GenerateConfig
from synth.datasets.generate import generate
from synth.datasets.parts import merge as module
from synth.datasets.parts.merge import merge
from synth.datasets.verify import verify
from synth.rendering.renderer import ImageQuality
from synth.rigs.placement import RingConfig
from synth.rigs.rig import RigConfig
from synth.scene.spec import SceneConfig
from tests.support.commands import synth
from tests.support.damages import files_of

pytestmark = [pytest.mark.filterwarnings("ignore:no OpenGL"), pytest.mark.slow]
CONFIG = GenerateConfig(
    seed=3,
    clips=5,
    images=["rgb"],
    quality=ImageQuality.draft,
    scene=SceneConfig(persons=[1, 1], seconds=0.08),
    rig=RigConfig(ring=RingConfig(views=1, focal=90, size=[96, 72])),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Return a folder of a data set of five clips, `whole`, its two shards, and ranges of it."""
    folder = tmp_path_factory.mktemp("parts")
    for name, options in {
        "whole": {},
        "shard1": {"shard": "1/2"},
        "shard2": {"shard": "2/2"},
        "range": {"first": 2, "clips": 3},
        "seed4": {"seed": 4, "clips": 2},
    }.items():
        generate(replace(CONFIG, out=str(folder / name), **options))
    return folder


def contents(path: Path) -> dict[str, bytes]:
    return {file.relative_to(path).as_posix(): file.read_bytes() for file in files_of(path)}


@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_shards_hold_every_clip_once(count):
    shards = [clip_numbers(200, 7, f"{number}/{count}") for number in range(1, count + 1)]
    assert [number for shard in shards for number in shard] == list(range(200, 207))
    assert max(map(len, shards)) - min(map(len, shards)) <= 1


@pytest.mark.parametrize("shard", ["0/3", "4/3", "1/8", "half", "1/0", "-1/2", "1/2/3"])
def test_impossible_shards_are_refused(shard):
    with pytest.raises(ValueError, match="shard"):
        GenerateConfig(clips=7, shard=shard)


def test_joined_parts_are_byte_for_byte_the_whole(folder, tmp_path):
    whole = contents(folder / "whole")
    assert [line["id"] for line in read_manifest(folder / "range")] == ["000002", "000003", "000004"]
    for number, parts in enumerate((["shard2", "shard1"], ["shard1", "range"])):
        lines = merge([folder / part for part in parts], tmp_path / str(number))
        assert contents(tmp_path / str(number)) == whole
        assert [line["id"] for line in lines] == [f"{index:06d}" for index in range(5)]
    assert number_of(tmp_path / "0") == number_of(folder / "whole")
    assert verify(tmp_path / "0").problems == verify(folder / "shard1").problems == []


def test_files_are_copied_where_there_are_no_links(folder, tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError("another file system")

    monkeypatch.setattr(module.os, "link", refuse)
    merge([folder / "shard1", folder / "shard2"], tmp_path / "copied")
    assert contents(tmp_path / "copied") == contents(folder / "whole")


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        (["shard1"], "clips 000002, 000003, 000004 are in none of"),
        (["shard2"], "clips 000000, 000001 are in none of"),
        (["range"], "clips 000000, 000001 are in none of"),
        (["shard2", "range"], "clip 000002 is in"),
        (["shard1", "seed4"], "config.json differs in seed"),
        (["shard1", "nothing"], "nothing: expected a data set"),
        ([], "expected the folders of the parts"),
    ],
)
def test_parts_that_do_not_fit_are_refused(folder, tmp_path, parts, said):
    with pytest.raises((ValueError, FileNotFoundError), match=said):
        merge([folder / part for part in parts], tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_missing_clips_are_left_out_when_asked_for(folder, tmp_path):
    merge([folder / "shard2"], tmp_path / "some", partial=True)
    assert sorted(path.name for path in (tmp_path / "some").glob("0*")) == ["000002", "000003", "000004"]
    assert verify(tmp_path / "some").problems == []


def test_a_damaged_part_is_refused(folder, tmp_path):
    shutil.copytree(folder / "shard1", tmp_path / "part")
    next((tmp_path / "part/000001").rglob("*.mp4")).unlink()
    with pytest.raises(ValueError, match=r"part: 1 files are not as they were written: 000001: .*mp4: missing"):
        merge([tmp_path / "part", folder / "shard2"], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_an_interrupted_merge_leaves_nothing(folder, tmp_path, monkeypatch):
    link, left = os.link, [9]

    def interrupt(source, target):
        left[0] -= 1
        if not left[0]:
            raise KeyboardInterrupt
        link(source, target)

    monkeypatch.setattr(module.os, "link", interrupt)
    with pytest.raises(KeyboardInterrupt):
        merge([folder / "shard1", folder / "shard2"], tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_a_shard_has_a_folder_of_its_own(folder, tmp_path):
    shutil.copytree(folder / "shard1", tmp_path / "shard")
    shutil.copytree(folder / "whole", tmp_path / "whole")
    for name, shard, said in (
        ("shard", "2/2", "differs in shard"),
        ("shard", None, "the folder holds a shard"),
        ("whole", "1/2", "clips of no shard"),
    ):
        with pytest.raises(ValueError, match=said):
            generate(replace(CONFIG, out=str(tmp_path / name), shard=shard))
    assert not (tmp_path / "whole" / SHARD).exists()


def test_the_commands_make_and_join_shards(tmp_path):
    small = ("clips=2", "scene.seconds=0.08", "scene.persons=[1,1]", "seed=7")
    for name, more in (("a", "shard=1/2"), ("b", "shard=2/2"), ("whole", "first=0")):
        assert synth(tmp_path, "generate", f"out={name}", *small, more).returncode == 0
    done = synth(tmp_path, "merge", "data=[b,a]", "out=joined")
    assert done.returncode == 0, done.stderr
    assert "joined: 2 clips, 0 failed" in done.stdout
    assert number_of(tmp_path / "joined") == number_of(tmp_path / "whole")
    done = synth(tmp_path, "verify", "data=joined")
    assert done.returncode == 0, done.stdout
    assert f"sha256 of all: {number_of(tmp_path / 'joined')}" in done.stdout
    assert synth(tmp_path, "verify", "data=joined", "fast=true").returncode == 0
    assert synth(tmp_path, "merge", "data=[a,b]", "out=joined").returncode == 1
    record = tmp_path / "joined/config.yaml"
    record.write_text(record.read_text().replace("partial: false", "partial: true"))
    done = synth(tmp_path, "verify", "data=joined", "fast=true")
    assert done.returncode == 1
    assert "config.yaml: its content was changed" in done.stdout
