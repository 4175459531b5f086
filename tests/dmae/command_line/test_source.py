"""Values and dataclasses read from source equal the imported ones."""

import enum
from dataclasses import MISSING, fields, is_dataclass

import pytest
from omegaconf import MISSING as REQUIRED_BY_HYDRA

from dmae.command_line import source
from dmae.command_line.options import REQUIRED, Group, Option, read_options
from dmae.command_line.source import DataclassSource, Unreadable
from tests.support.commands import COMMANDS


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Make a module of a scratch package whose source is given, to be read and not imported."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(source, "_OWN", ("scratch",))
    source.load.cache_clear()
    (tmp_path / "scratch").mkdir()
    (tmp_path / "scratch/__init__.py").write_text("")

    def make(name, text):
        (tmp_path / "scratch" / f"{name}.py").write_text(text)
        return source.load(f"scratch.{name}")

    yield make
    source.load.cache_clear()


def test_constants_enums_and_what_is_imported_are_evaluated(module):
    module("other", "raise SystemExit('imported')\nBASE = 2\nKEYS = {'a': len, 'b': lambda x: x}\n")
    found = module(
        "one",
        "from enum import Enum\nfrom scratch.other import BASE, KEYS\nSUM = BASE + 3\nNAMES = ['none', *KEYS]\n"
        "class Kind(Enum):\n    '''Which.'''\n    a = 1\n    b = 'bee'\n",
    )
    assert found.lookup("SUM") == 5
    assert found.lookup("NAMES") == ["none", "a", "b"]
    assert list(found.lookup("Kind").__members__) == ["a", "b"]
    assert found.lookup("Kind").__doc__ == "Which."


def test_computed_values_are_unreadable(module):
    found = module("one", "import os\nHOME = os.getcwd()\n")
    with pytest.raises(Unreadable, match="getcwd"):
        found.lookup("HOME")


def test_meanings_are_read_below_fields_or_from_the_docstring(module):
    found = module(
        "one",
        "from dataclasses import dataclass\n\n@dataclass(frozen=True)\nclass Base:\n"
        "    a: int = 1\n    '''m; below.'''\n\n"
        "@dataclass(frozen=True)\nclass Config(Base):\n    '''Meaning.\n\n    Attributes:\n        b, c: Both,\n"
        "            wrapped.\n    '''\n\n    b: int = 2\n    c: int = 3\n",
    )
    config = found.lookup("Config")
    assert isinstance(config, DataclassSource)
    assert config.documentation == "Meaning."
    meanings = {statement.target.id: meaning for statement, meaning, _ in config.fields()}
    assert meanings == {"a": "m; below.", "b": "Both, wrapped.", "c": "Both, wrapped."}


def test_a_computed_default_is_imported(module):
    text = (
        "import os\nfrom dataclasses import dataclass, field\n\n@dataclass(frozen=True)\nclass Config:\n"
        "    '''C.'''\n    here: str = os.sep * 2\n"
    )
    options = read_options(module("one", text).lookup("Config"), "none")
    assert options.find("here").default == "//"


@pytest.mark.parametrize("command", COMMANDS, ids=str)
def test_options_are_the_fields_of_the_configuration(command):
    _, configuration = command.imported()
    # Without presets, so that defaults are those of the classes.
    _compare(read_options(command.configuration, "no such file"), configuration)


def _compare(group: Group, configuration: type) -> None:
    expected = {field.name: field for field in fields(configuration)}
    found = {member.key.rpartition(".")[2]: member for member in group.members}
    assert list(found) == list(expected)
    for name, member in found.items():
        field = expected[name]
        default = field.default if field.default is not MISSING else REQUIRED
        default = default if field.default_factory is MISSING else field.default_factory()
        if isinstance(member, Group):
            assert is_dataclass(default), member.key
            _compare(member, type(default))
            continue
        assert isinstance(member, Option)
        assert _plain(member.default) == _plain(default), member.key


def _plain(value):
    """Enums read from source have other values than the ones imported, and the same names."""
    if isinstance(value, list):
        return [_plain(each) for each in value]
    return value.name if isinstance(value, enum.Enum) else value


@pytest.mark.parametrize("command", COMMANDS, ids=str)
def test_every_option_is_explained(command):
    options = command.options()
    assert options.meaning
    assert [member.key for member in options.walk() if not member.meaning] == []


def test_required_is_what_hydra_calls_missing():
    assert REQUIRED == REQUIRED_BY_HYDRA
