"""The rooms: each is one MJCF file, from which choices, help and presets follow."""

from pathlib import Path
from xml.etree import ElementTree

import mujoco
import pytest

from dmae.cli import compose
from synth.cli import SYNTH
from synth.rooms.room import arena_file, prop_file, room_choices, room_presets
from synth.scene.spec import SceneConfig
from tests.support.commands import run_command


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
    monkeypatch.setattr("synth.rooms.room._folder", lambda: tmp_path / "scenes")
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
    with pytest.raises(ValueError, match=r"no arena 'ofice'; did you mean 'office'\? There are .*, and the path of"):
        arena_file("ofice")
    with pytest.raises(ValueError, match=r"no prop 'chairs'; did you mean 'chair'\?"):
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
