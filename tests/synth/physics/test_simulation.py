"""Simulations: people follow their motions, stop at each other, and are where the labels say."""

import json

import mujoco
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from dmae.data.skeleton import SKELETONS
from synth.errors import FailedSimulation
from synth.motion.config import MotionConfig
from synth.people.body import SEGMENTS, SKELETON, Body, landmarks
from synth.physics.simulation import assess, record_overlaps, simulate
from synth.scene.build import build_scene
from synth.scene.config import SceneConfig
from synth.scene.sampling import sample_scene
from synth.scene.spec import PropSpec
from tests.support.scenes import BODY, RIG, gliding, scene

OTHER = Body(1.65, 60, 1.0)
HIPS = SKELETON.index("body25.mid_hip")[0]


@pytest.fixture(scope="module")
def head_on():
    """Two people who glide straight at each other at 1 m/s and meet half way through, neither stepping aside."""
    motions = [gliding(BODY, 30, (-0.7, 0), (1, 0)), gliding(OTHER, 30, (0.7, 0.05), (-1, 0))]
    with pytest.MonkeyPatch.context() as patch:
        # Gliding people slide.
        patch.setattr("synth.physics.simulation._MOST_SLIDE", 1.0)
        return motions, simulate(scene([BODY, OTHER], 30), RIG, motions)


@pytest.fixture(scope="module")
def crowd():
    """Four people of a sampled scene."""
    spec = sample_scene(SceneConfig(persons=[4, 4], seconds=2.0, gathering=0.3), MotionConfig(), seed=1, clip=0).spec
    return spec, simulate(spec, RIG)


def test_people_who_collide_do_not_pass_through_each_other(head_on):
    motions, simulation = head_on
    passed = motions[0].root[-1, 0] - motions[1].root[-1, 0]
    assert passed > 0.8, "their motions do"
    chests = simulation.joints[:, :, SKELETON.index("body25.neck")[0]]
    assert np.linalg.norm(chests[:, 0] - chests[:, 1], axis=-1).min() > 0.15
    quality = simulation.quality
    assert quality["contact_frames"] >= 8
    assert quality["deep_share"] <= 0.1
    assert quality["penetration_mm"] < 40
    assert quality["shift_m"] > 0.1


def test_penetration_is_measured_between_solid_parts(head_on):
    """The reference is MuJoCo's distance between capsules, from the stored states."""
    _, simulation = head_on
    model, data = simulation.model, mujoco.MjData(simulation.model)
    built = build_scene(scene([BODY, OTHER], 30), RIG)
    solid = [np.flatnonzero((built.geom_persons == p) & (model.geom_contype > 0)) for p in (0, 1)]
    nearest = []
    for state in simulation.qpos[::3]:
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        nearest.append(min(mujoco.mj_geomDistance(model, data, a, b, 0.3, None) for a in solid[0] for b in solid[1]))
    assert -1000 * min(nearest) <= simulation.quality["penetration_mm"] + 1


def test_a_standing_person_stays_in_place():
    motions = [gliding(BODY, 50, (0, 0), (0, 0))]
    simulation = simulate(scene([BODY], 50), RIG, motions)
    assert np.abs(simulation.joints - simulation.joints[0]).max() < 0.01
    assert simulation.quality["tracking_error_mm"] < 10
    assert simulation.quality["contact_frames"] == 0
    assert simulation.joints[-1, 0, :, 2].min() > 0.0


def test_sites_mark_the_joints_of_every_skeleton(crowd):
    _, simulation = crowd
    data = mujoco.MjData(simulation.model)
    data.qpos[:] = simulation.qpos[20]
    mujoco.mj_forward(simulation.model, data)
    for name in ("body25.nose", "shelf14.l_hip"):
        marked = data.site(f"person2/{name}").xpos
        np.testing.assert_allclose(marked, simulation.joints[20, 2, SKELETON.index(name)[0]], atol=1e-9)
    names = {simulation.model.site(i).name for i in range(simulation.model.nsite)}
    assert {f"person0/{name}.{joint}" for name, skeleton in SKELETONS.items() for joint in skeleton.joints} <= names


def test_labels_are_read_from_the_state(crowd):
    spec, simulation = crowd
    model, data = simulation.model, mujoco.MjData(simulation.model)
    frame, person = 20, 2
    data.qpos[:] = simulation.qpos[frame]
    mujoco.mj_forward(model, data)
    segments, points, depth = landmarks(spec.persons[person].body)
    for joint in (0, 4, 12, 22, 30, 38):
        body = data.body(f"person{person}/{SEGMENTS[segments[joint]]}")
        expected = body.xpos + body.xmat.reshape(3, 3) @ points[joint]
        np.testing.assert_allclose(simulation.joints[frame, person, joint], expected, atol=1e-12)
    np.testing.assert_array_equal(simulation.depth[person], depth)


