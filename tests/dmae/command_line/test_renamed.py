"""Old names of options work for a release, with a note that names the new ones."""

import pytest

from dmae.command_line import renamed as table
from dmae.command_line.options import Group
from dmae.command_line.renamed import RENAMED, UNTIL, renamed
from tests.support.commands import COMMANDS, run_command

NAMES = {"dmae x": {"a.b": "a.c", "fill=recall": "fill=gaussian_process", "methods=recall": "methods=gp", "rig": "set"}}
NAMES["dmae x"] |= {"old": "new", "new=x": "new=y"}


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("a.b=3", "a.c=3"),
        ("a.b.d=3", "a.c.d=3"),
        ("a.bb=3", "a.bb=3"),
        ("++a.b=3", "++a.c=3"),
        ("fill=recall", "fill=gaussian_process"),
        ("fill=linear,recall", "fill=linear,gaussian_process"),
        ("fill=recaller", "fill=recaller"),
        ("methods=[linear,recall]", "methods=[linear,gp]"),
        ("methods=[linear]", "methods=[linear]"),
        ("methods=[],[recall],[linear, recall]", "methods=[],[gp],[linear, gp]"),
        ("methods=[mine:recall]", "methods=[mine:recall]"),
        ("rig=ring", "set=ring"),
        ("old=[x,z]", "new=[y,z]"),
        ("rig.views=3", "set.views=3"),
    ],
)
def test_old_names_are_replaced_and_noted(monkeypatch, given, expected):
    monkeypatch.setattr(table, "RENAMED", NAMES)
    found, notes = renamed("dmae x", [given])
    assert found == [expected]
    assert bool(notes) == (given != expected)
    assert all(UNTIL in note for note in notes)
    assert renamed("dmae y", [given]) == ([given], [])


def test_a_note_is_printed(tmp_path):
    done = run_command(tmp_path, "synth", "compare", "real=a", "sim=b", "miss=0.5")
    assert done.stderr.startswith("synth compare: miss is now called limits.miss; the old name works until")


@pytest.mark.parametrize("command", sorted(RENAMED))
def test_new_names_exist_and_old_ones_do_not(command):
    (options,) = (each.options() for each in COMMANDS if str(each) == command)
    for old, new in RENAMED[command].items():
        (old_key, _, old_choice), (new_key, _, new_choice) = old.partition("="), new.partition("=")
        found = options.find(new_key)
        assert found is not None
        if not new_choice:
            # An option may have become a group of its name.
            assert options.find(old_key) is None or new_key.startswith(f"{old_key}.")
            continue
        choices = found.presets if isinstance(found, Group) else found.choices
        assert new_choice in choices and old_choice not in choices
