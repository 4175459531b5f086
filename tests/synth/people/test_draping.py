"""Skirts and coats: legs stay below the cloth, which neither tears nor turns inside out."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from synth.people.body import SEGMENTS, Body, body_at
from synth.people.clothing import WARDROBE, Coat, Garment, dressed, sample_looks
from synth.people.draping import NODES, swings
from synth.people.mjcf import add_person
from synth.people.outfit import parts
from synth.people.skinning import FIRST_NODE, Skin, let_swing, mesh_triangles
from synth.rooms.rays import cast_rays
from synth.scene.build import build_scene
from tests.support.scenes import RIG, scene

WOMAN, STOUT, GIRL = Body(1.66, 62, 1.0), Body(1.55, 92, 1.0), body_at(1, 6)
LEG = ("thigh", "shin", "foot")
GREY = ((0.5, 0.5, 0.5), (0.4, 0.4, 0.4))
# Turns of thighs and shins about the axis from right to left, degrees: left thigh, left shin, right thigh, right shin.
POSES = {
    "standing": (0, 0, 0, 0),
    "walking": (-28, 4, 18, 25),
    "swinging": (-20, 62, 3, 0),
    "seated": (-88, 86, -88, 86),
    "crouching": (-115, 135, -100, 130),
    "running": (-50, 80, 25, 50),
}
WIDE = {"running": POSES["running"], "lunging": (-75, 75, 30, 25), "kicking": (-85, 15, 5, 0)}


def skirted(long: bool):
    looks = sample_looks(1.0, rng=np.random.default_rng(0))
    return replace(looks, skirt=True, untucked=False, bottom=Garment(long, "plain", GREY))


def posed(body: Body, looks, angles) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A person with lifted arms, legs bent by `angles`."""
    spec = mujoco.MjSpec()
    add_person(spec, 0, body, looks, position=(0, 0, 1), rng=None)
    model = spec.compile()
    data = mujoco.MjData(model)
    for segment, angle in zip(("l_thigh", "l_shin", "r_thigh", "r_shin"), angles, strict=True):
        at = model.joint(f"person0/{segment}").qposadr[0]
        data.qpos[at : at + 4] = Rotation.from_euler("y", angle, degrees=True).as_quat(scalar_first=True)
    mujoco.mj_kinematics(model, data)
    Skin(model).apply(data)
    return model, data


def cloth(model, data, material: str) -> np.ndarray:
    """The triangles (T, 3, 3) of a material, world, m."""
    geoms = [g for g in range(model.ngeom) if f"/{material}" in model.geom(g).name]
    return np.concatenate(
        [mesh_triangles(model, g) @ data.geom_xmat[g].reshape(3, 3).T + data.geom_xpos[g] for g in geoms]
    )


def names_met(model, data, point, ways) -> list[str]:
    """Names of what rays meet that come from 1 m away to a point, in directions (R, 3) seen from it."""
    geoms = [cast_rays(model, data, point + way, -way[None]).geom[0] for way in ways]
    return [model.geom(geom).name.split("/", 1)[1] if geom >= 0 else "" for geom in geoms]


def is_leg(name: str) -> bool:
    return "/skin" in name and ("thigh" in name or "shin" in name)


def enter(start, ways, triangles, outer) -> np.ndarray:
    """(R,) whether the first of triangles (T, 3, 3) that rays meet within 0.1 m is an outer one (Moller-Trumbore)."""
    met = np.zeros(len(start), bool)
    one, two = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    for ray, (point, way) in enumerate(zip(start, ways, strict=True)):
        p, away = np.cross(way, two), point - triangles[:, 0]
        q, size = np.cross(away, one), (one * p).sum(1)
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v, far = (away * p).sum(1) / size, q @ way / size, (two * q).sum(1) / size
        far = np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (far > 0) & (far < 0.1), far, np.inf)
        met[ray] = np.isfinite(far).any() and outer[far.argmin()]
    return met


