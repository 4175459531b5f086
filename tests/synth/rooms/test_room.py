"""Rooms from any MJCF file: missing parts are filled in and reported."""

from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from dmae.cli import compose
from synth.cli import SYNTH
from synth.datasets.clip import generate_clip
from synth.datasets.config import GenerateConfig
from synth.rooms.config import room_choices, room_presets
from synth.rooms.room import arena_file, load_room, prop_file, room_name
from synth.scene.config import SceneConfig
from tests.support.commands import run_command

LIGHT = '<light pos="0 0 3"/>'
FLOOR = '<geom name="ground" type="box" size="4 4 .1" pos="0 0 -.1" {}/>'
CUPBOARD = '<body name="cupboard" pos="1.5 1.5 0" euler="0 0 90"><geom type="box" size=".4 .1 1" pos="0 0 1"/></body>'
BALL = '<body name="ball" pos="-1 0 .3"><freejoint/><geom type="sphere" size=".2"/></body>'
KEY = '<keyframe><key name="home" qpos="-1 0 1 1 0 0 0"/></keyframe>'


@pytest.fixture
def room(tmp_path):
    def write(body: str, more: str = "") -> str:
        (tmp_path / "mine.xml").write_text(f"<mujoco>{more}<worldbody>{body}</worldbody></mujoco>")
        return str(tmp_path / "mine.xml")

    return write


@pytest.mark.parametrize("name", room_choices())
def test_nothing_is_filled_into_the_rooms_that_come_with_the_package(name):
    assert load_room(name).filled == ()
    assert room_name(name) == name


@pytest.mark.parametrize(
    ("body", "more", "said"),
    [
        (CUPBOARD + LIGHT, "", ["added a floor at z = 0"]),
        (FLOOR.format("") + CUPBOARD, "", ["'floor', which scene.randomize covers", "added 3 lights"]),
        (FLOOR.format('contype="0" conaffinity="0"') + LIGHT, "", ["made 'ground' solid", "material named 'floor'"]),
        (FLOOR.format("") + BALL + LIGHT, KEY, ["left out 1 keys, 1 joints", "material named 'floor'"]),
        (
            FLOOR.format("") + LIGHT.replace("/", ' active="false"/') + LIGHT.replace("/", ' diffuse="0 0 0"/'),
            '<visual><headlight active="0"/></visual>',
            ["material named 'floor'", "added 3 lights: the file has none that shine"],
        ),
        (FLOOR.format("").replace('-.1"', '-2"') + LIGHT, "", ["added a floor at z = 0", "material named 'floor'"]),
        (
            FLOOR.format('material="wood"') + LIGHT,
            '<asset><material name="wood"/></asset><option gravity="0 0 0"><flag contact="disable"/></option>',
            [],
        ),
    ],
)
def test_what_a_file_lacks_is_filled_in_and_told(room, body, more, said):
    found = load_room(room(body, more))
    assert len(found.filled) >= len(said)
    for part in said:
        assert any(part in each for each in found.filled), (part, found.filled)
    assert len(load_room(room(body, more)).filled) == len(found.filled)
    model = found.spec.compile()
    assert model.nv == model.nkey == 0
    lit = model.light_diffuse[model.light_active.astype(bool)]
    assert lit.any() or (model.vis.headlight.active and model.vis.headlight.diffuse.any())
    assert model.opt.gravity[2] == -9.81
    assert model.opt.disableflags == 0
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    geom = np.zeros(1, np.int32)
    assert mujoco.mj_ray(model, data, (0.3, 0.2, 0.1), (0, 0, -1), None, 1, -1, geom) == pytest.approx(0.1)
    assert model.geom_conaffinity[geom[0]], "people stand on it"


def test_angles_are_in_the_unit_of_the_file(room):
    model = load_room(room(CUPBOARD)).spec.compile()
    np.testing.assert_allclose(np.abs(model.body("cupboard").quat), np.sqrt([0.5, 0, 0, 0.5]), atol=1e-6)


def test_people_stand_in_any_room_and_are_hidden_by_what_is_in_it(room):
    config = GenerateConfig(seed=1, scene=SceneConfig(arena=room(CUPBOARD + BALL), seconds=0.4, props=[0, 0]))
    clip = generate_clip(config, 0)
    assert clip.occlusion.objects == ("floor", "cupboard", "ball")
    assert 0 < clip.truth.xyz[..., 2].min() < 0.15
    assert any("added a floor" in each for each in clip.provenance["room"])


def test_a_file_that_is_no_mjcf_is_refused_by_its_name(room):
    path = room("<geom/")
    with pytest.raises(ValueError, match=r"mine.xml: expected MJCF"):
        load_room(path)


# The rooms: each is one MJCF file, from which choices, help and presets follow.


@pytest.mark.parametrize("room", room_choices())
def test_every_room_has_a_line_of_help_and_a_preset(room):
    assert room_choices()[room].endswith(".")
    assert room_presets()[room]["arena"] == room
    SceneConfig(**room_presets()[room])


@pytest.mark.parametrize("room", room_choices())
def test_every_room_compiles_with_floor_and_wall(room):
    spec = mujoco.MjSpec.from_file(str(arena_file(room)))
    assert spec.material("floor") is not None
    assert spec.material("wall") is not None
    spec.compile()


@pytest.fixture
def with_a_room_of_your_own(tmp_path, monkeypatch) -> Path:
    """A folder of rooms with one more file."""
    folder = arena_file("studio").parent
    for file in folder.rglob("*.xml"):
        copy = tmp_path / "scenes" / file.relative_to(folder)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_text(file.read_text())
    tree = ElementTree.parse(folder / "studio.xml")
    custom = tree.find("custom")
    custom.find("text[@name='help']").set("data", "A cellar.")
    ElementTree.SubElement(custom, "numeric", name="props", data="1 2")
    tree.write(tmp_path / "scenes" / "cellar.xml")
    for module in ("config", "room"):
        monkeypatch.setattr(f"synth.rooms.{module}.room_folder", lambda: tmp_path / "scenes")
    return tmp_path


def test_a_room_of_your_own_is_one_file(with_a_room_of_your_own):
    assert room_choices()["cellar"] == "A cellar."
    config = compose(SYNTH.commands["generate"], ["scene=cellar"])
    assert (config.scene.arena, config.scene.props) == ("cellar", [1, 2])
    done = run_command(with_a_room_of_your_own, "synth", "generate", "--help", "scene")
    assert "scene=cellar" in done.stdout
    done = run_command(
        with_a_room_of_your_own, "synth", "generate", "scene=cellar", "out=set", "clips=1", "scene.seconds=0.2"
    )
    assert done.returncode == 0, done.stderr


def test_unknown_rooms_and_props_are_answered_with_the_nearest():
    with pytest.raises(ValueError, match=r"no arena 'ofice'; did you mean office\? There are .*, and the path of"):
        arena_file("ofice")
    with pytest.raises(ValueError, match=r"no prop 'chairs'; did you mean chair\?"):
        prop_file("chairs")


def test_presets_keep_their_spelling():
    chosen = {room: compose(SYNTH.commands["generate"], [f"scene={room}"]).scene for room in room_choices()}
    assert {room: (scene.arena, scene.props) for room, scene in chosen.items()} == {
        "living_room": ("living_room", [0, 1]),
        "market": ("market", [0, 1]),
        "office": ("office", [0, 2]),
        "pillars": ("pillars", [0, 2]),
        "studio": ("studio", [0, 3]),
        "warehouse": ("warehouse", [0, 1]),
    }
