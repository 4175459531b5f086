"""The registry of interactions: choices, help, and interactions of your own."""

import sys

import pytest

import synth
from synth.interactions.registry import (
    NO_INTERACTION,
    InteractionConfig,
    find_interaction,
    interaction,
    interaction_choices,
)
from synth.motion.config import MotionConfig
from synth.physics.simulation import simulate
from synth.scene.config import SceneConfig
from synth.scene.sampling import load_motions, sample_scene
from synth.scene.spec import SceneSpec
from tests.support.commands import run_command
from tests.support.scenes import RIG

MINE = '''
"""A scratch module with an interaction."""

import numpy as np

from synth.interactions.registry import interaction
from synth.interactions.script import standing
from synth.interactions.script import Role, Script


@interaction(persons=(3, 3))
def line_up(cast, *, rng):
    """Three people stand in a row."""
    places = [(0.8 * k - 0.8, rng.uniform(-0.05, 0.05)) for k in range(3)]
    return Script(tuple(Role(standing(cast, np.array(at), 0.0)) for at in places))
'''


@pytest.fixture
def mine(tmp_path, monkeypatch):
    (tmp_path / "my_interactions.py").write_text(MINE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(interaction, "_added", {})
    yield "my_interactions:line_up"
    sys.modules.pop("my_interactions", None)


@pytest.mark.parametrize("kind", [kind for kind in interaction_choices() if kind != NO_INTERACTION])
def test_sources_and_registry_agree(kind):
    found = find_interaction(kind)
    assert (found.name, found.function.__name__) == (kind, kind)
    assert interaction_choices()[kind].startswith(found.help)
    assert interaction_choices()[kind].endswith(" people.")


def test_an_interaction_of_your_own_is_one_function(mine):
    assert find_interaction(mine).persons == (3, 3)
    scene = SceneConfig(seconds=0.4, props=[0, 0])
    spec, motions = sample_scene(scene, MotionConfig(), interaction=InteractionConfig(mine), seed=0, clip=0)
    assert len(spec.persons) == 3
    assert len(load_motions(SceneSpec.from_json(spec.to_json()))) == 3
    assert simulate(spec, RIG, motions, painted=False).joints.shape[1] == 3


def test_an_interaction_of_your_own_is_an_option(mine, tmp_path):
    done = run_command(tmp_path, "synth", "generate", f"interaction={mine}", "out=set", "clips=1", "scene.seconds=0.2")
    assert done.returncode == 0, done.stderr
    assert next(synth.generate(clips=1, seconds=0.2, interaction=mine)).truth.xyz.shape[1] == 3


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("hugs", r"no interaction 'hugs'; did you mean hug\? There are .*, and package.module:function"),
        ("my_interactions:wave", r"my_interactions has no function 'wave'; it has \['standing', 'line_up'\]"),
        ("my_interactions:standing", "expected a function under the decorator interaction"),
        ("no_such_module:wave", r"interaction.kind=no_such_module:wave: cannot import no_such_module"),
    ],
)
@pytest.mark.usefixtures("mine")
def test_unknown_interactions_are_refused(kind, message):
    with pytest.raises(ValueError, match=message):
        find_interaction(kind)


def test_an_unknown_name_is_refused_with_the_configuration():
    with pytest.raises(ValueError, match="did you mean huddle"):
        InteractionConfig("hudle")


@pytest.mark.parametrize("persons", [(0, 2), (3, 2)])
def test_a_wrong_number_of_people_is_refused(persons):
    def write(cast, *, rng):
        """Nothing."""

    with pytest.raises(ValueError, match=r"'write': expected persons=\(least, greatest\)"):
        interaction(persons=persons)(write)


def test_the_help_of_the_command_lists_all_interactions(tmp_path):
    done = run_command(tmp_path, "synth", "generate", "--help", "interaction")
    assert all(f"interaction={kind}" in done.stdout for kind in interaction_choices())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("in places)", "in places[:2])"), r"^interaction=\S+:line_up: expected a role for each of 3 people, found 2$"),
        (
            ("standing(cast, np.array(at), 0.0)", "np.zeros((7, 3))"),
            r"roles\[0\]\.path: expected \(25, 3\), .* \(7, 3\)$",
        ),
        (("0.0))", "0.0), gaze=np.zeros(7))"), r"roles\[0\]\.gaze: expected \(25,\), .* found \(7,\)$"),
        (("return Script", "Script"), r"^my_interactions:line_up: expected it to return Script, found NoneType$"),
        (
            ("for at in places)", "for at in places), reaches=lambda poses: {}['l']"),
            r"^my_interactions:line_up.<locals>.<lambda>: KeyError: 'l' \(my_interactions\.py, line 15\)$",
        ),
        (("0.8 * k", "{}[k]"), r"^my_interactions:line_up: KeyError: 0 \(my_interactions\.py, line 14\)$"),
    ],
)
def test_a_fault_of_an_interaction_of_your_own_is_answered_with_its_name(mine, tmp_path, change, message):
    assert MINE.count(change[0])
    file = tmp_path / "my_interactions.py"
    file.write_text(MINE.replace(*change))
    with pytest.raises(ValueError, match=message):
        sample_scene(
            SceneConfig(seconds=1, props=[0, 0]), MotionConfig(), interaction=InteractionConfig(mine), seed=0, clip=0
        )