def test_a_crowd_has_good_quality(crowd):
    spec, simulation = crowd
    assert simulation.qpos.shape[0] == spec.frames == 50
    assert simulation.joints.shape == (50, 4, 39, 3)
    quality = simulation.quality
    assert json.loads(json.dumps(quality)) == quality
    assert quality["tracking_error_mm"] < 30
    assert quality["deep_share"] <= 0.1
    assert simulation.joints[..., 2].min() > -0.03
    bones = simulation.joints[:, :, SKELETON.index("body25.l_knee")[0]] - simulation.joints[..., HIPS, :]
    assert np.ptp(np.linalg.norm(bones, axis=-1), axis=0).max() < 0.25


def test_same_spec_same_bytes(crowd):
    spec, simulation = crowd
    again = simulate(spec, RIG)
    assert again.qpos.tobytes() == simulation.qpos.tobytes()
    assert again.joints.tobytes() == simulation.joints.tobytes()
    assert again.quality == simulation.quality


def test_walls_stop_people():
    motions = [gliding(BODY, 35, (4.6, 0), (1, 0))]
    assert motions[0].root[-1, 0] > 5.9, "through the wall at 5.5 m"
    simulation = simulate(scene([BODY], 35), RIG, motions)
    # The annotated top of a head is in the air before it.
    on_the_body = [joint for joint, name in enumerate(SKELETON.joints) if name != "shelf14.top_head"]
    assert simulation.joints[:, :, on_the_body, 0].max() < 5.515
    assert simulation.quality["object_penetration_mm"] < 40
    assert 0.3 < simulation.quality["shift_m"] < 0.8


def test_people_step_around_obstacles():
    drum = PropSpec("drum", (0.8, 0.05), 0.0, (0.5, 0.5, 0.5))
    motions = [gliding(BODY, 50, (-0.5, 0), (1.2, 0))]
    simulation = simulate(scene([BODY], 50, props=[drum], clearance=0.6), RIG, motions)
    assert simulation.joints[-1, 0, HIPS, 0] > 1.6
    assert simulation.quality["shift_m"] < 0.05


def test_motions_must_fit_the_spec():
    with pytest.raises(ValueError, match=r"expected 2 motions of 30 frames, found 1 of \[25\] frames"):
        simulate(scene([BODY, OTHER], 30), RIG, [gliding(BODY, 25, (0, 0), (1, 0))])


def test_overlaps_are_the_deepest_contacts_of_all_steps_to_a_frame():
    """Two balls on a floor: they overlap by 30 mm, then by 10, and the floor by 5; then without contact."""
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom type="plane" size="5 5 .1"/><body><freejoint/><geom size=".1"/></body>'
        '<body><freejoint/><geom size=".1"/></body></worldbody></mujoco>'
    )
    data, overlaps = mujoco.MjData(model), np.full((2, 4), -np.inf)
    for frame, apart, height in ((1, 0.17, 0.2), (1, 0.19, 0.095), (2, 0.19, 0.2), (3, 0.5, 0.5)):
        data.qpos[[0, 7]], data.qpos[[2, 9]] = (0, apart), height
        mujoco.mj_forward(model, data)
        record_overlaps(data, np.array([-1, 0, 1]), overlaps[:, frame])
    people, objects = overlaps
    np.testing.assert_allclose(people, [-np.inf, 0.03, 0.01, -np.inf], atol=1e-9)
    np.testing.assert_allclose(objects, [-np.inf, 0.005, -np.inf, -np.inf], atol=1e-9)


SOLES = SKELETON.index(*(f"body25.{side}_{point}" for side in "lr" for point in ("big_toe", "heel")))


def summary(*, moved: float = 0.0, overlap: float = -np.inf, shift: float = 0.0, slides=(), floor=SOLES):
    """Quality of ten frames of two people; some soles of the first slide at 0.3 m/s in half of the frames."""
    joints = np.zeros((10, 2, 39, 3))
    joints[..., 2] = 1.0
    joints[:, 0, floor, 2] = 0.016
    wanted = joints.copy()
    joints[5:, 0, slides, 0] = 0.012 * np.arange(1, 6)[:, None]
    overlaps = np.array([np.full(10, overlap), np.full(10, -np.inf)])
    return assess(joints + moved, wanted, overlaps, np.full((10, 2, 2), shift / np.sqrt(2)), 25.0, 0.012345)


