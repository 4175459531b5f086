"""Hands that change in a clip have the shapes of hands that keep still, and change with what people do."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from dmae.data.labels import Visibility
from dmae.formats.rig import intrinsics
from synth.datasets.clip import generate_clip
from synth.datasets.config import GenerateConfig
from synth.interactions.registry import InteractionConfig
from synth.labels.visibility import joint_visibility
from synth.motion.config import MotionConfig
from synth.people.body import Body
from synth.people.clothing import sample_looks
from synth.people.hands import SHAPES, HandChange, sample_changes, uses_of
from synth.people.mjcf import add_person
from synth.people.skinning import Skin
from synth.people.surface import bare_body
from synth.rendering.config import ImageQuality
from synth.rendering.renderer import Renderer, render_images
from synth.rigs.lenses import add_cameras
from synth.rigs.placement import aimed
from synth.scene.config import Hands, SceneConfig
from synth.scene.sampling import sample_scene
from synth.scene.spec import SceneSpec

BODY, LOOKS = Body(), sample_looks(0.0, rng=np.random.default_rng(0))
OPENS = tuple(HandChange(side, at, 0.3, shape) for at, shape in ((-1.0, "open"), (1.0, "fist")) for side in "lr")


def modelled(changes=(), rig=None, **looks) -> mujoco.MjModel:
    spec = mujoco.MjSpec()
    if rig:
        add_cameras(spec, rig)
    add_person(spec, 0, BODY, replace(LOOKS, **looks), changes, position=(0, 0, BODY.hip_height), rng=None)
    return spec.compile()


def skin_at(model: mujoco.MjModel, seconds: float) -> np.ndarray:
    """The vertices (N, 3) of skin that bends, world, m."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    skin = Skin(model)
    skin.apply(data, seconds)
    found = []
    for geom in skin.geoms:
        mesh = model.geom_dataid[geom]
        own = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
        found.append(data.geom_xpos[geom] + own @ data.geom_xmat[geom].reshape(3, 3).T)
    return np.concatenate(found)


@pytest.mark.parametrize("shape", ["relaxed", "open", "grip", "clasp"])
def test_moving_hands_have_the_shapes_of_still_ones(shape):
    still = skin_at(modelled(hands=(shape, shape)), 0.0)
    moving = skin_at(modelled([HandChange(side, -1.0, 0.3, shape) for side in "lr"]), 0.0)
    away = np.linalg.norm(moving - still, axis=1)
    assert away.max() < 1e-3
    assert np.percentile(away, 99) < 2e-4


def test_fingers_keep_their_size_as_they_close():
    model = modelled(OPENS)
    faces = model.mesh_face  # of one mesh after the other
    hands = [m for m in range(model.nmesh) if "_hand/skin" in model.mesh(m).name]
    edges = {}
    for seconds in (0.0, 1.1, 1.15, 1.2, 1.4):
        skin_at(model, seconds)
        own = [faces[model.mesh_faceadr[m] :][: model.mesh_facenum[m]] + model.mesh_vertadr[m] for m in hands]
        corners = model.mesh_vert[np.concatenate(own)]
        edges[seconds] = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1)
    for seconds in (1.1, 1.15, 1.2, 1.4):
        ratio = edges[seconds] / edges[0.0]
        assert abs(np.median(ratio) - 1) < 0.01
        assert np.percentile(np.abs(ratio - 1), 90) < 0.35, seconds


@pytest.mark.parametrize("shape", ["fist", "point"])
def test_the_thumb_lies_over_bent_fingers(shape):
    fingers = bare_body(BODY, None).fingers
    _, begins = fingers.posed(np.tile(SHAPES[shape], (2, 1, 1)))
    depth = np.einsum("hfki,hi->hfk", begins, fingers.down)
    assert (depth[:, 0, 2] > depth[:, 2, 2] + 0.01).all(), "the thumb's last joint is farther from the palm"


def test_a_hand_that_grips_opens_on_the_way():
    share = np.interp(np.arange(100), (20, 40, 60, 80), (0, 1, 1, 0))
    opens, grips = uses_of("l", share, ("grip",))
    assert (opens.shapes, grips.shapes) == (("open",), ("grip",))
    assert 20 < opens.begin < grips.begin <= 40 < 60 <= grips.end < opens.end < 80
    assert [use.shapes for use in uses_of("r", share, ("fist",))] == [("fist",)]
    changes = sample_changes(("fist", "point"), [opens, grips], 100, 25, rng=np.random.default_rng(0))
    first, *left = [change for change in changes if change.side == "l"]
    assert first.at < 0 and first.shape == "fist"
    needed = [change for change in left if opens.begin / 25 <= change.at <= opens.end / 25]
    assert [change.shape for change in needed] == ["open", "grip", "open", "relaxed"]
    assert all(0.2 <= change.over <= 0.4 for change in changes)
    assert next(change.shape for change in changes if change.side == "r") == "relaxed", "nobody points at nothing"


