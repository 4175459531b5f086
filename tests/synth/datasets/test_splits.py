"""Splits share nothing, planted leaks are found, and what a person, a motion and a rig is."""

import json
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dmae.data.store import clip_folders, load_clip, save_clip, write_manifest
from synth.datasets import splits as module
from synth.datasets.config import SplitBy
from synth.datasets.splits import find_leaks, identities, split, write_splits
from tests.support.commands import synth
from tests.support.data_sets import image_set

PEOPLE = [{"a", "b"}, {"b", "c"}, {"d", "e"}, {"f", "g"}, {"h", "i"}, {"j", "k"}]
"""Of the clips of `image_set`: the first two have to stay together."""


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    return image_set(tmp_path_factory.mktemp("data") / "set", clips=6)


def scene(folder: Path, **changes) -> Path:
    """A clip in a folder, without images, with another scene."""
    clip = load_clip(folder)
    made = replace(clip, images=None, provenance={"spec": clip.provenance["spec"] | changes})
    save_clip(made, folder.parent / "changed")
    return folder.parent / "changed"


def test_a_person_is_a_body_a_motion_a_take_and_a_rig_its_cameras(data, tmp_path):
    first, second, third = clip_folders(data)[:3]
    assert len(identities(first, SplitBy.person) & identities(second, SplitBy.person)) == 1
    assert not identities(first, SplitBy.person) & identities(third, SplitBy.person)
    assert identities(first, SplitBy.motion) == {"00_00", "00_01"}
    assert identities(first, SplitBy.rig) == identities(third, SplitBy.rig)


def test_a_rig_is_the_true_one_and_has_no_names(data, tmp_path):
    clip = replace(load_clip(data / "000000"), images=None)
    rigs = {
        "same": replace(clip, rig=replace(clip.rig, names=("a", "b"))),
        "wrong": replace(clip, true_rig=clip.rig, rig=replace(clip.rig, K=1.1 * clip.rig.K - 0.1 * np.diag([0, 0, 1]))),
        "other": replace(clip, rig=clip.rig[::-1]),
    }
    for name, made in rigs.items():
        save_clip(made, tmp_path / name)
    own = identities(data / "000000", SplitBy.rig)
    assert [identities(tmp_path / name, SplitBy.rig) == own for name in rigs] == [True, True, False]


@pytest.mark.parametrize(
    ("name", "kind", "identity"),
    [
        ("005_01 (cmu, bvh, 120 fps) 3.25-5.25 s", "bvh", "005_01"),
        ("005_01 (cmu, bvh, 120 fps) 3.25-5.25 s, over steps", "bvh", "005_01"),
        ("walk (2) (mapped, m, 60 fps), 3 frames bridged 3.25-5.25 s", "bvh", "walk (2)"),
        ("walk.anna (SOMA, cm, 120 fps) 3.25-5.25 s", "bvh", "walk.anna"),
        ("take two to and fro from 0.10 s", "npz", "take two"),
        ("walk at 1.2 m/s, straight", "procedural", "drawn for P1 by 3/0"),
        ("stand", "bvh", "drawn for P1 by 3/0"),
    ],
)
def test_the_motion_of_a_name(data, name, kind, identity):
    changed = scene(data / "000000", motion={"kind": kind}, persons=[{"body": {}, "motion": name}])
    assert identities(changed, SplitBy.motion) == {identity}
    assert identities(changed, SplitBy.subject) == {"5" if identity == "005_01" else identity}


@pytest.mark.parametrize("seed", range(4))
def test_no_person_is_in_two_splits(data, seed):
    made = split(data, train=0.5, validation=0.25, test=0.25, seed=seed)
    assert sorted(chain(*made.values())) == [folder.name for folder in clip_folders(data)]
    assert find_leaks(data, made, [SplitBy.person]) == []
    people = [set().union(*(PEOPLE[int(name)] for name in names)) for names in made.values()]
    assert not people[0] & people[1] and not people[0] & people[2] and not people[1] & people[2]
    assert split(data, train=0.5, validation=0.25, test=0.25, seed=seed) == made


def test_leaks_are_listed_in_the_same_order_in_every_run(monkeypatch):
    """The order of a set of texts changes with the process."""
    everyone = {f"person {number}" for number in range(100, 120)}
    people = {"first": everyone} | {name.removeprefix("person "): {name} for name in everyone}
    monkeypatch.setattr(module, "identities", lambda folder, by: people[folder.name])
    found = find_leaks(Path("data"), {"train": ["first"], "test": sorted(people)[:-1]}, [SplitBy.person])
    assert [leak.clips["test"] for leak in found] == [[str(number)] for number in range(100, 120)]


