"""All interactions: usable, deterministic, with every source of motion, and each with its characteristic features."""

import copy
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from synth.datasets.clip import generate_clip
from synth.datasets.config import GenerateConfig
from synth.errors import FailedSimulation
from synth.interactions import casting
from synth.interactions.registry import NO_INTERACTION, InteractionConfig, find_interaction, interaction_choices
from synth.labels.forces import simulated_contacts
from synth.motion.config import MotionConfig
from synth.motion.source import read_take
from synth.people.body import SKELETON
from synth.people.skinning import Skin, mesh_triangles
from synth.physics.simulation import simulate
from synth.rooms.props import prop_size
from synth.scene.build import build_scene
from synth.scene.sampling import lay_out, load_motions, sample_people, sample_scene
from synth.scene.spec import SceneSpec
from tests.support.scenes import RIG
from tests.support.simulated_interactions import (
    MID_HIP,
    RECORDED,
    SCENE,
    apart,
    facing,
    hips,
    palms,
    played,
    sampled,
    spec_of,
)
from tests.support.smpl_files import write_smpl

KINDS = [kind for kind in interaction_choices() if kind != NO_INTERACTION]


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_clips_are_fit_for_use_and_deterministic(kind):
    spec, simulation = played(kind)
    quality = simulation.quality
    least, most = find_interaction(kind).persons
    assert least <= len(spec.persons) <= most
    assert quality["tracking_error_mm"] <= 30
    # No overlap above 20 mm in any contact frame.
    assert quality["penetration_mm"] <= 20
    assert quality["foot_slide"] <= 0.03
    assert SceneSpec.from_json(spec.to_json()) == spec == spec_of(kind)
    for one, other in zip(load_motions(spec), load_motions(SceneSpec.from_json(spec.to_json())), strict=True):
        np.testing.assert_array_equal(one.root, other.root)
        np.testing.assert_array_equal(one.rotations, other.rotations)
    assert np.linalg.norm(hips(simulation), axis=-1).max() < SCENE.radius + 0.6


@pytest.fixture(scope="module")
def takes(data_folder, tmp_path_factory) -> dict[str, Path]:
    """A take of every kind of motion file."""
    found = {kind: data_folder / "cmu" / name for kind, name in RECORDED.items()}
    found["npz"] = tmp_path_factory.mktemp("npz") / "02_01.npz"
    write_smpl(found["npz"], read_take(found["amc"]))
    return found


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("source", [*RECORDED, "npz"])
def test_recorded_motions_follow_every_script(kind, source, takes):
    motion = MotionConfig(kind=source, path=str(takes[source]))
    spec, motions = sampled(kind, motion, replace(SCENE, seconds=1.2, persons=[2, 2]))
    simulation = simulate(spec, RIG, motions, painted=False)
    assert all(takes[source].stem in person.motion for person in spec.persons)
    assert simulation.quality["tracking_error_mm"] <= 30
    assert simulation.quality["penetration_mm"] <= 40


def test_all_people_cross_the_middle():
    _, simulation = played("crossing")
    paths = hips(simulation)
    middle = paths.mean((0, 1))
    nearest = np.linalg.norm(paths - middle, axis=-1)
    assert (nearest.min(0) < 0.6).all()
    assert np.ptp(nearest.argmin(0)) / 25 < 1.6
    walked = paths[-1] - paths[0]
    headings = walked / np.linalg.norm(walked, axis=-1, keepdims=True)
    assert np.linalg.norm(headings.mean(0)) < 0.5


def test_people_who_walk_together_stay_together():
    _, simulation = played("walking_together")
    paths = hips(simulation)
    assert np.linalg.norm(paths[-1] - paths[0], axis=-1).min() > 1.0
    nearest = apart(paths).min(-1)
    assert 0.35 < nearest.min() < nearest.max() < 1.2


def test_a_queue_moves_up():
    _, simulation = played("queue")
    paths = hips(simulation)
    before = np.linalg.norm(np.diff(paths[0], axis=0), axis=-1)
    assert ((before > 0.5) & (before < 0.9)).all()
    assert np.linalg.norm(paths[-1, 1] - paths[0, 0]) < 0.15
    assert np.linalg.norm(paths[-1, 0] - paths[0, 0]) > 0.8


def test_people_in_a_circle_look_inward_and_gesture():
    spec, simulation = played("circle_talk")
    paths = hips(simulation)
    middle = paths.mean(1, keepdims=True)
    radius = np.linalg.norm(paths - middle, axis=-1)
    assert 0.4 < radius.min() < radius.max() < 1.0
    inward = (middle - paths) / radius[..., None]
    assert ((facing(spec, simulation) * inward).sum(-1) > 0.7).all()
    raised = np.maximum(*(palms(spec, simulation, side)[..., 2] for side in "lr"))
    assert (raised.max(0) > 1.05).any()


