"""Points on people's surfaces: 512 named ones, on the skin, seen by exactly the cameras that look at them."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Clip, Detections2D
from dmae.data.labels import Visibility
from dmae.data.skeleton import BODY25
from synth.labels.surfaces import NAMES, agreement, surface_labels, surface_points
from synth.people.body import SEGMENTS, Body
from synth.people.clothing import Bag, Hat
from synth.rendering.config import ImageQuality
from synth.rendering.renderer import Renderer, render_images
from synth.scene.build import build_scene
from tests.support.rigs import preset
from tests.support.scenes import BODY, RIG, scene

CHILD = Body(1.2, 24, 1.0, age=6.0)


@pytest.fixture(scope="module")
def standing():
    """A man and a girl in T-pose, the girl 1 m behind the man."""
    built = build_scene(scene([BODY, CHILD], 1), RIG, painted=False)
    state = built.model.qpos0.copy()
    state[7 + 15 * 4] -= 1.0
    return built, surface_labels(built, surface_points(built, [BODY, CHILD]), state[None], RIG), state


def where(pattern: str) -> list[int]:
    found = [number for number, name in enumerate(NAMES) if name.startswith(pattern.split("*")[0])]
    return [number for number in found if NAMES[number].endswith(pattern.split("*")[1])]


def test_there_are_512_names_of_all_segments():
    assert len(set(NAMES)) == 512
    assert {name.split(".")[0] for name in NAMES} == set(SEGMENTS)


def test_points_lie_where_their_names_say(standing):
    _, labels, state = standing
    man = labels.xyz[0, 0]
    hips = state[:3]
    assert np.isfinite(labels.xyz).all()
    np.testing.assert_allclose(np.linalg.norm(labels.normals, axis=-1), 1, atol=1e-5)
    for direction, axis, sign in (("front", 0, 1), ("back", 0, -1), ("left", 1, 1), ("right", 1, -1)):
        chest = where(f"chest*.{direction}")
        assert (sign * (man[chest] - hips)[:, axis] > 0.05).all()
        assert (sign * labels.normals[0, 0, chest, axis] > 0.6).all()
    soles = where("l_foot*.sole")
    assert (man[soles, 2] < 0.01).all()
    assert (labels.normals[0, 0, soles, 2] < -0.9).all()
    # Outer and inner are from the middle.
    for side, sign in (("l", 1), ("r", -1)):
        outer, inner = (man[where(f"{side}_shin*.{way}"), 1].mean() for way in ("outer", "inner"))
        assert sign * outer > sign * inner > 0
    np.testing.assert_allclose(man[where("l_hand*.top")], man[where("r_hand*.top")] * (1, -1, 1), atol=0.01)
    # The girl is smaller.
    assert labels.xyz[0, 1, :, 2].max() < 0.75 * man[:, 2].max()


def test_points_move_with_bent_bodies(standing):
    built, before, state = standing
    points = surface_points(built, [BODY, CHILD])
    bent = state.copy()
    # The chest leans forward by 60 degrees.
    bent[7 + 4 : 7 + 8] = np.cos(np.pi / 6), 0, np.sin(np.pi / 6), 0
    after = surface_labels(built, points, bent[None], RIG)
    moved = np.linalg.norm(after.xyz - before.xyz, axis=-1)[0]
    assert moved[0, where("head*")].min() > 0.2
    assert moved[0, where("l_shin*")].max() < 1e-6
    assert moved[1].max() < 1e-6


def test_visible_points_face_the_camera_and_hidden_ones_are_behind_something(standing):
    _, labels, _ = standing
    away = RIG.centers[:, None, None] - labels.xyz[0]
    faces = (away * labels.normals[0]).sum(-1) > 0
    codes = labels.visibility[0]
    assert faces[codes == Visibility.VISIBLE].all()
    assert (codes[~faces] != Visibility.VISIBLE).all()
    assert (labels.hidden_by[0][codes == Visibility.VISIBLE] == -1).all()
    own = labels.hidden_by[0] == np.arange(2)[:, None]
    assert own[codes == Visibility.HIDDEN_BY_SELF].all()
    # Seen from all sides, nearly every point is seen by some camera.
    assert (codes == Visibility.VISIBLE).any(0)[0].mean() > 0.8


def test_points_touch_who_stands_against_them_and_the_floor(standing):
    built, apart, state = standing
    assert not np.isin(apart.touches, (1, 2)).any()
    assert (apart.touches[0][:, where("l_foot*.sole")] >= 256).mean() > 0.7
    # The girl stands where the man's back and her front overlap by 5 mm.
    man, girl = apart.xyz[0].astype(float)
    gaps = [m[0] - g[0] for m in man for g in girl if np.hypot(*(m - g)[1:]) < 0.02]
    near = state.copy()
    near[7 + 15 * 4] += min(gaps) + 0.005
    labels = surface_labels(built, surface_points(built, [BODY, CHILD]), near[None], RIG)
    behind, before = labels.touches[0, 0] == 2, labels.touches[0, 1] == 1
    assert behind.any()
    assert before.any()
    assert (labels.normals[0, 0, behind, 0] < 0.3).all()
    assert (labels.normals[0, 1, before, 0] > -0.3).all()
    # Touching is mutual: near each point there is one of the other's that touches, within the distance of points.
    for here, there in ((behind, before), (before, behind)):
        ones, others = labels.xyz[0, int(here is before), here], labels.xyz[0, int(there is before), there]
        assert np.linalg.norm(ones[:, None] - others, axis=-1).min(1).max() < 0.15


@pytest.mark.slow
def test_points_are_on_the_side_of_the_silhouette_that_their_visibility_says(painter, tmp_path):
    """Of points that are visible the id image shows their person, of hidden ones what hides them."""
    from synth.motion.config import MotionConfig
    from synth.physics.simulation import simulate
    from synth.scene.config import SceneConfig
    from synth.scene.sampling import sample_scene

    rig = preset("shelf")
    config = SceneConfig(arena="office", persons=[4, 4], seconds=0.4, gathering=0.4)
    spec = sample_scene(config, MotionConfig(), seed=1, clip=0).spec
    dark = ((0.1, 0.1, 0.1), (0.2, 0.2, 0.2))
    worn = [Hat("cap", dark), Bag("backpack", "l", dark)], [Hat("beanie", dark), Bag("shoulder_bag", "r", dark)]
    persons = [replace(each, looks=replace(each.looks, hat=hat, bag=bag, beard="full"))
               for each, (hat, bag) in zip(spec.persons, worn * 2, strict=True)]  # fmt: skip
    spec = replace(spec, persons=tuple(persons))
    simulation = simulate(spec, rig, painted=False)
    built = build_scene(spec, rig, painted=False)
    labels = surface_labels(built, surface_points(built, [p.body for p in spec.persons]), simulation.qpos[-1:], rig)
    with Renderer(simulation.model, simulation.geom_ids, rig, ImageQuality.draft) as renderer:
        images, _, _ = render_images(renderer, simulation.qpos[-1:], rig, tmp_path, 25, ("ids",))
    nothing = np.zeros((1, len(rig), 0, 25))
    clip = Clip("crowd", 25, rig, Detections2D(BODY25, np.stack([nothing] * 2, -1), nothing), images=images)
    counts = agreement(clip, labels)
    assert (counts.compared > 100).all(), counts
    assert (counts.agreeing >= 0.99 * counts.compared).all(), counts
    # Labels that say the opposite do not agree.
    flipped = np.where(labels.visibility == Visibility.VISIBLE, Visibility.HIDDEN_BY_OBJECT, labels.visibility)
    wrong = agreement(clip, type(labels)(NAMES, labels.xyz, labels.normals, flipped, labels.hidden_by, labels.touches))
    assert wrong.agreeing.sum() <= counts.agreeing.sum() - counts.agreeing[0]
