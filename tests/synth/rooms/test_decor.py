"""Decor: the look of every room can be drawn or pinned, and does not change the people of a clip."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from synth.motion.config import MotionConfig
from synth.rooms.config import room_choices
from synth.rooms.decor import FINISHES, Decor, Light, decorate, sample_decor
from synth.rooms.room import arena_file
from synth.scene.build import build_scene
from synth.scene.config import SceneConfig
from synth.scene.sampling import sample_scene
from synth.textures import paint
from tests.support.scenes import BODY, RIG, scene


def drawn(arena: str, seed: int, randomize: bool = True) -> Decor:
    return sample_decor(arena_file(arena), randomize=randomize, rng=np.random.default_rng(seed))


@pytest.mark.parametrize("arena", room_choices())
def test_every_room_can_be_drawn_and_pinned(arena):
    pinned = drawn(arena, 0, randomize=False)
    assert pinned == drawn(arena, 1, randomize=False)
    assert (pinned.light, pinned.tints) == (Light(), ())
    looks = [drawn(arena, seed) for seed in range(8)]
    assert len(set(looks)) == 8
    assert len({look.floor for look in looks}) > 1
    assert len({look.wall for look in looks}) > 1


@pytest.mark.parametrize("arena", room_choices())
def test_every_room_has_lights_and_one_that_casts_shadows(arena):
    model = build_scene(replace(scene([BODY], 1, arena=arena), decor=drawn(arena, 0)), RIG).model
    assert model.nlight > 1
    assert model.light_castshadow.sum() == 1
    assert all(model.geom(name).type[0] == mujoco.mjtGeom.mjGEOM_PLANE for name in ("floor", "wall_north"))


def test_people_and_props_do_not_depend_on_the_decor():
    config = SceneConfig(arena="market", seconds=0.4, props=[2, 2])
    one, other = (
        sample_scene(replace(config, randomize=randomize), MotionConfig(), seed=0, clip=3).spec
        for randomize in (True, False)
    )
    assert one.persons == other.persons
    assert [(prop.kind, prop.at, prop.yaw) for prop in one.props] == [(p.kind, p.at, p.yaw) for p in other.props]
    assert all(prop.tint is None for prop in other.props)
    assert one.decor != other.decor


def test_light_and_colours_reach_the_model():
    world = mujoco.MjSpec.from_file(str(arena_file("living_room")))
    before = [(light.dir.copy(), light.diffuse.copy()) for light in world.lights]
    quarter = Light(turn=np.pi / 2, strength=0.5, tint=(1.0, 1.0, 0.5))
    decorate(world, Decor(FINISHES["oak"], FINISHES["cream"], quarter, (("tint_sofa", (1.0, 0.0, 0.0)),)))
    for light, (direction, diffuse) in zip(world.lights, before, strict=True):
        np.testing.assert_allclose(light.dir, (-direction[1], direction[0], direction[2]), atol=1e-9)
        np.testing.assert_allclose(light.diffuse, diffuse * (0.5, 0.5, 0.25))
    np.testing.assert_allclose(world.material("tint_sofa").rgba, (1, 0, 0, 1))


def test_a_room_that_asks_for_an_unknown_finish_is_refused(tmp_path):
    mine = tmp_path / "mine.xml"
    mine.write_text(arena_file("studio").read_text().replace("grey_carpet oak", "moss oak"))
    with pytest.raises(ValueError, match=r"mine.xml: text 'floor' names \['moss'\]; expected some of .*'oak'"):
        sample_decor(mine, randomize=True, rng=np.random.default_rng(0))


@pytest.mark.parametrize("name", sorted(FINISHES))
def test_finishes_tile_without_seams(name):
    finish = FINISHES[name]
    image = paint(finish.pattern, finish.colours, 128, rng=np.random.default_rng(0)).astype(float)
    steps = [np.abs(np.diff(image, axis=axis)).mean((1 - axis, 2)) for axis in (0, 1)]
    seams = [np.abs(image[0] - image[-1]).mean(), np.abs(image[:, 0] - image[:, -1]).mean()]
    assert image.std() > 1
    for seam, step in zip(seams, steps, strict=True):
        assert seam <= step.max() + 3