SHOWN = {(False, "crouching"), (True, "swinging"), (True, "seated"), (True, "crouching"), (True, "running")}
"""Skirts, whether long, and poses in which cameras at the height of a leg look into the open hem."""


@pytest.mark.parametrize(
    ("long", "pose"), [(long, pose) for long in (False, True) for pose in POSES if (long, pose) not in SHOWN]
)
@pytest.mark.parametrize("body", [WOMAN, STOUT, GIRL], ids=["woman", "stout", "girl"])
def test_no_leg_comes_through_a_skirt(body, long, pose):
    """Rays at right angles to a leg, not from below, meet the skirt before the leg."""
    model, data = posed(body, skirted(long), POSES[pose])
    met = []
    for side in "lr":
        hip, knee, ankle = (data.xpos[model.body(f"person0/{side}_{name}").id] for name in ("thigh", "shin", "foot"))
        places = [(hip, knee, share) for share in (0.1, 0.3, 0.5, 0.7, 0.85)]
        places += [(knee, ankle, share) for share in (0.15, 0.35, 0.5) if long]
        for start, end, share in places:
            along = (end - start) / np.linalg.norm(end - start)
            across = np.linalg.svd(np.eye(3) - np.outer(along, along))[0][:, :2]
            turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
            ways = np.stack([np.cos(turn), np.sin(turn)], -1) @ across.T
            met += names_met(model, data, start + share * (end - start), ways[ways[:, 2] > -0.02])
    skin = [name for name in met if "/skin" in name and ("thigh" in name or "shin" in name)]
    assert sum("/bottom" in name for name in met) > 100
    assert not skin


@pytest.mark.parametrize("pose", WIDE)
@pytest.mark.parametrize("long", [False, True])
@pytest.mark.parametrize("body", [WOMAN, STOUT, GIRL], ids=["woman", "stout", "girl"])
def test_no_leg_is_outside_of_a_skirt_in_wide_steps(body, long, pose):
    """Rays from the skin of legs inwards do not enter the skirt from outside before they leave the leg."""
    rest = cloth(*posed(body, skirted(long), POSES["standing"]), "bottom")
    outer = (np.cross(rest[:, 1] - rest[:, 0], rest[:, 2] - rest[:, 0]) * rest.mean(1))[:, :2].sum(1) > 0
    model, data = posed(body, skirted(long), WIDE[pose])
    names = [model.geom(geom).name for geom in range(model.ngeom)]
    legs = np.concatenate([cloth(model, data, name.split("/", 1)[1]) for name in names if is_leg(name)])
    across = np.cross(legs[:, 1] - legs[:, 0], legs[:, 2] - legs[:, 0])
    area = np.linalg.norm(across, axis=1) / 2
    sheet, start, inwards = cloth(model, data, "bottom"), legs.mean(1), -across / (2 * area[:, None])
    assert 0 <= area[enter(start, inwards, sheet, outer)].sum() < 2e-4


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("long", [False, True])
@pytest.mark.parametrize("body", [WOMAN, STOUT, GIRL], ids=["woman", "stout", "girl"])
def test_the_rings_of_a_skirt_are_around_both_legs(body, long, pose):
    model, data = posed(body, skirted(long), POSES[pose])
    (person,) = Skin(model).persons
    (drape,) = person.drapes
    rings = person.bones(data, 0.0)[FIRST_NODE:, :, 3].reshape(len(drape.loose), -1, 3)
    thigh, shin = -body.offsets[[SEGMENTS.index("l_shin"), SEGMENTS.index("l_foot")], 2]
    for ring, height in zip(rings, drape.rings[:-1, 1], strict=True):
        if height > -0.25 * thigh or abs(height + thigh) < 0.15 * thigh:
            continue  # Around hips and knees, the axes of skinned legs are not their bones
        for side in "lr":
            hip, knee, ankle = (data.xpos[person.segments[SEGMENTS.index(f"{side}_{each}")]] for each in LEG)
            share = -height / thigh
            leg = hip + share * (knee - hip) if share < 1 else knee + (share - 1) * thigh / shin * (ankle - knee)
            middle = ring.mean(0)
            axes = np.linalg.svd(ring - middle)[2][:2]
            flat, at = (ring - middle) @ axes.T, axes @ (leg - middle)
            turns = np.unwrap(np.arctan2(*(np.concatenate([flat, flat[:1]]) - at).T[::-1]))
            assert abs(turns[-1] - turns[0]) > 6.2, (side, share)


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("long", [False, True])
def test_skirts_are_neither_torn_nor_turned_inside_out(long, pose):
    before, after = (
        cloth(*posed(WOMAN, skirted(long), angles), "bottom") for angles in (POSES["standing"], POSES[pose])
    )
    same = cKDTree(before.reshape(-1, 3)).query_pairs(1e-7, output_type="ndarray")
    assert len(same) > 5000
    corners = after.reshape(-1, 3)
    assert np.linalg.norm(corners[same[:, 0]] - corners[same[:, 1]], axis=1).max() < 1e-5
    long_before, long_after = (np.linalg.norm(each - np.roll(each, 1, axis=1), axis=-1) for each in (before, after))
    assert np.percentile(long_after / np.maximum(long_before, 0.005), 99) < 3


