"""Hats cover hair, and stand off no head; beards leave lips bare; bags lie on cloth, and are left out where people
embrace."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from dmae.data.labels import Visibility
from synth.interactions.registry import InteractionConfig
from synth.labels.surfaces import NAMES, surface_labels, surface_points
from synth.labels.visibility import joint_visibility
from synth.motion.config import MotionConfig
from synth.people.accessories import Crown
from synth.people.body import SEGMENTS, SIDES, SKELETON, Body, body_at
from synth.people.clothing import BAGS, BEARDS, HAIRSTYLES, HATS, Bag, Coat, Garment, Hat
from synth.people.outfit import parts
from synth.people.skin import paint_skin
from synth.people.skinning import locate
from synth.people.surface import assets, bare_body
from synth.physics.simulation import simulate
from synth.rigs.config import RigConfig, RingConfig
from synth.rigs.rig import make_rig
from synth.scene.build import build_scene
from synth.scene.config import SceneConfig
from synth.scene.sampling import sample_people
from tests.support.scenes import RIG, gliding, scene
from tests.support.standing_people import looking_along_x
from tests.synth.people.test_surfaces import BARE

_RED = ((0.6, 0.1, 0.1), (0.4, 0.1, 0.1))


@pytest.mark.parametrize("kind", HATS)
@pytest.mark.parametrize("body", [Body(), Body(1.6, 60, 1.0), body_at(0, 5)])
def test_no_hair_and_no_skin_comes_through_a_hat(kind, body):
    size, eyes = body.stature * body.head, bare_body(body).eyes.mean((0, 1))
    for style in HAIRSTYLES:
        found = {}
        for part in parts(body, replace(BARE, hair=style, hat=Hat(kind, _RED))):
            if part.segment == "head":
                found.setdefault(part.material, []).append(part.vertices)
        points = {material: np.concatenate(each) for material, each in found.items()}
        head = points["skin"][points["skin"][:, 2] > eyes[2] - 0.1 * size]
        crown = Crown.of(kind, head, eyes, size)
        inside = np.concatenate([head, *found.get("hair", [])])
        inside = inside[crown.above(inside) > 0.002 * size]
        out = inside - crown.middle
        far = np.linalg.norm(out, axis=1)
        room = crown.radius(out / far[:, None]) + crown.clearance(np.pi, np.zeros(len(out)))
        assert (far < room).all(), style
        # Hair that falls reaches as far down as without a hat.
        assert style in ("short", "bald") or points["hair"][:, 2].min() < eyes[2] - 0.015 * size
        gap = cKDTree(head).query(points["hat"])[0]
        assert gap.max() < 0.035 * size
        # Eyes and brows are bare.
        assert points["hat"][:, 2].min() > eyes[2] - 0.05 * size
        front = points["hat"][points["hat"][:, 0] > eyes[0]]
        assert front[:, 2].min() > eyes[2] + 0.015 * size


@pytest.mark.parametrize("body", [Body(), Body(1.9, 110)])
def test_beards_grow_around_the_mouth(body):
    size, eyes = body.stature * body.head, bare_body(body).eyes.mean((0, 1))
    reach = {}
    for beard in (None, *BEARDS):
        found = [part for part in parts(body, replace(BARE, beard=beard)) if part.segment == "head"]
        hair = [part.vertices for part in found if part.material == "hair"]
        if beard in (None, "stubble"):
            assert not hair
            continue
        points, faces = np.concatenate(hair), [part for part in found if part.material == "lip"]
        lips = np.concatenate([part.vertices for part in faces])
        inner = np.hypot(*((lips[:, 1:] - lips[:, 1:].mean(0)) / np.ptp(lips[:, 1:], axis=0)).T) < 0.35
        assert cKDTree(points).query(lips[inner])[0].min() > 0.0008 * size
        assert points[:, 2].max() < eyes[2] + 0.01 * size
        reach[beard] = points[:, 2].min() - eyes[2], np.ptp(points[:, 1]), points[:, 0].max()
    assert reach["goatee"][1] < 0.7 * reach["full"][1]
    assert reach["full"][2] > reach["short"][2] + 0.003 * size


def test_a_beard_darkens_the_skin_and_draws_nothing():
    images = [paint_skin(Body(), replace(BARE, hair_colour=(0.1,) * 3, beard=beard), rng=np.random.default_rng(4))
              for beard in (None, "stubble")]  # fmt: skip
    chin, arm = np.s_[280:330, 200:312], np.s_[:250]
    assert images[1][chin].mean() < images[0][chin].mean()
    np.testing.assert_array_equal(images[0][arm], images[1][arm])


def of_material(found: list, *materials: str) -> tuple[np.ndarray, np.ndarray]:
    """Return points and triangles of the parts of some materials."""
    points, faces, count = [], [], 0
    for part in found:
        if part.material in materials:
            points.append(part.vertices)
            faces.append(part.faces + count)
            count += len(part.vertices)
    return np.concatenate(points), np.concatenate(faces)


@pytest.mark.parametrize("kind", BAGS)
@pytest.mark.parametrize("side", ["l", "r"])
@pytest.mark.parametrize("body", [Body(), Body(1.6, 60, 1.0), Body(1.9, 115)])
@pytest.mark.parametrize("untucked", [True, False])
def test_bags_and_straps_lie_on_cloth(kind, side, body, untucked):
    found = parts(body, replace(BARE, untucked=untucked, bag=Bag(kind, side, _RED)))
    cloth, of_cloth = of_material(found, "top", "bottom")
    cloth = cloth[of_cloth]
    size = body.stature
    bag = trimesh.Trimesh(*of_material(found, "bag"))
    assert bag.is_watertight and bag.volume > 0
    # It touches the person, and is hardly within.
    bare = bare_body(body)
    normals = trimesh.Trimesh(bare.vertices, assets().faces, process=False).vertex_normals
    nearest = cKDTree(bare.vertices).query(bag.vertices)[1]
    outward = ((bag.vertices - bare.vertices[nearest]) * normals[nearest]).sum(1)
    assert -0.012 * size < outward.min() < 0.01 * size
    assert outward.max() < 0.12 * size
    low, high = bag.bounds
    assert high[2] < bare_body(body).origins[SEGMENTS.index("head"), 2]
    if kind == "shoulder_bag":
        assert np.sign(bag.centroid[1]) == SIDES[side]
        assert low[2] > -0.06 * size
    assert bag.centroid[0] < -0.05 * size
    # Straps are some millimetres above the cloth, most in their middle.
    straps, _ = of_material(found, "strap")
    if kind == "backpack":
        # The pocket has the colour of the straps.
        straps = straps[cKDTree(bag.vertices).query(straps)[0] > 0.05 * size]
    triangles, shares = locate(cloth, straps)
    away = np.linalg.norm(straps - (cloth[triangles] * shares[..., None]).sum(1), axis=1)
    assert 0.005 < np.percentile(away, 98) < 0.0085
    assert away.max() < 0.009
    assert straps[:, 2].max() > bare_body(body).origins[SEGMENTS.index("l_upper_arm"), 2]


def test_a_bag_hangs_outside_a_long_coat():
    coat = Coat(Garment(True, "plain", _RED), False)
    found = parts(Body(), replace(BARE, coat=coat, bag=Bag("shoulder_bag", "l", _RED)))
    cloth, bag = (of_material(found, material)[0] for material in ("coat", "bag"))
    back = cloth[cloth[:, 0] < 0]
    behind = back[cKDTree(back[:, 1:]).query(bag[:, 1:], 3)[1], 0].min(1)
    assert (bag[:, 0] < behind).mean() > 0.85


def test_hats_brims_and_bags_are_closed_from_outside():
    looks = replace(BARE, hat=Hat("cap", _RED), bag=Bag("backpack", "l", _RED))
    found = parts(Body(), looks)
    assert trimesh.Trimesh(*of_material(found, "brim")).is_watertight
    assert trimesh.Trimesh(*of_material(found, "brim")).volume > 0
    points, faces = of_material(found, "hat")
    hat = trimesh.Trimesh(points, faces)
    # A hat is open below, where its edge is within the head.
    edge = hat.edges_sorted[trimesh.grouping.group_rows(hat.edges_sorted, require_count=1)]
    skull = bare_body(Body()).vertices[bare_body(Body()).weights[:, SEGMENTS.index("head")] > 0.8]
    crown = Crown.of("cap", skull, bare_body(Body()).eyes.mean((0, 1)), 1.75)
    out = hat.vertices[np.unique(edge)] - crown.middle
    far = np.linalg.norm(out, axis=1)
    assert (far < crown.radius(out / far[:, None])).all()


def bags_of(kind: str, clips: int = 8, children: float = 0.0) -> list:
    """Return (body, bag, least height of hips relative to standing) of people in an interaction."""
    found = []
    for clip in range(clips):
        people = sample_people(
            SceneConfig(seconds=2.0, children=children), MotionConfig(), InteractionConfig(kind), seed=2, clip=clip
        )
        for body, looks, motion in zip(people.bodies, people.looks, people.motions, strict=True):
            found.append((body, looks.bag, motion.root[:, 2].min() / body.hip_height))
    return found


def test_bags_are_left_out_where_people_embrace_and_sit():
    for kind in ("hug", "huddle"):
        assert not any(bag for _, bag, _ in bags_of(kind))
    seated = [bag.kind for _, bag, _ in bags_of("table", 20) if bag]
    assert seated and set(seated) == {"backpack"}
    talking = bags_of("circle_talk", 20)
    assert {bag.kind for _, bag, _ in talking if bag} == set(BAGS)
    assert 0.1 < np.mean([bag is not None for _, bag, _ in talking]) < 0.3
    mixed = bags_of("none", 20, children=0.5)
    assert any(bag for _, bag, _ in mixed)
    assert not any(bag for body, bag, _ in mixed if body.age < 18)
    assert not any(bag.kind == "shoulder_bag" for _, bag, low in mixed if bag and low < 0.7)


def test_a_backpack_hides_the_back_and_carries_no_points():
    looks = {"hat": Hat("cap", _RED), "bag": Bag("backpack", "l", _RED)}
    labels = []
    for worn in ({}, looks):
        spec = scene([Body()], 1)
        person = spec.persons[0]
        spec = replace(spec, persons=(replace(person, looks=replace(person.looks, **worn)),))
        built = build_scene(spec, RIG, painted=False)
        points = surface_points(built, [Body()])
        labels.append(surface_labels(built, points, built.model.qpos0[None], looking_along_x((-4, 0, 1.3))))
    plain, worn = labels
    off_head = np.array([not name.startswith("head") for name in NAMES])
    np.testing.assert_allclose(worn.xyz[0, 0, off_head], plain.xyz[0, 0, off_head], atol=1e-6)
    # Points on the head are on the hat, not on its brim.
    assert np.linalg.norm(worn.xyz - plain.xyz, axis=-1).max() < 0.03
    back = [NAMES.index(f"{segment}.2.back") for segment in ("chest", "spine")]
    assert (plain.visibility[0, 0, 0, back] == Visibility.VISIBLE).all()
    assert (worn.visibility[0, 0, 0, back] == Visibility.HIDDEN_BY_SELF).all()
    assert (worn.hidden_by[0, 0, 0, back] == 0).all()


@pytest.mark.parametrize(
    "worn", [(Hat("cap", _RED), Bag("backpack", "l", _RED)), (Hat("beanie", _RED), Bag("shoulder_bag", "l", _RED))]
)
def test_hats_and_bags_hide_joints_as_the_own_body_does(worn):
    ring = RingConfig(views=16, radius=[4, 4], height=[1.6, 1.6])
    rig = make_rig(RigConfig(ring=ring), rng=np.random.default_rng(0))
    found = []
    for hat, bag in ((None, None), worn):
        spec = scene([Body()], 2)
        looks = replace(spec.persons[0].looks, hat=hat, bag=bag, beard=bag and "full")
        spec = replace(spec, persons=(replace(spec.persons[0], looks=looks),))
        simulation = simulate(spec, rig, [gliding(Body(), 2, (0, 0), (1, 0))])
        labels = joint_visibility(
            simulation.model, simulation.qpos[:1], simulation.joints[:1], simulation.depth, simulation.geom_ids, rig,
            simulation.bodies,
        )  # fmt: skip
        found.append((labels.visibility[0, :, 0], labels.occluder[0, :, 0]))
    (plain, _), (seen, occluder) = found
    changed = seen != plain
    assert 5 < changed.sum() < 0.1 * changed.size
    assert (seen[changed] == Visibility.HIDDEN_BY_SELF).mean() > 0.95
    assert (occluder[seen == Visibility.HIDDEN_BY_SELF] == 0).all()
    # From the front everything below the brow is seen as before.
    front = np.abs(np.arctan2(rig.centers[:, 1], rig.centers[:, 0])) < np.radians(40)
    brow = [name.endswith(("top_head", "ear")) for name in SKELETON.joints]
    assert not changed[front][:, ~np.array(brow)].any()