def test_quality_reports_what_happened():
    quality = summary(moved=0.01, overlap=0.03, shift=0.5)
    assert quality["tracking_error_mm"] == pytest.approx(10 * np.sqrt(3), abs=0.01)
    assert (quality["contact_frames"], quality["penetration_mm"], quality["deep_share"]) == (10, 30, 0)
    assert quality["shift_m"] == pytest.approx(0.5)
    assert quality["beyond_limits"] == 0.0123
    assert summary()["contact_frames"] == 0


@pytest.mark.parametrize(
    ("happened", "message"),
    [
        ({"overlap": 0.05}, "contact frames with overlaps above 40 mm: 1, at most 0.1"),
        ({"shift": 2.0}, "push off the planned path, m: 2,"),
        ({"moved": -0.4}, "median tracking error, mm: 693"),
        ({"moved": np.nan}, "median tracking error, mm: nan"),
        ({"slides": SOLES}, "share of the time in which standing feet slide: 0.278, at most 0.1"),
    ],
)
def test_unfit_clips_are_refused(happened, message):
    with pytest.raises(FailedSimulation, match=message):
        summary(**happened)


def test_a_solver_that_fails_is_reported(monkeypatch):
    def explode(model, data, steps):
        data.qpos[:] = np.nan

    monkeypatch.setattr("synth.physics.simulation.mujoco.mj_step", explode)
    with pytest.raises(FailedSimulation, match="the solver failed at 0"):
        simulate(scene([BODY], 5), RIG, [gliding(BODY, 5, (0, 0), (1, 0))])


@pytest.mark.parametrize(
    ("slides", "floor", "share"),
    [
        (SOLES, SOLES, 5 / 18),
        (SOLES[:2], SOLES, 5 / 18),
        (SOLES[:1], SOLES, 0),
        (SOLES[:1], SOLES[:1], 5 / 18),
        (SOLES[:1], SOLES[1:], 0),
        ((), SOLES, 0),
    ],
    ids=["both feet", "one flat foot", "a toe of a foot that stands", "the only toe", "a foot in the air", "nothing"],
)
def test_the_definition_of_a_foot_slide(slides, floor, share, monkeypatch):
    monkeypatch.setattr("synth.physics.simulation._MOST_SLIDE", 1.0)
    assert summary(slides=list(slides), floor=list(floor))["foot_slide"] == pytest.approx(share, abs=1e-4)


def test_a_person_who_is_pushed_keeps_standing_feet_in_place():
    """One person glides into the back of another: the hips move more than the feet."""
    motions = [gliding(BODY, 25, (0, 0), (0, 0)), gliding(OTHER, 25, (-0.5, 0.25), (0.45, 0))]
    simulation = simulate(scene([BODY, OTHER], 25), RIG, motions)
    moved = np.linalg.norm(simulation.joints[:, 0, :, :2] - simulation.joints[:1, 0, :, :2], axis=-1).max(0)
    assert simulation.quality["contact_frames"] > 3
    assert moved[SKELETON.index("body25.neck")[0]] > 0.02
    assert moved[SOLES].max() < 0.015


@pytest.fixture(scope="module")
def at_rates():
    """Joints of the same clip at several frame rates."""
    return {
        fps: simulate(
            sample_scene(SceneConfig(persons=[2, 2], seconds=2.1, fps=fps), MotionConfig(), seed=3, clip=0).spec, RIG
        )
        for fps in (4.0, 20.0, 24.0, 25.0, 50.0)
    }


@pytest.mark.parametrize("fps", [4.0, 20.0, 24.0, 25.0])
def test_the_frame_rate_does_not_change_the_motion(at_rates, fps):
    fine, found = at_rates[50.0].joints, at_rates[fps].joints
    assert len(found) == max(1, round(2.1 * fps))
    times = np.arange(len(found)) / fps
    common = np.isclose(times * 50, np.round(times * 50)) & (times * 50 <= len(fine) - 1)
    assert common.sum() >= 3
    assert np.abs(found[common] - fine[np.round(times[common] * 50).astype(int)]).max() < 0.003
    # Between the frames, too.
    within = times < (len(fine) - 2) / 50
    expected = CubicSpline(np.arange(len(fine)) / 50, fine)(times[within])
    assert np.abs(found[within] - expected).max() < 0.01


def test_clips_are_judged_equally_at_every_frame_rate(at_rates):
    qualities = [simulation.quality for simulation in at_rates.values()]
    for quality in qualities:
        assert quality == pytest.approx(qualities[0], abs=0.02)


def test_a_clip_shorter_than_a_planned_frame_has_all_its_frames():
    spec = sample_scene(SceneConfig(persons=[1, 1], seconds=0.03, fps=100.0), MotionConfig(), seed=3, clip=0).spec
    assert spec.planned_frames == 1
    joints = simulate(spec, RIG).joints
    assert len(joints) == 3
    assert np.abs(joints - joints[0]).max() < 0.02
