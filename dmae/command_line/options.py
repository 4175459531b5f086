"""The options of a command: names, types, defaults, choices and meanings, from the source of its configuration."""

import ast
import enum
import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

from dmae.command_line.source import DataclassSource, Module, Unreadable
from dmae.data.resources import resource_folder
from dmae.registry import Registry

REQUIRED = "???"
"""Default of an option that has to be given."""
_TYPES = {"int": "whole number", "float": "number", "bool": "true or false", "str": "text"}


@dataclass(frozen=True)
class Option:
    """One `key=value`.

    Attributes:
        key: With the groups that it is in, as users type it.
        kind: Of its value, or of each where it is a list: "whole number", "number", "true or false", "text", "choice".
        default: Its value if it is not given; `REQUIRED` where it must be; None for none.
        meaning: From the docstring.
        choices: All values that are allowed; none where any is.
        many: Whether it is a list.
        keyed: Whether it is a dictionary, and `key.anything=value` is allowed.
    """

    key: str
    kind: str
    default: object
    meaning: str
    choices: tuple[str, ...] = ()
    many: bool = False
    keyed: bool = False
    optional: bool = False


@dataclass(frozen=True)
class Group:
    """Options under a common name.

    Attributes:
        key: With the groups that it is in; empty for a whole command.
        meaning: From the docstring.
        members: In the order of the source.
        presets: Names that `key=name` can be, with the help of their files; empty if there are none.
        preset: The one that is used if none is given; `REQUIRED` where one must be.
    """

    key: str
    meaning: str
    members: tuple["Option | Group", ...] = ()
    presets: dict[str, str] = field(default_factory=dict)
    preset: str | None = None

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
    """An entry of a registry that `key=name` stands for.

    Attributes:
        meaning: One line of help.
        values: Options of the group and their values.
    """

    meaning: str
    values: dict[str, object]


Registries = dict[str, Callable[[], dict[str, Preset]]]
"""Functions that return the presets of groups by name, where a registry has them rather than files in `configs/`."""


def presets_of(registry: Registry, option: str) -> Callable[[], dict[str, Preset]]:
    """Return a function that returns the presets of a registry: `option` of the group is the name of the entry."""
    return lambda: {name: Preset(entry.help, {option: name}) for name, entry in registry.items()}


def read_options(
    configuration: DataclassSource, name: str, folders: tuple[Path, ...] = (), registries: Registries | None = None
) -> Group:
    """The options of a command.

    Args:
        configuration: The source of its dataclass.
        name: Of its file in `configs/`, which says what presets are used unless others are named.
        folders: More folders of presets (`--config-dir`).
        registries: More presets, by group.
    """
    places = (resource_folder("dmae", "configs"), *folders)
    chosen = _chosen_presets(places[0] / f"{name}.yaml")
    registered = {group: presets() for group, presets in (registries or {}).items() if group in chosen}
    values: dict[str, object] = {}
    for group, preset in chosen.items():
        if preset in registered.get(group, {}):
            values |= dict(_leaves(registered[group][preset].values, group))
        file = places[0] / group / f"{preset}.yaml"
        if file.is_file():
            package = "" if "@package _global_" in file.read_text() else group
            values |= dict(_leaves(_yaml(file), package))
    return _with_presets(_group(configuration, "", values), chosen, places, registered)


def _group(source: DataclassSource, key: str, values: dict[str, object]) -> Group:
    members = []
    for statement, meaning, module in source.fields():
        name = f"{key}.{statement.target.id}".lstrip(".")
        if name == "hydra":
            continue
        members.append(_member(statement, name, meaning, module, values))
    return Group(key, source.documentation, tuple(members))