@given(st.lists(st.sets(st.integers(0, 12), min_size=1, max_size=3), min_size=1, max_size=14))
def test_groups_share_nothing_and_are_as_small_as_can_be(things):
    found = {f"{number:02}": {str(thing) for thing in each} for number, each in enumerate(things)}
    groups = module._groups(found)
    assert sorted(chain(*groups)) == sorted(found)
    shared = [set().union(*(found[name] for name in group)) for group in groups]
    assert all(not one & other for i, one in enumerate(shared) for other in shared[:i])
    for group in groups:
        reached = {group[0]}
        while more := {n for n in group if n not in reached and any(found[n] & found[o] for o in reached)}:
            reached |= more
        assert reached == set(group)


@pytest.mark.parametrize("by", [SplitBy.person, SplitBy.motion])
def test_a_planted_leak_is_found(data, tmp_path, by):
    """The clip of the second split gets one person, or one take, of the first."""
    for name in ("000002", "000003"):
        save_clip(replace(load_clip(data / name), images=None), tmp_path / name)
    write_manifest(tmp_path, [{"id": name, "status": "ok"} for name in ("000002", "000003")])
    write_splits(tmp_path / "splits.json", {"train": ["000002"], "test": ["000003"]}, by, 0)
    clean = synth(tmp_path, "split", "data=.", f"by={by.name}", "check=splits.json")
    assert clean.returncode == 0, clean.stderr
    assert f"splits.json: no {by.name} is in two splits" in clean.stdout
    clip, other = load_clip(tmp_path / "000003"), load_clip(tmp_path / "000002")
    mine, theirs = (each.provenance["spec"]["persons"] for each in (clip, other))
    if by is SplitBy.person:
        mine[1]["body"] = theirs[0]["body"]
    else:
        mine[1]["motion"] = theirs[0]["motion"].replace(" 2.00-3.00 s", " 8.00-9.00 s")
    save_clip(clip, tmp_path / "000003")
    done = synth(tmp_path, "split", "data=.", f"by={by.name}", "check=splits.json")
    assert done.returncode == 1
    assert f"1 leaks; the same {by.name} in train: 000002; test: 000003" in done.stderr
    assert len(json.loads((tmp_path / "leaks.json").read_text())["leaks"]) == 1


def test_the_command_writes_what_export_takes(data, tmp_path):
    done = synth(tmp_path, "split", f"data={data}", "train=0.5", "validation=0.5", "test=0", "out=splits.json")
    assert done.returncode == 0, done.stderr
    assert "splits.json: train: 3 clips, 50%" in done.stdout
    done = synth(tmp_path, "export", f"data={data}", "format=yolo", "splits=splits.json", "every=3", "out=out")
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["data=none"], "none: no such file or folder. Expected: Folder of a data set; or a folder of takes"),
        (["data=set", "train=0.9"], "expected shares from 0 to 1 that add up to 1, found train=0.9"),
        (["data=set", "train=1.1", "validation=-0.2"], "expected shares from 0 to 1"),
        (
            ["data=set", "by=rig"],
            "groups of clips or more that share no rig, for 3 splits; found 1 in 6 clips",
        ),
        (["data=alike", "by=motion"], "found 1 in 2 clips; split by something else, or fewer ways. Or divide the rec"),
        (["data=bare"], "no scene in the provenance"),
        (["data=set", "check=none.json"], "none.json: no such file"),
        (["data=set", "check=list.json"], "expected splits of format 1"),
        (["data=set", "out=set"], "expected a file to write, found a folder"),
    ],
)
def test_bad_input_is_refused(data, tmp_path, arguments, said):
    (tmp_path / "set").symlink_to(data)
    (tmp_path / "list.json").write_text("[]")
    save_clip(replace(load_clip(data / "000000"), images=None, provenance={}), tmp_path / "bare")
    for name in ("000000", "000001"):
        save_clip(replace(load_clip(data / "000000"), id=name, images=None), tmp_path / "alike" / name)
    lines = (json.dumps({"id": name, "status": "ok"}) for name in ("000000", "000001"))
    (tmp_path / "alike" / "manifest.jsonl").write_text("\n".join(lines))
    given = arguments if any(each.startswith("out=") for each in arguments) else [*arguments, "out=out.json"]
    done = synth(tmp_path, "split", *given)
    assert done.returncode == 1
    assert said in done.stderr and len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "out.json").exists()
