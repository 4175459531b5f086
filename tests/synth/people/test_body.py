"""Bodies have the requested size, and joints where annotators and detectors place them."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dmae.data.skeleton import SKELETONS
from synth.interactions.registry import InteractionConfig, find_interaction, interaction_choices
from synth.motion.config import MotionConfig
from synth.people.body import SEGMENTS, SKELETON, Body, body_at, landmarks, sample_body, segment_origins
from synth.people.clothing import HAIRSTYLES, Garment, PersonLooks, sample_looks
from synth.people.outfit import parts
from synth.people.solids import capsules
from synth.physics.simulation import Simulation, simulate
from synth.scene import sampling as sample
from synth.scene.config import SceneConfig
from synth.scene.sampling import sample_scene
from synth.scene.spec import SceneSpec
from tests.support.scenes import RIG
from tests.support.simulated_interactions import RECORDED, palms
from tests.support.surfaces import in_t_pose

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
    return np.concatenate([part.vertices for part in in_t_pose(body, looks)])


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
    for part in parts(Body(feminine=1.0), looks):
        assert np.isfinite(part.vertices).all() and part.faces.max() < len(part.vertices)
        corners = part.vertices[part.faces]
        flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        outward = (flat * part.normals[part.faces].mean(1)).sum(1)
        assert (outward > 0).mean() > 0.97, "faces are counter-clockwise seen from outside"


@pytest.mark.parametrize(
    ("field", "given"),
    [
        ("stature", {"stature": 1.0}),
        ("stature", {"stature": 1.75, "age": 4}),
        ("mass", {"mass": 300}),
        ("mass", {"mass": 60, "stature": 1.02, "age": 4}),
        ("mass", {"mass": 28}),
        ("mass", {"mass": float("nan")}),
        ("feminine", {"feminine": 2}),
        ("legs", {"legs": 1.5}),
        ("age", {"age": 3}),
        ("age", {"age": float("nan")}),
    ],
)
def test_impossible_bodies_are_refused_in_one_line(field, given):
    with pytest.raises(ValueError, match=rf"^body: {field} must .*, found {given[field]}$") as error:
        Body(**given)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("age", [4, 7, 11, 14, 17.9, 18, 60])
def test_no_person_of_the_population_is_refused(age):
    for feminine, stature, index, limbs in product((0, 1), (-9, 0, 9), (-9, 0, 9), (-9, 0, 9)):
        body = body_at(feminine, age, stature=stature, index=index, legs=limbs, arms=limbs)
        assert 0.7 < body.girth < 1.5


def test_nobody_is_younger_than_four():
    with pytest.raises(ValueError, match="age must lie in 4"):
        body_at(0, 2)


def test_unknown_looks_are_refused():
    with pytest.raises(ValueError, match="no pattern 'tartan'"):
        Garment(True, "tartan", ((0, 0, 0), (1, 1, 1)))


# Statures, masses and proportions follow surveys and growth charts.

# Percentiles 3, 50, 97 of the CDC's charts, boys and girls: stature, m.
STATURES = {
    (5.04, 0): (1.0033, 1.0918, 1.1783),
    (10.04, 0): (1.2667, 1.3882, 1.5153),
    (14.04, 0): (1.4853, 1.6414, 1.7882),
    (5.04, 1): (0.9935, 1.0796, 1.1736),
    (10.04, 1): (1.2596, 1.3821, 1.5129),
    (14.04, 1): (1.4812, 1.6048, 1.7288),
}
# At -2, 0, 1 and 2 standard deviations: body mass index, kg/m^2.
INDICES = {
    (5, 0): (13.57, 15.42, 16.78, 18.69),
    (10, 0): (13.83, 16.62, 19.23, 24.65),
    (16, 0): (16.57, 20.53, 24.02, 30.30),
    (6, 1): (13.14, 15.21, 17.00, 20.25),
    (12, 1): (14.31, 18.07, 21.54, 28.24),
}


@pytest.mark.parametrize(("age", "feminine"), STATURES)
def test_statures_of_children_follow_the_growth_charts(age, feminine):
    found = [body_at(feminine, age, stature=z).stature for z in (-1.881, 0, 1.881)]
    np.testing.assert_allclose(found, STATURES[age, feminine], atol=0.012)


@pytest.mark.parametrize(("age", "feminine"), INDICES)
def test_mass_indices_of_children_follow_the_growth_charts(age, feminine):
    bodies = [body_at(feminine, age, index=z) for z in (-2, 0, 1, 2)]
    np.testing.assert_allclose([b.mass / b.stature**2 for b in bodies], INDICES[age, feminine], rtol=0.025)


def test_adults_follow_ansur_ii():
    # ANSUR II: mean and standard deviation of stature, m.
    rng = np.random.default_rng(0)
    bodies = [sample_body(rng=rng) for _ in range(4000)]
    for feminine, mean, spread in ((0.0, 1.756, 0.069), (1.0, 1.629, 0.064)):
        these = [body for body in bodies if body.feminine == feminine]
        stature, mass = np.array([(body.stature, body.mass) for body in these]).T
        assert stature.mean() == pytest.approx(mean, abs=0.01)
        assert stature.std() == pytest.approx(spread, abs=0.007)
        assert np.corrcoef(stature, mass)[0, 1] == pytest.approx(0.5, abs=0.1)
        girths = np.array([body.girth for body in these])
        assert abs(np.corrcoef(stature, girths)[0, 1]) < 0.1, "girth does not depend on stature"
        assert np.ptp(girths) > 0.25


def test_the_share_of_children_is_as_requested():
    rng = np.random.default_rng(1)
    ages = np.array([sample_body(0.3, rng=rng).age for _ in range(2000)])
    assert (ages < 18).mean() == pytest.approx(0.3, abs=0.03)
    assert ages[ages < 18].min() < 4.5 < 17.5 < ages[ages < 18].max()
    assert (np.array([sample_body(rng=rng).age for _ in range(50)]) == 30).all()


def heads_tall(body: Body) -> float:
    """Stature over the height of the head from the chin, which is 0.025 of stature above an adult's neck joint."""
    return 1 / (0.130 * body.head)