def _member(
    statement: ast.AnnAssign, key: str, meaning: str, module: Module, values: dict[str, object]
) -> Option | Group:
    annotation, many, keyed, optional = statement.annotation, False, False, False
    if isinstance(annotation, ast.BinOp):  # X | None
        annotation, optional = annotation.left, True
    if isinstance(annotation, ast.Subscript):
        many, keyed = annotation.value.id == "list", annotation.value.id == "dict"
        annotation = annotation.slice.elts[-1] if keyed else annotation.slice
    kind = _TYPES.get(annotation.id) if isinstance(annotation, ast.Name) else "text"
    choices: tuple[str, ...] = ()
    if kind is None:
        value = _value(module, annotation)
        if isinstance(value, DataclassSource):
            if not (many or keyed):
                group = _group(value, key, values)
                return replace(group, meaning=meaning or group.meaning)
            kind = "entry"
        else:
            kind, choices = "choice", tuple(_names(value))
            meaning = meaning or " ".join((value.__doc__ or "").split())
    default, metadata = _default(statement.value, module)
    if "choices" in metadata:
        choices = tuple(_names(metadata["choices"]))
    if key in values:
        default = values[key]
    return Option(key, kind, default, meaning, choices, many, keyed, optional)


def _default(node: ast.expr | None, module: Module) -> tuple[object, dict]:
    """The default value of a field, and its metadata."""
    if node is None:
        return REQUIRED, {}
    if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "field"):
        return _value(module, node), {}
    given = {keyword.arg: keyword.value for keyword in node.keywords}
    metadata = _value(module, given["metadata"]) if "metadata" in given else {}
    if "default_factory" not in given:
        return (_value(module, given["default"]) if "default" in given else REQUIRED), metadata
    factory = given["default_factory"]
    if isinstance(factory, ast.Lambda):
        return _value(module, factory.body), metadata
    return _value(module, ast.Call(factory, [], []), ast.unparse(factory)), metadata


def _value(module: Module, node: ast.expr, text: str | None = None):
    """The value of an expression: from the source, or where that does not tell, from the module itself, imported."""
    ast.fix_missing_locations(node)
    try:
        return module.evaluate(node)
    except Unreadable:
        imported = importlib.import_module(module.name)
        return eval(compile(ast.Expression(node), module.name, "eval"), dict(vars(imported)))


def _names(values) -> list[str]:
    """The names of an enum's members, or of the entries of a registry."""
    if isinstance(values, type) and issubclass(values, enum.Enum):
        return list(values.__members__)
    return [str(value) for value in values]


def _chosen_presets(file: Path) -> dict[str, str]:
    """The `defaults:` of a command's file: which preset of each group."""
    if not file.is_file():
        return {}
    entries = [entry for entry in _yaml(file).get("defaults", []) if isinstance(entry, dict)]
    return {key: value for entry in entries for key, value in entry.items() if not key.startswith("override ")}


def _with_presets(
    group: Group, chosen: dict[str, str], places: tuple[Path, ...], registered: dict[str, dict[str, Preset]]
) -> Group:
    """The options of a command, those groups that have presets with their names."""
    members = []
    for member in group.members:
        if isinstance(member, Group) and member.key in chosen:
            files = {file.stem: file for place in places for file in sorted((place / member.key).glob("*.yaml"))}
            presets = {name: preset.meaning for name, preset in registered.get(member.key, {}).items()}
            presets |= {name: _comment(file) for name, file in files.items()}
            member = replace(member, presets=presets, preset=chosen[member.key])
        members.append(member)
    return replace(group, members=tuple(members))


def _comment(file: Path) -> str:
    """Return the comment at the top of a preset's file, without Hydra's own line."""
    lines = []
    for line in file.read_text().splitlines():
        if not line.startswith("#"):
            break
        if "@package" not in line:
            lines.append(line.lstrip("# "))
    return " ".join(lines)


def _yaml(file: Path) -> dict:
    import yaml

    return yaml.load(file.read_text(), getattr(yaml, "CSafeLoader", yaml.SafeLoader)) or {}


def _leaves(values: dict, prefix: str) -> Iterator[tuple[str, object]]:
    for key, value in values.items():
        name = f"{prefix}.{key}".lstrip(".")
        if isinstance(value, dict):
            yield from _leaves(value, name)
        else:
            yield name, value
