"""Support of people: analytic motions, MuJoCo's own contacts, and the balance of weight at rest."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from synth.labels.forces import ContactSource, Places, carry, movement, needed_forces, owners, smoothed, solve
from synth.people.body import SEGMENTS
from synth.physics.simulation import simulate
from synth.scene.build import build_scene
from tests.support.scenes import BODY, RIG, gliding, scene
from tests.support.simulated_interactions import played

FPS, G = 25.0, 9.81


def places(points, friction=0.8, gap=0.0) -> Places:
    points = np.array(points, float)
    count = len(points)
    up = np.tile((0.0, 0.0, 1.0), (count, 1))
    zeros = np.zeros(count)
    return Places(zeros.astype(int), np.zeros((count, 2), int), points, up, zeros + friction, zeros + gap, zeros)


def test_forces_of_a_tumbling_body_are_those_of_newton_and_euler():
    """The reference is MuJoCo's simulation under a known force and torque."""
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option timestep="0.002" integrator="RK4"/><worldbody><body><freejoint/>'
        '<geom type="box" size=".1 .2 .3" mass="7"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    data.qvel[3:] = 1.0, 0.5, -0.3
    found, applied = [], []
    for step in range(1000):
        # Slower than 6 Hz.
        push = np.array((5 * np.sin(step / 100), 3, 60)), np.array((0.2, 0.3 * np.cos(step / 80), -0.1))
        data.xfrc_applied[1] = np.concatenate(push)
        if step % 10 == 0:
            mujoco.mj_forward(model, data)
            found.append((data.xipos[1:].copy(), data.ximat[1:].reshape(-1, 3, 3).copy()))
            applied.append(np.concatenate(push))
        mujoco.mj_step(model, data)
    moved, turned = (np.array(part) for part in zip(*found, strict=True))
    _, force, moment = needed_forces(model, movement(model, moved, turned, np.array([1]), 50), np.array([1]))
    inner = slice(15, -15)
    np.testing.assert_allclose(force[inner], np.array(applied)[inner, :3], atol=0.6)
    np.testing.assert_allclose(moment[inner], np.array(applied)[inner, 3:], atol=0.05)


def test_motion_up_to_the_frequency_of_steps_is_kept():
    times = np.arange(200) / FPS
    for hertz, least in ((1, 0.97), (2, 0.95), (4, 0.85)):
        wave = np.sin(2 * np.pi * hertz * times)
        found = np.abs(smoothed(wave, FPS, 2)[50:150]).max() / (2 * np.pi * hertz) ** 2
        assert least < found < 1.06
    assert np.abs(smoothed(np.sin(2 * np.pi * 11 * times), FPS)[50:150]).max() < 0.05


def test_weight_between_two_feet_is_shared_by_the_lever():
    feet = places([(0, 0.3, 0), (0, -0.1, 0)])
    forces = solve(feet, np.arange(2), np.array((0.0, 0.0, 1.0)), np.array((0, 0, 700.0, 0, 0, 0)), 700.0)
    np.testing.assert_allclose(forces[:, 2], (175, 525), rtol=2e-3)


def test_feet_push_within_the_cone_of_friction_and_never_pull():
    feet = places([(0, 0.1, 0), (0, -0.1, 0)], friction=0.5)
    centre = np.array((0.0, 0.0, 1.0))
    along = solve(feet, np.arange(2), centre, np.array((900.0, 0, 700.0, 0, 0, 0)), 700.0)
    assert (np.linalg.norm(along[:, :2], axis=1) <= 0.5 * along[:, 2] + 1e-9).all()
    pulled = solve(feet, np.arange(2), centre, np.array((0, 0, -300.0, 0, 0, 0)), 700.0)
    np.testing.assert_allclose(pulled, 0, atol=1e-6)
    assert solve(feet, np.arange(0), centre, np.zeros(6), 700.0).shape == (0, 3)


@pytest.fixture(scope="module")
def walker():
    """A person who glides over the floor and one who stands still, 3 m apart."""
    motions = [gliding(BODY, 50, (-1.0, 1.5), (1, 0)), gliding(BODY, 50, (0, -1.5), (1e-6, 0))]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("synth.physics.simulation._MOST_SLIDE", 1.0)
        simulation = simulate(scene([BODY, BODY], 50), RIG, motions, painted=False)
    return build_scene(scene([BODY, BODY], 50), RIG, painted=False), simulation


