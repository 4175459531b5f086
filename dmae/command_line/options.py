"""Programs, their commands, and the options of a command, which are the fields of a frozen dataclass.

The dataclass is the only declaration of an option: Hydra composes it, Python constructs it, and help, messages and the
reference page read it here, with the docstring below each field. Its module imports nothing heavy.
"""

import enum
import importlib
import inspect
import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, get_args, get_origin, get_type_hints

from docstring_parser import parse_from_object

from dmae.data.json_values import flat, merged
from dmae.data.resources import resource_folder
from dmae.data.typed import REQUIRED, decode
from dmae.registry import Registry

_KINDS = {int: "whole number", float: "number", bool: "true or false", str: "text"}


@dataclass(frozen=True)
class Option:
    """One `key=value`."""

    key: str  # With its groups, as users type it
    kind: str  # Of its value, or of each entry of a list: "whole number", "number", "true or false", "text", "choice"
    default: object  # Its value if it is not given; `REQUIRED` where it must be
    meaning: str  # From the docstring
    choices: tuple[str, ...] = ()  # All values that are allowed; none where any is
    many: bool = False  # Whether it is a list
    keyed: bool = False  # Whether it is a dictionary, and `key.anything=value` is allowed
    optional: bool = False  # Whether it can be `null`
    instead: Mapping[str, str] = field(default_factory=dict)  # By values of other commands: what to write for them here

    @property
    def may_be_one(self) -> bool:
        """Whether one value is short for a list of it: as of names; numbers are ranges or places."""
        return self.many and self.kind in ("text", "choice")


@dataclass(frozen=True)
class Group:
    """Options under a common name."""

    key: str  # With the groups that it is in; empty for a whole command
    meaning: str  # From the docstring
    members: tuple["Option | Group", ...] = ()  # In the order of the dataclass
    # Names that `key=name` can be, with their help; empty if there are none
    presets: dict[str, str] = field(default_factory=dict)
    preset: str | None = None  # The one that is used if none is given; `REQUIRED` where one must be

    def walk(self) -> Iterator["Option | Group"]:
        """All options and groups in it, at any depth."""
        for member in self.members:
            yield member
            if isinstance(member, Group):
                yield from member.walk()

    def find(self, key: str) -> "Option | Group | None":
        return next((member for member in self.walk() if member.key == key), None)


@dataclass(frozen=True)
class Preset:
    """What `key=name` stands for: a line of help, and values of the options of the group, or of the whole command."""

    meaning: str
    values: dict[str, object]
    whole: bool = False

    @classmethod
    def of(cls, text: str, values: dict | None) -> "Preset":
        """Return the preset of a file with this text and values: the comment at the top is its help."""
        lines = itertools.takewhile(lambda line: line.startswith("#"), text.splitlines())
        meaning = " ".join(line.lstrip("# ") for line in lines if "@package" not in line)
        return cls(meaning, values or {}, "@package _global_" in text)


Presets = Mapping[str, Mapping[str, Preset]]
"""Presets by group and name."""
Registries = Mapping[str, Callable[[], dict[str, Preset]]]
"""Functions that return the presets of groups by name, where a registry has them rather than files in `configs/`."""


def presets_of(registry: Registry, option: str) -> Callable[[], dict[str, Preset]]:
    """Return a function that lists the entries of a registry as presets, which set `option` to their names."""
    return lambda: {name: Preset(entry.help, {option: name}) for name, entry in registry.items()}