@pytest.mark.parametrize("pose", ["standing", "walking", "seated"])
@pytest.mark.parametrize("long", [False, True])
@pytest.mark.parametrize("body", [WOMAN, STOUT, GIRL], ids=["woman", "stout", "girl"])
def test_nothing_comes_through_a_closed_coat(body, long, pose):
    looks = replace(sample_looks(0.0, rng=np.random.default_rng(1)), untucked=True)
    model, data = posed(body, replace(looks, coat=Coat(Garment(long, "plain", GREY), open=False)), POSES[pose])
    turn = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    level = np.stack([np.cos(turn), np.sin(turn), 0 * turn], -1)
    met = []
    # From below the waist to the chest, where the arms begin; of those who sit, from above the knees.
    low = 0.1 if pose == "seated" else -0.15 if long else 0.0
    for height in np.linspace(low, 0.2, 8) * body.stature:
        met += names_met(model, data, np.array((-0.01 * body.stature, 0, 1 + height)), level)
    names = [name.split("/")[1].rstrip("0123456789") for name in met if "arm" not in name and "hand" not in name]
    assert names.count("coat") > 250
    assert names.count("coat") >= 0.995 * len(names), set(names)


def test_belts_and_pockets_of_coats_are_not_on_their_sleeves():
    looks = replace(sample_looks(0.0, rng=np.random.default_rng(1)), coat=Coat(Garment(True, "plain", GREY), open=True))
    coat = [part for part in parts(Body(), looks) if part.material == "coat"]
    # A texture has 1.5 m of height, and begins at the hip joints.
    sleeves, trunk = (
        np.concatenate([part.uv[..., 1].ravel() for part in coat if part.segment.endswith("forearm") == arm])
        * 1.5
        % 1.5
        for arm in (True, False)
    )
    assert trunk.min() < 0.05
    assert 0.15 < sleeves.min() < sleeves.max() < 0.9


def test_cloth_at_rest_is_where_it_was_built():
    model, data = posed(WOMAN, skirted(True), POSES["standing"])
    (person,) = Skin(model).persons
    (drape,) = person.drapes
    moved = drape.bones(data.xquat[person.segments], data.xpos[person.segments], np.zeros(2))
    np.testing.assert_allclose(moved[:, :, 3] - (0, 0, 1), drape.at_rest()[:, :, 3], atol=1e-9)
    assert len(person.bone_names) == len(person.bind) <= 255, "files in glTF number bones by bytes"


