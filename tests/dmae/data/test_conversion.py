"""tests.dmae.data.test_conversion."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import convert, head_ends
from dmae.data.skeleton import BODY21, BODY25, COCO17, SHELF14, Skeleton, get_skeleton
from tests.support.clips import t_pose, walkers


def one(skeleton=BODY25, hide=(), **changes) -> Poses3D:
    """A single T-pose, some joints absent."""
    xyz = t_pose(skeleton)[None, None].copy()
    xyz[:, :, skeleton.index(*hide)] = np.nan
    return Poses3D(skeleton, xyz, **changes)


def test_the_same_skeleton_is_itself():
    poses = one()
    assert convert(poses, BODY25) is poses


@pytest.mark.parametrize("source", [BODY25, BODY21])
def test_t_pose_is_converted_to_shelf14(source):
    shelf = convert(one(source), SHELF14)
    # Shoulders 1.45 m up, ears 1.64 m: bottom of the head half way, its top by the formula.
    want = t_pose(SHELF14)
    want[SHELF14.index("bottom_head")] = (0, 0, 1.545)
    want[SHELF14.index("top_head")] = (0.125, 0, 1.545 + 0.145)
    np.testing.assert_allclose(shelf.xyz[0, 0], want, atol=1e-6)
    assert (shelf.source == Source.MEASURED).all()


def test_a_fused_skeleton_is_sliced():
    skeleton = get_skeleton("body25+shelf14")
    rng = np.random.default_rng(0)
    fused = Poses3D(
        skeleton,
        rng.normal(size=(3, 2, 39, 3)),
        rng.integers(1, 4, (3, 2, 39)),
        rng.normal(size=(3, 2, 39, 3, 3)),
        rng.integers(0, 5, (3, 2, 39)),
    )
    for target, part in ((BODY25, slice(0, 25)), (SHELF14, slice(25, None))):
        found = convert(fused, target)
        assert found.skeleton == target
        for name in ("xyz", "source", "cov", "views"):
            np.testing.assert_array_equal(getattr(found, name), getattr(fused, name)[:, :, part])
    # A third skeleton is made from the first part.
    np.testing.assert_array_equal(convert(fused, BODY21).xyz[:, :, 0], fused.xyz[:, :, 0])


def test_coco_gets_a_neck_and_a_middle_of_the_hips():
    cov = np.tile(np.eye(3) * 4e-4, (1, 1, 17, 1, 1))
    poses = one(COCO17, cov=cov, views=np.full((1, 1, 17), 3))
    found = convert(poses, BODY25)
    neck, mid_hip, toe = BODY25.index("neck", "mid_hip", "l_big_toe")
    np.testing.assert_allclose(found.xyz[0, 0, [neck, mid_hip]], [(0, 0, 1.45), (0, 0, 0.95)], atol=1e-6)
    np.testing.assert_allclose(found.cov[0, 0, neck], np.eye(3) * 2e-4, rtol=1e-6)
    assert found.views[0, 0, neck] == 3
    assert found.source[0, 0, toe] == Source.ABSENT
    assert np.isnan(found.cov[0, 0, toe]).all()


def test_a_derived_joint_has_the_lowest_score_of_its_sources():
    source, views = np.full((1, 1, 25), Source.MEASURED), np.full((1, 1, 25), 4)
    shoulder = BODY25.index("l_shoulder")
    source[:, :, shoulder], views[:, :, shoulder] = Source.COMPLETED, 2
    shelf = convert(one(source=source, views=views), SHELF14)
    top, bottom, wrist = SHELF14.index("top_head", "bottom_head", "l_wrist")
    assert shelf.source[0, 0, [top, bottom, wrist]].tolist() == [Source.COMPLETED, Source.COMPLETED, Source.MEASURED]
    assert shelf.views[0, 0, [top, bottom, wrist]].tolist() == [2, 2, 4]
    # An eye that is not used does not weaken it.
    source[:, :, shoulder], source[:, :, BODY25.index("l_eye")] = Source.DENOISED, Source.COMPLETED
    assert convert(one(source=source), SHELF14).source[0, 0, top] == Source.DENOISED


def test_a_head_is_derived_from_its_measured_joints():
    """A completed ear, far off, has no say while the other one was measured."""
    xyz, source = t_pose()[None, None], np.full((1, 1, 25), Source.MEASURED)
    ear = BODY25.index("l_ear")
    xyz[:, :, ear] += 0.3
    source[:, :, ear] = Source.COMPLETED
    shelf = convert(Poses3D(BODY25, xyz, source), SHELF14)
    head = SHELF14.index("bottom_head", "top_head")
    np.testing.assert_allclose(shelf.xyz[0, 0, head], t_pose(SHELF14)[head], atol=1e-3)
    assert (shelf.source[0, 0, head] == Source.MEASURED).all()


@pytest.mark.parametrize(
    "hide",
    [
        ("nose",),
        ("l_ear",),
        ("r_ear", "nose"),
        ("l_ear", "r_ear"),
        ("l_ear", "r_ear", "nose"),
        ("l_ear", "r_ear", "nose", "l_eye"),
        ("l_ear", "r_ear", "r_eye", "l_eye"),
        ("l_ear", "l_eye", "nose"),
        ("neck", "mid_hip"),
    ],
)
def test_the_head_is_derived_from_the_remaining_joints_of_the_face(hide):
    """The average head's measures differ from this one's by centimetres; a wrong fallback by decimetres."""
    ends, used = head_ends(one(hide=hide))
    np.testing.assert_allclose(ends[0, 0], [(0, 0, 1.545), (0.125, 0, 1.69)], atol=0.02)
    assert not used[0, 0, BODY25.index(*hide)].any()
    assert convert(one(hide=hide), SHELF14).source[0, 0, -1] == Source.MEASURED


@pytest.mark.parametrize("hide", [("l_shoulder",), ("l_ear", "r_ear", "l_eye", "r_eye", "nose")])
def test_an_underdetermined_head_is_absent(hide):
    shelf = convert(one(hide=hide), SHELF14)
    assert (shelf.source[0, 0, -2:] == Source.ABSENT).all()
    assert (shelf.source[0, 0, :6] == Source.MEASURED).all()


@given(st.floats(-np.pi, np.pi), st.floats(-5, 5))
def test_the_head_turns_with_the_body(angle, away):
    R = Rotation.from_rotvec((0, 0, angle)).as_matrix()
    turned = Poses3D(BODY25, (t_pose() @ R.T + (away, 0, 0))[None, None])
    want = convert(one(), SHELF14).xyz[0, 0] @ R.T + (away, 0, 0)
    np.testing.assert_allclose(convert(turned, SHELF14).xyz[0, 0], want, atol=1e-5)


@given(st.lists(st.sampled_from(BODY25.joints), unique=True), st.sampled_from([BODY21, COCO17, SHELF14]))
def test_absent_joints_stay_absent_and_others_stay_in_place(hide, target):
    whole, part = convert(one(), target), convert(one(hide=hide), target)
    for joint, name in enumerate(target.joints):
        if name in BODY25.joints:
            assert (part.source[0, 0, joint] == Source.ABSENT) == (name in hide)
        if part.source[0, 0, joint] and name not in ("bottom_head", "top_head"):
            np.testing.assert_array_equal(part.xyz[0, 0, joint], whole.xyz[0, 0, joint])


def test_persons_and_frames_are_converted_independently():
    poses = walkers()
    xyz = poses.xyz.copy()
    xyz[3, 1] = np.nan
    whole, holed = convert(poses, SHELF14), convert(replace(poses, xyz=xyz, source=None), SHELF14)
    assert np.isnan(holed.xyz[3, 1]).all()
    np.testing.assert_array_equal(np.delete(holed.xyz, 3, 0), np.delete(whole.xyz, 3, 0))


def test_zero_persons_are_converted():
    assert convert(Poses3D(BODY25, np.empty((5, 0, 25, 3))), SHELF14).xyz.shape == (5, 0, 14, 3)


def test_an_impossible_conversion_names_the_missing_joints():
    with pytest.raises(KeyError, match=r"'fish' to 'shelf14'.*r_ankle.*tail"):
        convert(Poses3D(Skeleton("fish", ("fin", "tail"), (-1, 0)), np.zeros((1, 1, 2, 3))), SHELF14)
