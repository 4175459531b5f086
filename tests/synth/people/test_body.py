"""Bodies have the requested size, and joints where annotators and detectors place them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dmae.data.skeleton import SKELETONS
from synth.people.body import SEGMENTS, SKELETON, Body, body_at, landmarks, segment_origins
from synth.people.clothing import HAIRSTYLES, Garment, PersonLooks, sample_looks
from synth.people.mjcf import capsules
from synth.people.surfaces import parts

ADULTS = st.builds(
    Body,
    stature=st.floats(1.45, 2.05),
    mass=st.floats(45, 110),
    feminine=st.floats(0, 1),
    legs=st.floats(0.95, 1.05),
    arms=st.floats(0.95, 1.05),
)
DEVIATIONS = st.floats(-2, 2)
CHILDREN = st.builds(
    body_at,
    st.floats(0, 1),
    st.floats(4, 17.9),
    stature=DEVIATIONS,
    index=DEVIATIONS,
    legs=DEVIATIONS,
    arms=DEVIATIONS,
)
BODIES = ADULTS | CHILDREN


def t_pose(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """Segment origins (16, 3) and joints (39, 3) of a body standing in the T-pose at the origin."""
    root = np.array([[0, 0, body.hip_height]])
    origins = segment_origins(body, root, np.tile(np.eye(3), (1, len(SEGMENTS), 1, 1)))[0]
    segments, points, _ = landmarks(body)
    return origins, origins[segments] + points


def joint(joints: np.ndarray, name: str) -> np.ndarray:
    return joints[SKELETON.index(name)[0]]


def surface(body: Body, looks: PersonLooks) -> np.ndarray:
    """(N, 3) vertices of the visible surface of a body in the T-pose."""
    origins, _ = t_pose(body)
    return np.concatenate([mesh.vertices + origins[SEGMENTS.index(segment)] for segment, _, mesh in parts(body, looks)])


@pytest.mark.parametrize(
    ("name", "height"),
    [
        ("body25.r_ankle", 0.039),
        ("body25.l_knee", 0.285),
        ("body25.mid_hip", 0.530),
        ("body25.r_shoulder", 0.818),
        ("body25.l_eye", 0.936),
    ],
)
def test_joints_are_at_the_heights_of_winters_figure(name, height):
    body = Body(stature=1.8, mass=75)
    assert joint(t_pose(body)[1], name)[2] / body.stature == pytest.approx(height, abs=0.015)


@given(BODIES)
@settings(max_examples=30, deadline=None)
def test_a_body_has_its_stature_and_mass(body):
    assert body.masses.sum() == pytest.approx(body.mass, rel=1e-6)
    skin = surface(body, sample_looks(0.0, rng=np.random.default_rng(0)))
    assert skin[:, 2].min() == pytest.approx(0, abs=0.003)
    assert np.ptp(skin[:, 2]) == pytest.approx(body.stature, rel=0.025)


@given(BODIES)
@settings(max_examples=20, deadline=None)
def test_left_mirrors_right(body):
    joints = t_pose(body)[1]
    np.testing.assert_allclose(joints[list(SKELETON.mirror)] * (1, -1, 1), joints, atol=1e-12)


@given(BODIES)
@settings(max_examples=20, deadline=None)
def test_annotators_put_hips_and_shoulders_lower_than_detectors(body):
    joints = t_pose(body)[1]
    for side in "lr":
        for part, low, high in (("hip", 0.040, 0.078), ("shoulder", 0.021, 0.038)):
            gap = joint(joints, f"body25.{side}_{part}") - joint(joints, f"shelf14.{side}_{part}")
            size = 1.75 / body.stature if body.age < 18 else 1.0
            assert low < gap[2] * size < high
            assert abs(gap[0]) < 0.02


def test_the_head_limb_follows_its_formula():
    joints = t_pose(Body(stature=1.75))[1]
    sources = [joint(joints, f"body25.{side}_{part}") for side in "lr" for part in ("shoulder", "ear")]
    bottom = joint(joints, "shelf14.bottom_head")
    np.testing.assert_allclose(bottom, np.mean(sources, axis=0), atol=1e-9)
    np.testing.assert_allclose(joint(joints, "shelf14.top_head") - bottom, (0.125, 0, 0.145), atol=1e-3)


@given(BODIES)
@settings(max_examples=10, deadline=None)
def test_face_and_feet_landmarks_lie_on_the_surface(body):
    skin = surface(body, sample_looks(body.feminine, rng=np.random.default_rng(1)))
    joints = t_pose(body)[1]
    for name in ("nose", "l_eye", "r_ear", "l_big_toe", "r_small_toe", "l_heel"):
        assert np.linalg.norm(skin - joint(joints, f"body25.{name}"), axis=1).min() < 0.025, name


@given(BODIES)
@settings(max_examples=10, deadline=None)
def test_every_skeleton_has_its_joints(body):
    origins, joints = t_pose(body)
    for name, skeleton in SKELETONS.items():
        segments, points, depth = landmarks(body, skeleton)
        places = origins[segments] + points
        assert places.shape == (len(skeleton), 3)
        assert (depth > 0).all()
        np.testing.assert_allclose(places[list(skeleton.mirror)] * (1, -1, 1), places, atol=1e-12)
        for theirs, place in zip(skeleton.joints, places, strict=True):
            twin = f"shelf14.{theirs}" if name == "shelf14" else f"body25.{theirs}"
            if twin in SKELETON.joints and (name, theirs) != ("body25b", "neck"):
                np.testing.assert_allclose(place, joint(joints, twin), atol=1e-9)
    for name in ("body25b", "halpe26"):
        segments, points, _ = landmarks(body, SKELETONS[name])
        places = dict(zip(SKELETONS[name].joints, origins[segments] + points, strict=True))
        assert places["head_top"][2] == pytest.approx(body.stature, rel=0.01)
        assert (places["neck"][2] > places["l_shoulder"][2] + 0.02) == (name == "body25b")


def test_depth_reaches_the_skin_of_limbs_and_little_more():
    segments, _, depth = landmarks(Body())
    ends = capsules(Body())
    for name in ("body25.l_elbow", "body25.r_knee", "body25.l_hip", "shelf14.r_shoulder"):
        i = SKELETON.index(name)[0]
        radius = ends[2][ends[0] == segments[i]].max()
        assert radius < depth[i] + 0.03 < 2.5 * radius + 0.05
    assert depth[SKELETON.index("body25.nose")[0]] < 0.03


def test_stout_people_are_wider_and_hide_their_joints_deeper():
    slim, stout = Body(1.75, 60), Body(1.75, 100)
    looks = sample_looks(0.0, rng=np.random.default_rng(0))
    waist = [s[abs(s[:, 2] - 1.1) < 0.05] for s in (surface(slim, looks), surface(stout, looks))]
    # In the T-pose forearms are far from the waist.
    assert np.ptp(waist[1][:, 1]) > 1.2 * np.ptp(waist[0][:, 1])
    assert (landmarks(stout)[2] >= landmarks(slim)[2]).all()


@pytest.mark.parametrize("style", HAIRSTYLES)
@pytest.mark.parametrize("long", [True, False])
def test_all_looks_have_valid_surfaces(style, long):
    cloth = Garment(long, "plain", ((0.5, 0.5, 0.5), (0.4, 0.4, 0.4)))
    grey = (0.5, 0.5, 0.5)
    looks = PersonLooks(grey, style, grey, cloth, cloth, grey, grey, untucked=long)
    for _, _, mesh in parts(Body(feminine=1.0), looks):
        assert np.isfinite(mesh.vertices).all() and mesh.faces.max() < len(mesh.vertices)
        corners = mesh.vertices[mesh.faces]
        flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        outward = (flat * mesh.normals[mesh.faces].mean(1)).sum(1)
        assert (outward > 0).mean() > 0.97, "faces are counter-clockwise seen from outside"


@pytest.mark.parametrize(
    ("field", "value"), [("stature", 0.8), ("mass", 300), ("feminine", 2), ("legs", 1.5), ("age", 3)]
)
def test_impossible_bodies_are_refused(field, value):
    with pytest.raises(ValueError, match=f"{field} must lie in"):
        Body(**{field: value})


def test_unknown_looks_are_refused():
    with pytest.raises(ValueError, match="no pattern 'tartan'"):
        Garment(True, "tartan", ((0, 0, 0), (1, 1, 1)))