def test_a_hem_swings_on_when_the_hips_stop_and_comes_to_rest():
    seconds = np.arange(200) / 25
    hips = np.stack([np.minimum(seconds, 2.0) * 1.2, 0 * seconds], -1)
    away = swings(0.7, hips, 25)
    np.testing.assert_allclose(away[:50], 0, atol=1e-9)  # In walking evenly
    assert 0.05 < away[:, 0].max() < 0.25
    assert away[:, 0].min() < -0.01
    assert np.abs(away[-50:]).max() < 0.003
    assert (away[:, 1] == 0).all()
    finer = swings(0.7, np.stack([np.minimum(np.arange(400) / 50, 2.0) * 1.2, np.zeros(400)], -1), 50)
    np.testing.assert_allclose(finer[::2], away, atol=1e-6)
    # Half the period of a pendulum of two thirds of the length is between the extremes.
    period = 2 * np.pi / np.sqrt(9.81 / (0.7 * 2 / 3) * (1 - 0.3**2))
    assert (away[:, 0].argmin() - away[:, 0].argmax()) / 25 == pytest.approx(period / 2, abs=0.05)


@pytest.mark.parametrize("pose", ["standing", "seated"])
def test_cloth_swings_where_legs_are_upright(pose):
    model, data = posed(WOMAN, skirted(True), POSES[pose])
    (person,) = Skin(model).persons
    (drape,) = person.drapes
    where = data.xquat[person.segments], data.xpos[person.segments]
    rest, away = (drape.bones(*where, np.array(swing)).reshape(-1, NODES, 3, 4) for swing in ((0, 0), (0.0, 0.15)))
    moved = (away - rest)[..., 3].mean(1)
    thighs = drape.rings[:-1, 1] > -0.4 * drape.length
    assert np.abs(moved[thighs]).max() < 0.08
    if pose == "standing":
        assert moved[-1, 1] == pytest.approx(0.15, abs=0.03)
        assert (np.diff(moved[:, 1]) > -1e-9).all()
    else:
        assert np.abs(moved[thighs]).max() < 0.01


def test_frames_drawn_alone_show_the_same_cloth():
    spec = scene([WOMAN], 30)
    spec = replace(spec, persons=(replace(spec.persons[0], looks=skirted(False)),))
    model = build_scene(spec, RIG, painted=False).model
    qpos = np.tile(model.qpos0, (30, 1))
    qpos[:, 0] += 0.002 * np.arange(30) ** 2
    let_swing(model, qpos, 25.0)
    (person,), data = Skin(model).persons, mujoco.MjData(model)
    hems = []
    for frame in (0, 20, 29):
        data.qpos[:] = qpos[frame]
        mujoco.mj_kinematics(model, data)
        own = person.bones(data, frame / 25)[-NODES:, 0, 3].mean() - qpos[frame, 0]
        assert own == pytest.approx(
            Skin(model).persons[0].bones(data, frame / 25)[-NODES:, 0, 3].mean() - qpos[frame, 0]
        )
        hems.append(own)
    # The hips accelerate by 2.5 m/s^2; the hem stays behind.
    assert hems[0] - hems[1] > 0.05
    assert hems[0] - hems[2] > 0.05


def test_women_and_girls_wear_skirts_unless_the_wardrobe_lacks_them():
    looks = [sample_looks(1.0, rng=np.random.default_rng(seed)) for seed in range(300)]

    def worn(body: Body, *words: str) -> list:
        return [dressed(each, body, words, (), rng=np.random.default_rng(seed)) for seed, each in enumerate(looks)]

    assert 0.3 < np.mean([each.skirt for each in worn(WOMAN, *WARDROBE)]) < 0.42
    assert [each.skirt for each in worn(GIRL, "skirts")] == [each.skirt for each in worn(WOMAN, *WARDROBE)]
    assert not any(each.skirt and each.untucked for each in worn(WOMAN, *WARDROBE))
    coated = [each for each in worn(WOMAN, *WARDROBE) if each.coat]
    assert 0.15 < len(coated) / 300 < 0.25
    assert {(each.coat.cloth.long, each.coat.open) for each in coated if not each.skirt} == {*np.ndindex(2, 2)}
    assert not any(each.skirt and each.coat.cloth.long for each in coated)
    assert worn(WOMAN) == worn(Body(), "skirts") == looks
