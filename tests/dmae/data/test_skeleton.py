import pytest

from dmae.data.skeleton import BODY21, BODY25, COCO17, SHELF14, SKELETONS, Skeleton, fuse, get_skeleton


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