@pytest.mark.parametrize(("age", "heads", "sitting"), [(4, 5.4, 0.562), (8, 6.4, 0.537), (12, 7.2, 0.519)])
def test_children_have_large_heads_and_short_legs(age, heads, sitting):
    for body in (body_at(0, age), body_at(1, age)):
        assert heads_tall(body) == pytest.approx(heads, abs=0.25)
        # Hips are 0.053 of stature above what people sit on: adults sit 0.523 high and have their hips at 0.530.
        assert body.hip_height / body.stature == pytest.approx(1 - sitting + 0.053, abs=0.004)


def test_bodies_grow_steadily_into_adults():
    ages = np.arange(4, 18.01, 0.25)
    for feminine in (0, 1):
        bodies = [body_at(feminine, age) for age in ages[:-1]] + [body_at(feminine)]
        for growing in ("stature", "mass", "hip_height"):
            assert (np.diff([getattr(body, growing) for body in bodies]) > -0.01).all(), growing
        shares = np.array([body.masses[3] / body.mass for body in bodies])
        assert shares[0] == pytest.approx(0.081 + 0.0114 * 11, abs=1e-3)
        assert (np.diff(shares) <= 1e-9).all()
        assert np.abs(np.diff([body.girth for body in bodies[:-1]])).max() < 0.02
        figures = [body.figure for body in bodies]
        assert figures[0] == pytest.approx(0.5)
        assert figures[-1] == feminine
    assert body_at(0, 6).tempo > body_at(0, 12).tempo > body_at(0).tempo == 1.0


# Children take part in all motion and interactions, and physics follows.

SCENE = SceneConfig(seconds=3.0, persons=[4, 4], props=[0, 0], children=0.8)
"""Four people, or as near to four as the interaction takes."""


def played(kind: str, motion: MotionConfig, scene: SceneConfig = SCENE) -> tuple[SceneSpec, Simulation]:
    if kind != "none":
        count = int(np.clip(scene.persons[0], *find_interaction(kind).persons))
        scene = replace(scene, persons=[count, count])
    spec = sample_scene(scene, motion, interaction=InteractionConfig(kind), seed=4, clip=0).spec
    return spec, simulate(spec, RIG, painted=False)


def check(spec: SceneSpec, simulation: Simulation) -> None:
    assert min(person.body.age for person in spec.persons) < 11
    quality = simulation.quality
    assert quality["tracking_error_mm"] <= 30
    assert quality["penetration_mm"] <= 20
    assert quality["object_penetration_mm"] <= 25
    assert quality["shift_m"] <= 0.3
    assert quality["foot_slide"] <= 0.15


@pytest.mark.slow
@pytest.mark.parametrize("kind", interaction_choices())
def test_children_take_part_in_every_interaction(kind):
    check(*played(kind, MotionConfig()))


@pytest.mark.parametrize("source", RECORDED)
@pytest.mark.parametrize("kind", ["none", "crossing", "table"])
def test_children_follow_recorded_motion(kind, source, data_folder):
    motion = MotionConfig(kind=source, path=str(data_folder / "cmu" / RECORDED[source]))
    check(*played(kind, motion, replace(SCENE, seconds=2.0)))


@pytest.mark.parametrize("kind", ["handshake", "hug", "pass_box", "dance"])
@pytest.mark.parametrize("order", [1, -1])
def test_a_small_child_reaches_a_tall_man(kind, order, monkeypatch):
    bodies = iter((body_at(0, stature=1.6), body_at(1, 6))[::order])
    monkeypatch.setattr(sample, "sample_body", lambda *args, **kwargs: next(bodies))
    spec, simulation = played(kind, MotionConfig(), replace(SCENE, persons=[2, 2], children=0.0))
    check(spec, simulation)
    right, left = palms(spec, simulation, "r"), palms(spec, simulation, "l")
    if kind == "handshake":
        assert np.linalg.norm(right[:, 0] - right[:, 1], axis=-1).min() < 0.05
    elif kind == "hug":
        child = 1 if order == 1 else 0
        shoulder = simulation.joints[-1, child, SKELETON.index("body25.l_shoulder")[0], 2]
        assert max(left[-1, child, 2], right[-1, child, 2]) < shoulder + 0.1
        assert simulation.quality["contact_frames"] > 30
    elif kind == "dance":
        assert np.median(np.linalg.norm(left[:, 0] - right[:, 1], axis=-1)) < 0.11
    else:
        # The second person takes the box and keeps it.
        apart = np.linalg.norm(left - right, axis=-1)
        assert apart[-1, 1] == pytest.approx(2 * spec.loads[0].half_width, abs=0.08)


def test_short_legs_hang_from_a_stool():
    spec, simulation = played("table", MotionConfig())
    ankles = simulation.joints[-1, :, SKELETON.index("body25.l_ankle")[0], 2]
    hips = simulation.joints[-1, :, SKELETON.index("body25.mid_hip")[0], 2]
    for person, ankle, hip in zip(spec.persons, ankles, hips, strict=True):
        assert person.body.stature > 1.3 or ankle > 0.15
        assert person.body.stature < 1.5 or ankle < 0.10
        assert 0.47 < hip < 0.62
    assert ankles.max() > 0.15 > 0.10 > ankles.min()
