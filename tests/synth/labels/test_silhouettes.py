"""Pixels of persons, and agreement of their joints' labels with images of ids."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.images import FIRST_OBJECT_ID
from dmae.data.labels import Visibility
from dmae.data.skeleton import BODY25
from synth.errors import FailedSimulation
from synth.labels.surfaces import agreement
from synth.labels.visibility import _limbs, joint_visibility
from synth.motion.config import MotionConfig
from synth.people.body import SEGMENTS, SKELETON
from synth.physics.simulation import simulate
from synth.rendering import opengl
from synth.rendering.config import ImageQuality
from synth.rendering.opengl import find_backend
from synth.rendering.renderer import Renderer, render_images
from synth.scene.config import SceneConfig
from synth.scene.sampling import sample_scene
from tests.support.rigs import preset
from tests.support.standing_people import looking_along_x, scene

pytestmark = pytest.mark.slow

RIG = preset("shelf")


@pytest.fixture(scope="module")
def crowds() -> list:
    """The last state of three scenes of three to five people among the office's furniture."""
    found = []
    for seed in range(20):
        config = SceneConfig(arena="office", persons=[3, 5], seconds=0.4, gathering=0.4)
        try:
            simulation = simulate(sample_scene(config, MotionConfig(), seed=seed, clip=0).spec, RIG)
        except FailedSimulation:
            continue
        last = {
            name: getattr(simulation.state, name)[-1:] for name in ("qpos", "root", "rotations", "forces", "actions")
        }
        found.append(replace(simulation, state=replace(simulation.state, **last), joints=simulation.joints[-1:]))
        if len(found) == 3:
            return found
    pytest.fail("most scenes fail")


def labelled(simulation, folder) -> Clip:
    """The clip of a simulation with nothing detected, its ids rendered as a draft."""
    seen = joint_visibility(
        simulation.model, simulation.qpos, simulation.joints, simulation.depth, simulation.geom_ids, RIG,
        simulation.bodies,
    )  # fmt: skip
    with Renderer(simulation.model, simulation.geom_ids, RIG, ImageQuality.draft) as renderer:
        images, visible, amodal = render_images(renderer, simulation.qpos, RIG, folder, simulation.fps, ("ids",))
    nothing = np.zeros((1, len(RIG), 0, 25))
    return Clip(
        "crowd", simulation.fps, RIG, Detections2D(BODY25, np.stack([nothing] * 2, -1), nothing),
        truth=Poses3D(SKELETON, simulation.joints), images=images,
        occlusion=replace(seen, visible_pixels=visible, amodal_pixels=amodal, objects=simulation.objects),
    )  # fmt: skip


@pytest.mark.slow
def test_images_agree_with_the_labels_of_crowds(painter, crowds, tmp_path):
    compared, agreeing = np.zeros(4, int), np.zeros(4, int)
    shares, hidden = [], []
    for number, simulation in enumerate(crowds):
        clip = labelled(simulation, tmp_path / str(number))
        counts = agreement(clip)
        compared += counts.compared
        agreeing += counts.agreeing
        occlusion = clip.occlusion
        assert (occlusion.visible_pixels <= occlusion.amodal_pixels).all()
        in_image = occlusion.visibility <= Visibility.HIDDEN_BY_OBJECT
        others = (occlusion.visibility > Visibility.HIDDEN_BY_SELF) & in_image
        whole = in_image.sum(-1) > 30
        shares.append(occlusion.visible_fraction[whole])
        hidden.append((others.sum(-1) / np.maximum(in_image.sum(-1), 1))[whole])
    # Each kind of label for itself: visible, hidden by self, by a person, by an object.
    assert (compared > 60).all(), compared
    assert (agreeing >= 0.99 * compared).all(), (agreeing, compared)
    # The more joints of a person others hide, the fewer of their pixels are visible.
    assert np.corrcoef(np.concatenate(shares), np.concatenate(hidden))[0, 1] < -0.9


def test_wrong_labels_do_not_agree_with_images(crowds, tmp_path):
    clip = labelled(crowds[0], tmp_path)
    codes = clip.occlusion.visibility
    wrong = np.where(codes == Visibility.VISIBLE, Visibility.HIDDEN_BY_OBJECT, codes)
    before, after = agreement(clip), agreement(replace(clip, occlusion=replace(clip.occlusion, visibility=wrong)))
    assert after.agreeing.sum() <= before.agreeing.sum() - before.agreeing[0]