def test_hands_meet_and_part_in_a_handshake():
    spec, simulation = played("handshake")
    right = palms(spec, simulation, "r")
    distance = np.linalg.norm(right[:, 0] - right[:, 1], axis=-1)
    assert (distance < 0.05).sum() / 25 >= 0.3
    assert distance[0] > 0.6
    assert distance[-1] > 0.2
    assert simulation.quality["contact_frames"] > 5
    ahead = facing(spec, simulation)[40]
    assert ahead[0] @ ahead[1] < -0.9


def test_a_huddle_is_a_ring_with_arms_on_backs():
    spec, simulation = played("huddle")
    paths = hips(simulation)[-1]
    radius = np.linalg.norm(paths - paths.mean(0), axis=-1)
    assert len(spec.persons) == 6
    assert 0.4 < radius.min() < radius.max() < 0.8
    for side in "lr":
        hands = palms(spec, simulation, side)[-1]
        necks = simulation.joints[-1, :, SKELETON.index("body25.neck")[0]]
        own = np.linalg.norm(hands - necks, axis=-1)
        others = (np.linalg.norm(hands[:, None] - necks, axis=-1) + 9 * np.eye(6)).min(1)
        assert (others < own).all()
        assert np.median(others) < 0.35


def test_arms_go_around_the_other_person_in_a_hug():
    spec, simulation = played("hug")
    assert apart(hips(simulation))[-1].min() < 0.45
    hands, ahead = palms(spec, simulation, "r")[-1], facing(spec, simulation)[-1]
    for person, other in ((0, 1), (1, 0)):
        chest = simulation.joints[-1, other, SKELETON.index("body25.neck")[0]]
        # Behind the front of the other person.
        assert (hands[person] - chest)[:2] @ ahead[other] < 0.12
        assert np.linalg.norm(hands[person] - chest) < 0.4


def gaps_in_contact(simulation) -> np.ndarray:
    """(C,) distance between the surfaces of two people at each point where they touch, mm; below 0 for an overlap."""
    model, state, gaps = copy.copy(simulation.model), simulation.state, []
    data, skin, touching = mujoco.MjData(model), Skin(model), simulated_contacts(simulation, state)
    between = np.flatnonzero((touching.persons >= 0).all(1) & (touching.persons[:, 0] != touching.persons[:, 1]))
    for frame in np.unique(touching.frame[between])[::4]:
        data.qpos[:] = state.qpos[frame]
        mujoco.mj_kinematics(model, data)
        skin.apply(data, frame / simulation.fps)
        surfaces = []
        for person in skin.persons:
            turns, places = data.geom_xmat[person.geoms].reshape(-1, 3, 3), data.geom_xpos[person.geoms]
            shapes = zip(model.geom_dataid[person.geoms], turns, places, strict=True)
            parts = [
                (model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]] @ turn.T + place,
                 model.mesh_normal[model.mesh_normaladr[mesh] :][: model.mesh_vertnum[mesh]] @ turn.T)
                for mesh, turn, place in shapes
            ]  # fmt: skip
            surfaces.append([np.concatenate(each) for each in zip(*parts, strict=True)])
        for contact in between[touching.frame[between] == frame]:
            point, gap = touching.point[contact], 0.0
            for person in touching.persons[contact]:
                vertices, normals = surfaces[person]
                near = np.linalg.norm(vertices - point, axis=1).argmin()
                gap += (point - vertices[near]) @ normals[near]
            gaps.append(1000 * gap)
    return np.array(gaps)


@pytest.mark.parametrize("kind", ["hug", "huddle"])
def test_surfaces_of_people_in_contact_meet(kind):
    """Solid parts of `scene.solids=plain` leave a median of 8 mm, and a tenth overlaps by 20 mm."""
    gaps = gaps_in_contact(played(kind)[1])
    assert len(gaps) > 50
    assert abs(np.median(gaps)) < 5
    assert np.percentile(gaps, 10) > -16


def test_sparring_partners_punch_at_arms_length():
    spec, simulation = played("fight")
    distance = apart(hips(simulation)).min((1, 2))
    assert 0.7 < distance.min() < distance.max() < 1.5
    noses = simulation.joints[:, :, SKELETON.index("body25.nose")[0]]
    reach = np.min(
        [np.linalg.norm(palms(spec, simulation, side) - noses[:, ::-1], axis=-1) for side in "lr"], axis=(0, 2)
    )
    # Knuckles are 50 mm beyond the palm: a blow that lands on the face leaves that.
    assert 0.03 < reach.min() < 0.45 < reach.max()


