"""Joined results of the parts of a data set equal the results of the whole, byte for byte."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from dmae.data.images import Images
from dmae.data.store import load_clip, save_clip, write_manifest
from dmae.files.checksums import find_damage, find_data_set_damage
from dmae.parts import PART, Part, numbers_of, read_parts, write_part
from tests.support.commands import dmae
from tests.support.stressed_clips import strollers

NAMES = ("a", "b", "c")


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    """Return a folder with `data`, a data set of three clips that refer to images beside it."""
    folder = tmp_path_factory.mktemp("parts")
    (folder / "images").mkdir()
    for number, name in enumerate(NAMES):
        clip = strollers(frames=20 + 2 * number, persons=2, views=3, name=name)
        clip = replace(clip, images=Images(folder / "images", clip.rig.names, tuple(range(len(clip))), ("depth",)))
        save_clip(clip, folder / "data" / name)
    write_manifest(folder / "data", [{"id": name, "status": "ok"} for name in NAMES])
    return folder


def made(data: Path, command: str, *options: str, out: str) -> Path:
    done = dmae(data, command, "data=data", *options, f"out={out}")
    assert done.returncode == 0, done.stderr
    return data / out


def contents(path: Path) -> dict[str, bytes]:
    files = (file for file in path.rglob("*") if file.is_file() and file.name not in (PART, "config.yaml"))
    return {file.relative_to(path).as_posix(): file.read_bytes() for file in files}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "options", "compared"),
    [
        ("capture", ["draw=[2,3]", "seed=4"], lambda name: True),
        ("evaluate", ["methods=[measured,linear]", "input=perturbed_poses", "smooth=0"], lambda name: True),
        ("evaluate", ["methods=[linear]", "views=[2]"], lambda name: True),
        ("stress", ["methods=[linear]", "axes=[cameras]", "pairs=[]"], lambda name: name == "stress.json"),
    ],
)
def test_joined_parts_are_the_whole(data, command, options, compared):
    key = f"{command}_{len(options)}"
    whole = contents(made(data, command, *options, out=f"{key}/whole"))
    made(data, command, *options, "shard=1/2", out=f"{key}/1")
    made(data, command, *options, "first=1", "clips=2", out=f"{key}/2")
    done = dmae(data, "merge", f"data=['{key}/2','{key}/1']", f"out={key}/joined")
    assert done.returncode == 0, done.stderr
    joined = contents(data / key / "joined")
    names = [name for name in whole if compared(name)]
    assert names
    assert {name: joined[name] for name in names} == {name: whole[name] for name in names}


def test_images_of_joined_clips_are_found(data):
    for number in (1, 2, 3):
        made(data, "capture", f"shard={number}/3", out=f"shards/of/capture/{number}")
    shards = ",".join(f"shards/of/capture/{number}" for number in (1, 2, 3))
    assert dmae(data, "merge", f"data=[{shards}]", "out=all").returncode == 0
    assert load_clip(data / "all/b").images.folder.resolve() == (data / "images").resolve()
    assert not find_data_set_damage(data / "all", NAMES)
    assert not find_damage(data / "all/b")
    # The parts keep theirs.
    assert load_clip(data / "shards/of/capture/2/b").images.folder.resolve() == (data / "images").resolve()


def test_a_damaged_part_is_refused(data):
    made(data, "capture", "shard=1/3", out="damaged")
    path = data / "damaged/a/clip.json"
    path.write_text(path.read_text() + " ")
    done = dmae(data, "merge", "data=[damaged]", "partial=true", "out=of_damaged")
    assert (done.returncode, "clip.json" in done.stderr) == (1, True)
    assert not (data / "of_damaged").exists()


def part(first: int, stop: int, **changes) -> Part:
    facts = {
        "command": "dmae capture",
        "options": {"data": {"path": str(first)}, "fill": "none"},
        "data": "set",
        "of": 6,
    }
    return Part(**facts | {"first": first, "stop": stop} | changes)


@pytest.mark.parametrize(
    ("second", "message"),
    [
        (part(2, 6, command="dmae stress"), "found command 'dmae stress', not 'dmae capture'"),
        (part(2, 6, options={"data": {}, "fill": "linear"}), "options differ in fill"),
        (part(2, 6, data="other"), "found data 'other', not 'set'"),
        (part(2, 6, of=7), "found of 7, not 6"),
        (part(1, 6), "clip number 1 is in"),
        (part(3, 5), "clips number 2 to 2, 5 to 5 are in none of"),
    ],
)
def test_parts_that_do_not_belong_together_are_refused(second, message, tmp_path):
    write_part(tmp_path / "1", part(0, 2))
    write_part(tmp_path / "2", second)
    with pytest.raises(ValueError, match=message):
        read_parts([tmp_path / "2", tmp_path / "1"])


def test_parts_may_lack_clips_when_that_is_said(tmp_path):
    write_part(tmp_path / "2", part(3, 5))
    write_part(tmp_path / "1", part(0, 2))
    found = read_parts([tmp_path / "2", tmp_path / "1"], partial=True)
    assert [each.first for _, each in found] == [0, 3]
    write_part(tmp_path / "1", None)
    with pytest.raises(FileNotFoundError, match=r"1: expected part\.json"):
        read_parts([tmp_path / "2", tmp_path / "1"], partial=True)


@pytest.mark.parametrize("text", ["[]", "{}", json.dumps({"first": 2}), '{"first": -1, "stop": 9}'])
def test_a_part_that_is_none_is_refused_by_name(text, tmp_path):
    (tmp_path / PART).write_text(text)
    with pytest.raises(ValueError, match=r"part\.json"):
        read_parts([tmp_path])


@pytest.mark.parametrize(
    ("options", "message"),
    [((6, None, None), "first=6"), ((2, 5, None), "clips=5"), ((0, 2, "1/3"), "at most as")],
)
def test_clips_that_are_not_there_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        numbers_of(6, *options)
    assert numbers_of(6, 1, None, None) == range(1, 6)
    assert numbers_of(6, 0, 4, "2/2") == range(2, 4)