@dataclass(frozen=True)
class Command:
    """A sub-command, `dmae a-b` with `run(config, out)` in the module `dmae.commands.a_b`, which is imported to run it.

    The module may also have `default_out(config)`; `written_path(config, out)`, the path that is written where `out` is
    short for it; and `interrupted(config, out)`, which says what is complete and how to continue.
    """

    summary: str  # What it does, in a line
    config: str  # Home of the dataclass of its options, as "module:class"
    examples: tuple[str, ...]  # Command lines
    # Groups that have presets, and the preset of each that is used unless another is named; `REQUIRED` where one must
    # be named
    presets: Mapping[str, str | None] = field(default_factory=dict)
    # "folder" or "file" as `out` is one; None where it has no `out`, or where that depends
    writes: str | None = "folder"
    program: str = ""  # Name of the program
    name: str = ""  # As users type it
    registries: Registries = field(default_factory=dict)  # Presets that are no files, by group

    def __str__(self) -> str:
        return f"{self.program} {self.name}"

    @property
    def configuration(self) -> type:
        """The dataclass of its options."""
        home, _, name = self.config.partition(":")
        return getattr(importlib.import_module(home), name)

    @property
    def module(self) -> ModuleType:
        return importlib.import_module(f"{self.program}.commands.{self.name.replace('-', '_')}")

    def presets_of(self, group: str) -> dict[str, Preset]:
        """The presets of a group that come with the package: of its registry, and the files in `configs/`."""
        files = sorted((resource_folder("dmae", "configs") / group).glob("*.yaml"))
        registered = self.registries[group]() if group in self.registries else {}
        return {**registered, **{file.stem: _read(file) for file in files}}

    def options(self, own: Presets | None = None) -> Group:
        """Its options; `own` are further presets."""
        presets = {group: self.presets_of(group) for group in self.presets}
        values: dict[str, object] = {}
        for group, name in self.presets.items():
            if default := presets[group].get(name or ""):
                values |= flat(default.values, "" if default.whole else f"{group}.")
        options = _group(self.configuration, "", values)
        members: list[Option | Group] = []
        for member in options.members:
            if isinstance(member, Group) and member.key in self.presets:
                known = {**presets[member.key], **(own or {}).get(member.key, {})}
                meanings = {name: preset.meaning for name, preset in known.items()}
                member = replace(member, presets=meanings, preset=self.presets[member.key])
            members.append(member)
        return replace(options, members=tuple(members))

    def composed(self, chosen: Mapping[str, Preset]) -> Any:
        """Return the configuration of the command with the chosen presets; other groups have their usual ones."""
        values: dict[str, object] = {}
        for group, usual in self.presets.items():
            preset = chosen.get(group) or self.presets_of(group).get(usual or "")
            if preset:
                values = merged(values, preset.values if preset.whole else {group: preset.values})
        return decode(self.configuration, values, self.name)


class Program:
    """A program: its name, one sentence about it, its commands by name, and presets of groups from registries."""

    def __init__(self, name: str, about: str, commands: Mapping[str, Command], registries: Registries | None = None):
        self.name, self.about = name, about
        self.commands = {
            each: replace(command, program=name, name=each, registries=registries or {})
            for each, command in commands.items()
        }


def _group(configuration: type, key: str, values: dict[str, object]) -> Group:
    meanings, hints = _meanings(configuration), get_type_hints(configuration)
    members: list[Option | Group] = []
    # What many configurations inherit stands last.
    for each in sorted(fields(configuration), key=lambda each: each.kw_only is True):
        name = f"{key}.{each.name}".lstrip(".")
        if is_dataclass(hints[each.name]):
            group = _group(hints[each.name], name, values)
            members.append(replace(group, meaning=meanings.get(each.name, group.meaning)))
        else:
            members.append(_option(each, name, hints[each.name], meanings.get(each.name, ""), values))
    return Group(key, _documentation(configuration), tuple(members))


def _option(each, key: str, hint, meaning: str, values: dict[str, object]) -> Option:
    inner = tuple(part for part in get_args(hint) if part is not type(None))
    optional = type(None) in get_args(hint)
    if optional:
        hint = inner[0]
        inner = get_args(hint)
    many, keyed = get_origin(hint) is list, get_origin(hint) is dict
    hint = inner[-1] if keyed else inner[0] if many else hint
    if keyed and get_origin(hint) is list:
        many, hint = True, get_args(hint)[0]
    kind = _KINDS.get(hint, "item" if is_dataclass(hint) else "text")
    choices = tuple(each.metadata.get("choices", ()))
    if isinstance(hint, type) and issubclass(hint, enum.Enum):
        kind, choices = "choice", choices or tuple(hint.__members__)
        meaning = meaning or " ".join((hint.__doc__ or "").split())
    default = each.default if each.default is not MISSING else REQUIRED
    default = default if each.default_factory is MISSING else each.default_factory()
    default, instead = values.get(key, default), each.metadata.get("instead", {})
    return Option(key, kind, default, meaning, tuple(map(str, choices)), many, keyed, optional, instead)


@cache
def _meanings(configuration: type) -> dict[str, str]:
    """The docstring of each field, by name, inherited fields included."""
    found: dict[str, str] = {}
    for kind in reversed(configuration.__mro__):
        if is_dataclass(kind):
            documented = parse_from_object(kind).params
            found |= {each.arg_name: " ".join(each.description.split()) for each in documented if each.description}
    return found


def _documentation(configuration: type) -> str:
    return (inspect.getdoc(configuration) or "").partition("\nAttributes:")[0].strip()


@cache
def _read(file: Path) -> Preset:
    import yaml

    text = file.read_text()
    return Preset.of(text, yaml.load(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader)))