def test_the_counter_is_between_its_two_sides():
    spec, simulation = played("counter")
    (board,) = spec.furniture
    across = (hips(simulation) - board.at) @ (np.cos(board.yaw), np.sin(board.yaw))
    behind = -(-len(spec.persons) // 2)
    assert (across[:, :behind] < -0.3).all()
    assert (across[:, behind:] > 0.3).all()
    hands = np.concatenate([palms(spec, simulation, side)[-1] for side in "lr"])
    assert (np.abs(hands[:, 2] - 1.06) < 0.06).sum() >= len(spec.persons)


def test_people_sit_on_their_stools():
    spec, simulation = played("table")
    stools = np.array([thing.at for thing in spec.furniture[1:]])
    assert np.linalg.norm(hips(simulation) - stools, axis=-1).max() < 0.12
    height = simulation.joints[:, :, MID_HIP, 2]
    assert 0.45 < height.min() < height.max() < 0.7
    knees = simulation.joints[:, :, SKELETON.index("body25.l_knee")[0], 2]
    assert np.abs(knees - height).max() < 0.16


def test_the_surface_of_seated_people_meets_their_stools():
    spec, simulation = played("table")
    model, top = copy.copy(simulation.model), float(prop_size("stool").reach[2])
    data = mujoco.MjData(model)
    data.qpos[:] = simulation.qpos[-1]
    mujoco.mj_kinematics(model, data)
    Skin(model).apply(data)
    for person, stool in enumerate(spec.furniture[1:]):
        bodies = [model.body(f"person{person}/{segment}").id for segment in ("pelvis", "l_thigh", "r_thigh")]
        drawn = np.flatnonzero(np.isin(model.geom_bodyid, bodies) & (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH))
        places = [mesh_triangles(model, g) @ data.geom_xmat[g].reshape(3, 3).T + data.geom_xpos[g] for g in drawn]
        surface = np.concatenate(places).reshape(-1, 3)
        over = np.linalg.norm(surface[:, :2] - stool.at, axis=1) < prop_size("stool").reach[0]
        assert abs(surface[over, 2].min() - top) < 0.012, person


def test_a_couple_holds_hands_and_turns():
    spec, simulation = played("dance")
    held = np.linalg.norm(palms(spec, simulation, "l")[:, 0] - palms(spec, simulation, "r")[:, 1], axis=-1)
    assert np.median(held) < 0.07
    ahead = facing(spec, simulation)
    assert ((ahead[:, 0] * ahead[:, 1]).sum(-1) < -0.5).all()
    assert ahead[0, 0] @ ahead[-1, 0] < 0.7


def test_a_recorded_couple_dances_as_it_did(data_folder):
    motion = MotionConfig(kind="bvh", path=str(data_folder / "cmu" / "bvh_daz"))
    spec = spec_of("dance", motion)
    takes = sorted(person.motion.split(" ")[0] for person in spec.persons)
    assert takes in (["salsa_05", "salsa_20"], ["salsa_10", "salsa_25"])
    simulation = simulate(spec, RIG, painted=False)
    assert simulation.quality["tracking_error_mm"] <= 30
    distance = apart(hips(simulation)).min((1, 2))
    assert 0.2 < distance.min() < distance.max() < 1.6
    assert simulation.quality["penetration_mm"] <= 40


def test_no_interaction_is_the_default():
    with_none = sample_scene(SCENE, MotionConfig(), interaction=InteractionConfig(), seed=3, clip=0).spec
    assert with_none == sample_scene(SCENE, MotionConfig(), seed=3, clip=0).spec
    assert with_none.furniture == ()


def test_furniture_is_an_object_and_no_obstacle():
    spec = spec_of("table")
    scene = build_scene(spec, RIG, painted=False)
    assert {"furniture0/round_table", "furniture1/stool"} <= set(scene.objects)
    assert len(scene.obstacles) == len(build_scene(replace(spec, furniture=()), RIG, painted=False).obstacles)
    with_things = sample_scene(
        replace(SCENE, props=[3, 3], persons=[]),
        MotionConfig(),
        interaction=InteractionConfig("table"),
        seed=3,
        clip=0,
    ).spec
    for prop in with_things.props:
        gaps = [np.linalg.norm(np.subtract(prop.at, thing.at)) for thing in with_things.furniture]
        assert min(gaps) > 0.3


def test_layouts_move_an_interaction_as_a_whole():
    config = InteractionConfig("handshake")
    scene = replace(SCENE, persons=[])
    people = sample_people(scene, MotionConfig(), config, seed=3, clip=0)
    one, other = (lay_out(people, scene, rng=np.random.default_rng(draw)).spec for draw in range(2))
    assert one.persons[0].start != other.persons[0].start
    gaps = [np.linalg.norm(np.subtract(spec.persons[0].start, spec.persons[1].start)) for spec in (one, other)]
    assert abs(gaps[0] - gaps[1]) < 1e-9


@pytest.mark.parametrize("kind", KINDS)
def test_there_is_space_for_every_interaction_in_the_office(kind):
    spec = spec_of(kind, scene=replace(SCENE, arena="office", seconds=5.0))
    assert len(spec.persons) >= find_interaction(kind).persons[0]


def test_an_interaction_without_space_is_refused():
    with pytest.raises(FailedSimulation, match="no room for what 4 people do together: it strays"):
        spec_of("crossing", scene=replace(SCENE, radius=0.3))


@pytest.mark.parametrize("seconds", [0.04, 0.5])
@pytest.mark.parametrize("kind", KINDS)
def test_the_shortest_clips_have_interactions(kind, seconds, monkeypatch):
    """A frame of each clip is enough for a set of images."""
    shares = []
    reach_for = casting.reach_for

    def spy(motion, body, reach):
        shares.append(reach.share)
        return reach_for(motion, body, reach)

    monkeypatch.setattr(casting, "reach_for", spy)
    scene = replace(SCENE, seconds=seconds, persons=[])
    for motion in sample_scene(scene, MotionConfig(), None, InteractionConfig(kind), seed=0, clip=0).motions:
        assert np.isfinite(motion.root).all()
        assert np.isfinite(motion.rotations).all()
    assert all((share >= 0).all() for share in shares)


def test_a_clip_names_its_interaction(tmp_path):
    config = GenerateConfig(
        out=str(tmp_path),
        seed=3,
        clips=1,
        scene=replace(SCENE, seconds=0.4, persons=[]),
        interaction=InteractionConfig("handshake"),
    )
    clip = generate_clip(config, 0)
    assert clip.provenance["spec"]["interaction"] == {"kind": "handshake", "bystanders": 0}
    assert clip.truth.xyz.shape[1] == 2


@pytest.mark.parametrize(("kind", "persons"), [("huddle", [2, 2]), ("hug", [5, 5]), ("queue", [1, 2])])
def test_a_number_of_people_that_an_interaction_does_not_take_is_refused(kind, persons):
    takes = list(find_interaction(kind).persons)
    with pytest.raises(ValueError, match=rf"interaction={kind} takes {takes[0]}.*give scene.persons=\[{takes[0]}, "):
        sample_scene(replace(SCENE, persons=persons), MotionConfig(), None, InteractionConfig(kind), seed=3, clip=0)


def test_the_number_of_people_is_one_that_is_asked_for():
    for seed in range(4):
        scene = replace(SCENE, persons=[2, 3], seconds=1.0)
        spec = sample_scene(scene, MotionConfig(), None, InteractionConfig("queue"), seed=seed, clip=0).spec
        assert len(spec.persons) == 3, "a queue takes 3 to 6"


def test_bystanders_keep_apart_and_leave_those_who_take_part_as_they_are():
    scene = replace(SCENE, persons=[], seconds=2.0)
    with_none, with_two = (
        sample_scene(scene, MotionConfig(), None, InteractionConfig("hug", count), seed=3, clip=0) for count in (0, 2)
    )
    assert len(with_two.spec.persons) == 4
    assert with_two.spec.persons[:2] == with_none.spec.persons
    simulation = simulate(with_two.spec, RIG, with_two.motions, painted=False)
    alone = simulate(with_none.spec, RIG, with_none.motions, painted=False)
    assert np.abs(simulation.joints[:, :2] - alone.joints).max() < 0.01
    assert apart(hips(simulation))[:, 2:].min() > 0.3
    again = load_motions(SceneSpec.from_json(with_two.spec.to_json()))
    for one, other in zip(with_two.motions, again, strict=True):
        np.testing.assert_array_equal(one.root, other.root)


@pytest.mark.parametrize(
    ("kind", "count", "message"),
    [("none", 2, "there is no interaction"), ("hug", -1, "expected 0 people or more"), ("hug", 29, "30 people in all")],
)
def test_impossible_bystanders_are_refused(kind, count, message):
    with pytest.raises(ValueError, match=message):
        sample_people(replace(SCENE, persons=[]), MotionConfig(), InteractionConfig(kind, count), seed=3, clip=0)
