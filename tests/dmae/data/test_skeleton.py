"""Skeletons that a YAML file defines, and errors in such files."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dmae
from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import for_any_size, resized_poses, usual_size
from dmae.data.skeleton import (
    BODY21,
    BODY25,
    COCO17,
    SHELF14,
    SKELETONS,
    Skeleton,
    decode_skeleton,
    encode,
    fuse,
    get_skeleton,
)
from dmae.data.store import load_clip, save_clip
from dmae.formats.own import export_npz, read_npz
from tests.support.animals import DOG, HAND, dog_clip


@pytest.mark.parametrize("skeleton", SKELETONS.values(), ids=SKELETONS)
def test_mirror_is_an_involution_that_swaps_sides(skeleton):
    for joint, partner in enumerate(skeleton.mirror):
        assert skeleton.mirror[partner] == joint
        name, other = skeleton.joints[joint], skeleton.joints[partner]
        assert (name == other) == (not name.startswith(("l_", "r_")))
        assert name[2:] == other[2:] or name == other


@pytest.mark.parametrize("skeleton", SKELETONS.values(), ids=SKELETONS)
def test_mirrored_bones_are_bones(skeleton):
    for parent, child in skeleton.bones:
        assert (skeleton.mirror[parent], skeleton.mirror[child]) in skeleton.bones


def test_orders_are_those_of_the_published_formats():
    # OpenPose BODY_25 and the Shelf annotation, spot checks by number.
    assert len(BODY25) == 25
    assert BODY25.index("nose", "neck", "mid_hip", "r_ankle", "l_ankle", "l_ear", "r_heel") == [0, 1, 8, 11, 14, 18, 24]
    assert SHELF14.index("r_ankle", "l_hip", "r_wrist", "bottom_head", "top_head") == [0, 3, 6, 12, 13]
    assert COCO17.index("nose", "l_eye", "l_shoulder", "r_ankle") == [0, 1, 5, 16]


def test_body21_is_body25_less_four():
    dropped = [i for i, joint in enumerate(BODY25.joints) if joint not in BODY21.joints]
    assert dropped == [20, 21, 23, 24]
    assert [joint for joint in BODY25.joints if joint in BODY21.joints] == list(BODY21.joints)


def test_fused_is_both_side_by_side():
    both = fuse(BODY21, SHELF14)
    assert len(both) == 35
    assert both.joints[:21] == tuple(f"body21.{joint}" for joint in BODY21.joints)
    assert both.parents[21:] == tuple(p + 21 if p >= 0 else -1 for p in SHELF14.parents)
    assert both.mirror[both.index("shelf14.l_hip")[0]] == both.index("shelf14.r_hip")[0]
    assert get_skeleton("body21+shelf14") == both


def test_unknown_names_are_answered_with_what_there_is():
    with pytest.raises(KeyError, match="body25"):
        get_skeleton("body52")
    with pytest.raises(KeyError, match="joined by"):
        get_skeleton("body25+shelf14+coco17")
    with pytest.raises(KeyError, match=r"\['tail'\].*top_head"):
        SHELF14.index("top_head", "tail")
    with pytest.raises(KeyError, match=r"\['noes'\]; did you mean nose\?"):
        BODY25.index("noes")
    with pytest.raises(KeyError, match=r"\['nose'\]; did you mean body25\.nose\?"):
        get_skeleton("body25+shelf14").index("nose")


@pytest.mark.parametrize(
    ("joints", "parents", "message"),
    [
        (("a", "a"), (-1, 0), "unique"),
        (("a", "b"), (-1,), "expected 2 parents"),
        (("a", "b"), (-1, 2), "must lie in -1..1"),
        (("a", "b", "c"), (-1, 2, 1), "circle"),
        (("a",), (0,), "circle"),
    ],
)
def test_malformed_skeletons_are_refused(joints, parents, message):
    with pytest.raises(ValueError, match=message):
        Skeleton("odd", joints, parents)


START = "name: spider\njoints:\n  body:\n"


def written(tmp_path: Path, text: str) -> str:
    path = tmp_path / "spider.yaml"
    path.write_text(text)
    return str(path)


def test_a_file_states_joints_parents_pairs_torso_and_size(tmp_path):
    text = "  l_leg: body\n  r_leg: body\n  head: body\ntorso: [body, head]\nstretching: [head]\nsize_m: 0.02\n"
    spider = dmae.get_skeleton(written(tmp_path, START + text))
    assert spider.joints == ("body", "l_leg", "r_leg", "head")
    assert spider.parents == (-1, 0, 0, 0)
    assert spider.mirror == (0, 2, 1, 3)
    assert spider.left == (1,)
    assert spider.trunk == (0, 3)
    assert spider.rigid_bones == ((0, 1), (0, 2))
    assert spider.size_m == 0.02


def test_pairs_need_not_be_named_as_those_of_people(tmp_path):
    spider = get_skeleton(written(tmp_path, START + "  one: body\n  two: body\nmirror: [[one, two]]\n"))
    assert spider.mirror == (0, 2, 1)
    assert spider.left == (1,)
    assert spider.size_m is None


def test_without_a_torso_it_is_the_roots_and_their_children():
    hand = replace(HAND, torso=None)
    assert [HAND.joints[i] for i in hand.trunk] == ["wrist", "thumb_1", "index_1", "middle_1", "ring_1", "little_1"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (START + "  a: b\n  b: a\n", r"spider.yaml: skeleton 'spider': parents run in a circle, through a, b"),
        (START + "  leg: boddy\n", r"joint 'leg': its parent 'boddy' is no joint; did you mean body\?"),
        (START + "  leg: body\n  leg: body\n", "key 'leg' twice"),
        (START + "  leg: body\nmirror: [[leg, arm]]\n", "mirror: 'arm' is no joint"),
        (START + "  leg: body\nmirror: [[leg, leg]]\n", "mirror: 'leg' occurs twice"),
        (START + "  leg: body\nmirror: [leg]\n", r"mirror: expected pairs \[left, right\]"),
        (START + "  a: body\n  b: body\n  c: a\n  d: a\n  e: b\nmirror: [[c, e]]\n", "'c' and 'e' do not match"),
        (START + "torso: [leg]\n", "torso: 'leg' is no joint"),
        (START + "size_m: 0\n", "size_m: expected a number from 0.001 to 100 m, found 0"),
        (START + "size: 1\n", "unknown key 'size'"),
        (START + "  a/b: body\n", "expected a name of up to 60 characters without"),
        (START + "  no: body\n", "stand in quotes"),
        (START.replace("spider", "body25"), "'body25' is the name of a skeleton of this package"),
        ("name: spider\njoints: [a, b]\n", "expected 1 to 500 lines 'joint: parent'"),
        ("[a]\n", "expected a skeleton with name and joints"),
        ("a: &x 1\nb: *x\n", "aliases"),
    ],
)
def test_a_wrong_file_is_answered_with_file_and_joint(tmp_path, text, message):
    with pytest.raises(ValueError, match=message) as caught:
        get_skeleton(written(tmp_path, text))
    assert "spider.yaml" in str(caught.value)


def test_no_such_file(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.yaml"):
        get_skeleton(str(tmp_path / "none.yaml"))


@pytest.mark.parametrize("skeleton", [*SKELETONS.values(), get_skeleton("body25+shelf14"), HAND, DOG])
def test_what_is_stored_is_the_same_skeleton(skeleton):
    again = decode_skeleton(encode(skeleton), "a clip")
    assert again == skeleton
    assert (again.trunk, again.mirror, again.size_m) == (skeleton.trunk, skeleton.mirror, skeleton.size_m)


def test_files_in_files_are_not_read():
    with pytest.raises(ValueError, match="found the name of a file"):
        decode_skeleton("/etc/spider.yaml", "a clip")


def test_a_clip_and_an_archive_hold_the_definition(tmp_path):
    clip = replace(dog_clip(3), poses=dog_clip(3).truth)
    save_clip(clip, tmp_path / "clip")
    read = load_clip(tmp_path / "clip")
    assert read.detections.skeleton == read.poses.skeleton == DOG
    assert read.detections.skeleton.size_m == DOG.size_m
    export_npz(clip.poses, clip.fps, tmp_path / "poses.npz")
    poses, _ = read_npz(tmp_path / "poses.npz")
    assert poses.skeleton == DOG
    np.testing.assert_array_equal(poses.xyz, clip.poses.xyz)


def test_worlds_of_another_size_and_back():
    poses = dog_clip(5).truth
    again = resized_poses(resized_poses(poses, 3.0), 1 / 3.0)
    np.testing.assert_allclose(again.xyz, poses.xyz, rtol=1e-6)
    assert usual_size(resized_poses(poses, 3.0).xyz) == pytest.approx(3 * usual_size(poses.xyz))
    assert usual_size(np.full((4, 1, 3, 3), np.nan)) is None
    assert usual_size(np.zeros((4, 1, 3, 3))) is None


def test_a_method_sees_bodies_as_large_as_people_and_measured_joints_stay():
    truth = dog_clip(5).truth
    seen = []

    def fill(poses: Poses3D, fps: float) -> Poses3D:
        seen.append(usual_size(poses.xyz) / poses.skeleton.scale)
        return replace(poses, xyz=poses.xyz + 0, source=poses.source)

    for skeleton in (DOG, replace(DOG, size_m=None)):
        filled = for_any_size(fill)(replace(truth, skeleton=skeleton), 30.0)
        np.testing.assert_array_equal(filled.xyz, truth.xyz)
        assert (filled.source == Source.MEASURED).all()
        assert filled.skeleton.size_m == skeleton.size_m
    people = Poses3D(BODY25, np.zeros((2, 1, 25, 3)))
    assert for_any_size(lambda poses, fps: poses)(people, 30.0) is people
    assert seen[1] == pytest.approx(1.7 / (usual_size(truth.xyz) / 1.7), rel=1e-4)