@pytest.mark.parametrize(
    ("kind", "shapes"),
    [
        ("fight", {"fist"}),
        ("handshake", {"clasp", "open"}),
        ("hug", {"open"}),
        ("table", {"open"}),
        ("dance", {"clasp"}),
    ],
)
def test_people_use_their_hands_together(kind, shapes):
    spec = sample_scene(
        SceneConfig(seconds=4.0), MotionConfig(), interaction=InteractionConfig(kind), seed=1, clip=0
    ).spec
    for person in spec.persons:
        assert shapes <= {change.shape for change in person.hands if change.share == 1}


@pytest.mark.parametrize(("action", "shape"), [("wave", "open"), ("lift", "grip"), ("punch", "fist")])
def test_people_use_their_hands_alone(action, shape):
    motion = MotionConfig(actions=[action])
    spec = sample_scene(SceneConfig(seconds=6.0, persons=[1, 1]), motion, seed=1, clip=0).spec
    assert shape in {change.shape for change in spec.persons[0].hands if change.share == 1}


def test_still_hands_keep_one_shape_and_nothing_else_differs():
    config = GenerateConfig(seed=11, scene=SceneConfig(seconds=1.0, persons=[2, 2]))
    moving = generate_clip(config, 0)
    still = generate_clip(replace(config, scene=replace(config.scene, hands=Hands.still)), 0)
    np.testing.assert_array_equal(moving.truth.xyz, still.truth.xyz)
    one, other = SceneSpec.of(moving), SceneSpec.of(still)
    assert all(person.hands for person in one.persons)
    assert replace(one, persons=tuple(replace(person, hands=()) for person in one.persons)) == other


def test_a_clip_from_before_hands_moved_is_read():
    spec = sample_scene(SceneConfig(seconds=1.0, hands=Hands.still), MotionConfig(), seed=0, clip=0).spec
    assert SceneSpec.from_json(spec.to_json().replace(', "hands": []', "")) == spec
    with pytest.raises(ValueError, match="a shape of relaxed, open"):
        HandChange("l", 0.0, 0.3, "paw")


def test_an_open_hand_hides_what_a_fist_does_not():
    model = modelled(OPENS)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    ids = np.array([np.uint16(model.geom_group[g] < 3) for g in range(model.ngeom)])
    below = data.xpos[model.body("person0/l_hand").id] + (0, 0.15, -0.1)
    rig = aimed(["above"], intrinsics(100.0, [64, 64]), below[None] + (0.05, 0, 2), below, [64, 64])
    states, places = np.tile(model.qpos0, (2, 1)), np.tile(below, (2, 1, 1, 1))
    seen = joint_visibility(model, states, places, np.zeros((1, 1)), ids, rig, seconds=np.array([0.0, 2.0]))
    assert seen.visibility.ravel().tolist() == [Visibility.HIDDEN_BY_SELF, Visibility.VISIBLE]


def test_images_and_flow_show_the_hands_of_each_frame(tmp_path):
    model = modelled(OPENS)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    ids = np.array([np.uint16(model.geom_group[g] < 3) for g in range(model.ngeom)])
    hand = data.xpos[model.body("person0/l_hand").id] + (0, 0.12, 0)
    rig = aimed(["above"], intrinsics(150.0, [64, 64]), hand[None] + (0.05, 0, 0.6), hand, [64, 64])
    model, states = modelled(OPENS, rig), np.tile(model.qpos0, (2, 1))
    with Renderer(model, ids, rig, ImageQuality.draft) as renderer:
        images, visible, amodal = render_images(renderer, states, rig, tmp_path, 0.5, ("ids", "flow"))
    np.testing.assert_array_equal(visible, amodal)
    opened, closed = visible[:, 0, 0]
    assert closed < 0.85 * opened
    flow = images.at("flow", "above", 0)
    fingers = (images.at("ids", "above", 0) == 1) & (images.at("ids", "above", 1) == 0)
    assert np.linalg.norm(flow[fingers], axis=-1).mean() > 5