def test_a_visible_joint_lies_under_a_part_of_its_limb(painter, crowds):
    on_limb, shown = [], np.zeros(1 + len(SEGMENTS), int)
    for simulation in crowds[:2]:
        model, xy = simulation.model, RIG.project(simulation.joints)[0]
        sight = joint_visibility(
            model, simulation.qpos, simulation.joints, simulation.depth, simulation.geom_ids, RIG, simulation.bodies
        )
        limbs = _limbs(model, simulation.bodies, simulation.bodies.shape)
        persons = range(len(limbs))
        bodies = np.array([[model.body(f"person{p}/{segment}").id for segment in SEGMENTS] for p in persons])
        on_body = np.array([not name.endswith("top_head") for name in SKELETON.joints])
        with Renderer(model, simulation.geom_ids, RIG, ImageQuality.draft) as renderer:
            for view in range(len(RIG)):
                image = renderer.image(simulation.qpos[0], view, ("ids", "parts"))
                in_person = (image.ids > 0) & (image.ids < FIRST_OBJECT_ID)
                np.testing.assert_array_equal(image.parts > 0, in_person)
                shown += np.bincount(image.parts.ravel(), minlength=len(shown))
                person, joint = np.nonzero((sight.visibility[0, view] == Visibility.VISIBLE) & on_body)
                column, row = np.clip(np.round(xy[0, view, person, joint]).astype(int), 0, RIG.size[view] - 1).T
                own = image.ids[row, column] == 1 + person
                under = bodies[person, image.parts[row, column].astype(int) - 1]
                on_limb.append(limbs[person, joint, under][own])
    assert (shown > 0).all()
    on_limb = np.concatenate(on_limb)
    assert len(on_limb) > 200
    # A hand may lie on a hip.
    assert on_limb.mean() > 0.97


@pytest.mark.gl
def test_opengl_and_ray_casting_paint_the_same_parts(crowds, gl):
    simulation, found = crowds[0], []
    for backend in (find_backend, lambda: None):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("synth.rendering.renderer.find_backend", backend)
            with Renderer(simulation.model, simulation.geom_ids, RIG, ImageQuality.standard) as renderer:
                found.append(renderer.image(simulation.qpos[0], 0, ("parts",)).parts)
    drawn, cast = found
    for part in range(1, 1 + len(SEGMENTS)):
        both, either = (
            np.count_nonzero((drawn == part) & (cast == part)),
            np.count_nonzero((drawn == part) | (cast == part)),
        )
        assert both > 0.95 * either - 20, (SEGMENTS[part - 1], both, either)


def test_half_of_a_person_behind_a_wall_is_visible(painter, tmp_path):
    rig = looking_along_x((-4, 0, 1))
    # As wide as half the view, its edge in the plane through the middle of the first man; the second is far to a side.
    wall = '<geom name="wall" type="box" pos="-2 1 1" size=".01 1 3"/>'
    model, ids, _ = scene(rig, [(0, 0), (2, -1.2), (-9, 0)], wall)
    with Renderer(model, ids, rig, ImageQuality.high) as renderer:
        images, visible, amodal = render_images(renderer, model.qpos0[None], rig, tmp_path, 25, ("ids",))
        alone = renderer.alone(model.qpos0, 0, 0)
    assert visible.dtype == amodal.dtype == np.int32
    assert visible[0, 0, 0] / amodal[0, 0, 0] == pytest.approx(0.5, abs=0.01)
    assert visible[0, 0, 1] == amodal[0, 0, 1] > 1000
    # Behind the camera.
    assert visible[0, 0, 2] == amodal[0, 0, 2] == 0
    assert alone.sum() == amodal[0, 0, 0]
    # The man is symmetric, and so is what he covers: his head is 1.65 m up and 0.11 m wide.
    assert abs(alone[:, :320].sum() / alone.sum() - 0.5) < 0.01
    ids_alone = next(images.read("ids", "c0"))
    assert alone[ids_alone == 1].all()


def test_only_requested_kinds_are_painted(painter, tmp_path, monkeypatch):
    rig = looking_along_x((-4, 0, 1))
    model, ids, _ = scene(rig, [(0, 0)])
    with Renderer(model, ids, rig, ImageQuality.draft) as renderer:
        whole = renderer.image(model.qpos0, 0)
        images, _, _ = render_images(renderer, model.qpos0[None], rig, tmp_path / "ids", 25, ("ids",))
        assert sorted(path.name for path in (tmp_path / "ids").iterdir()) == ["ids"]
        assert images.kinds == ("ids",)
    if painter == "gl":
        # A renderer of its own, which does not know yet what is where.
        with Renderer(model, ids, rig, ImageQuality.draft) as renderer:
            reads = []
            read = opengl.OpenGLPainter._read
            monkeypatch.setattr(
                opengl.OpenGLPainter,
                "_read",
                lambda self, *how, **more: reads.append(more.get("identify", False)) or read(self, *how, **more),
            )
            rgb = renderer.image(model.qpos0, 0, ("rgb",))
            ids_only = renderer.image(model.qpos0, 0, ("ids",))
            # Of ids, what stands still and the person; a pose that was drawn is not drawn again.
            assert reads == [False, True, True]
            renderer.image(model.qpos0, 0, ("ids",))
            assert reads == [False, True, True]
            assert rgb.ids is rgb.depth is rgb.parts is ids_only.rgb is None
            np.testing.assert_array_equal(rgb.rgb, whole.rgb)
            np.testing.assert_array_equal(ids_only.ids, whole.ids)