def test_a_person_at_rest_presses_on_the_floor_with_their_weight(walker):
    built, simulation = walker
    contacts, forces = carry(built, simulation.state, FPS)
    weight = forces.weights[1]
    assert weight == pytest.approx(BODY.mass * G, rel=1e-6)
    feet = forces.ground_reaction[10:-10, 1].sum(1)
    np.testing.assert_allclose(feet[:, 2], weight, rtol=0.01)
    # The same by adding up contacts.
    mine = (contacts.persons[:, 1] == 1) & (contacts.frame == 25)
    assert contacts.force[mine].sum(0)[2] == pytest.approx(weight, rel=0.01)
    assert {contacts.names[n] for n in contacts.between[mine, 0]} == {"floor"}
    # Where they press is below the centre of mass.
    pressure = np.nansum(forces.centre_of_pressure[25, 1] * forces.ground_reaction[25, 1, :, 2:] / feet[15, 2], axis=0)
    np.testing.assert_allclose(pressure[:2], forces.centre_of_mass[25, 1, :2], atol=0.05)


def test_contacts_and_residual_add_up_to_what_the_motion_needs(walker):
    built, simulation = walker
    _, forces = carry(built, simulation.state, FPS)
    total = (forces.supported + forces.residual)[:, :, 0]
    inner = slice(5, -5)
    mass = forces.weights / G
    accelerations = total / mass[:, None] - (0, 0, G)
    change = np.diff(forces.centre_of_mass, 2, axis=0) * FPS**2
    np.testing.assert_allclose(accelerations[1:-1][inner], change[inner], atol=0.5)


def lifted(state, height: float):
    """The state with the person who stands still higher."""
    qpos, root = state.qpos.copy(), state.root.copy()
    qpos[:, 3 + 4 * len(SEGMENTS) + 2] += height
    root[:, 1, 2] += height
    return replace(state, qpos=qpos, root=root)


def test_feet_that_hover_by_millimetres_bear_their_person(walker):
    built, simulation = walker
    _, forces = carry(built, lifted(simulation.state, 0.006), FPS)
    borne = forces.ground_reaction[10:-10, 1].sum(1)
    np.testing.assert_allclose(borne[:, 2], forces.weights[1], rtol=0.01)


def test_what_hangs_in_the_air_has_a_residual_of_its_weight(walker):
    built, simulation = walker
    _, forces = carry(built, lifted(simulation.state, 0.5), FPS)
    np.testing.assert_allclose(forces.residual[10:-10, 1, 0, 2], forces.weights[1], rtol=0.02)
    assert np.abs(forces.ground_reaction[:, 1]).max() == 0
    assert np.isnan(forces.centre_of_pressure[:, 1]).all()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["circle_talk", "counter", "table", "hug", "huddle", "pass_box"])
def test_forces_and_weight_balance_within_2_percent_where_people_rest(kind):
    """Resting: the centre of mass hardly accelerates for half a second, and something bears the person."""
    spec, simulation = played(kind)
    built = build_scene(spec, RIG, painted=False)
    contacts, forces = carry(built, simulation.state, spec.fps)
    speed = np.gradient(forces.centre_of_mass, 1 / spec.fps, axis=0)
    change = np.linalg.norm(np.gradient(speed, 1 / spec.fps, axis=0), axis=-1)
    span = round(0.5 * spec.fps)
    rests = np.array([(change[f : f + span] < 0.5).all(0) for f in range(len(change) - span + 1)])
    assert rests.any(), "no person rests"
    for first, person in np.argwhere(rests):
        held = forces.supported[first : first + span, person, 0, 2].mean()
        assert held == pytest.approx(forces.weights[person], rel=0.02), (kind, first, person)
    for contact in ContactSource:
        if contact == ContactSource.HELD:
            assert (contacts.source == contact).any() == (kind == "pass_box")


def test_frames_too_far_apart_are_refused(walker):
    built, simulation = walker
    with pytest.raises(ValueError, match="12 frames per second or more, found 4"):
        carry(built, simulation.state, 4.0)


def test_bodies_of_the_model_are_in_the_order_of_segments(walker):
    built, _ = walker
    first = built.model.body(f"person1/{SEGMENTS[0]}").id
    assert [built.model.body(first + k).name for k in range(16)] == [f"person1/{name}" for name in SEGMENTS]


def test_owners_are_numbers_of_persons_and_none_for_objects():
    names = ["person2/l_foot", "floor", "personal_desk", "person10/r_hand"]
    np.testing.assert_array_equal(owners(names), [2, -1, -1, 10])


@pytest.mark.parametrize("name", ["person1e18/l_foot", "personNaN/l_foot", "person/l_foot", "person-1/l_foot"])
def test_names_of_persons_without_a_number_are_refused(name):
    with pytest.raises(ValueError, match=r"contacts: name .* expected person<number>/<segment>"):
        owners([name])
