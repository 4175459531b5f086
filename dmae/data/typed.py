"""Values of annotated types: arguments of public functions, fields of configurations and contents of files.

All are checked alike. A value of another type is answered in one line, by its name and by what was expected.
"""

import inspect
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass, replace
from enum import Enum
from functools import cache, wraps
from math import isfinite
from numbers import Integral, Real
from pathlib import Path
from types import FunctionType, NoneType, UnionType
from typing import Any, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

from dmae.nearest import nearest, suggestion

P = ParamSpec("P")
R = TypeVar("R")

_LARGEST = 1e9  # Largest absolute value of a float
_TEXT = (str, os.PathLike)
_KINDS: dict[Any, tuple[Any, str]] = {
    bool: (bool, "True or False"),
    int: (Integral, "a whole number"),
    float: (Real, "a number"),
    str: (_TEXT, "a text"),
    Path: (_TEXT, "a path"),
    Callable: (Callable, "a function"),
    dict: (Mapping, "a dictionary"),
    Mapping: (Mapping, "a dictionary"),
}
"""What is accepted for an annotation, and how it is called."""
_NOUNS = {int: " of whole numbers", float: " of numbers", str: " of texts"}
_ADVICE = {
    "Clip": "dmae.load reads a clip, dmae.read a recording",
    "Poses3D": (
        "dmae.capture(clip) returns poses, dmae.read_poses(path).poses reads them from a file, and "
        "dmae.Poses3D(skeleton, xyz) takes an array"
    ),
    "CameraRig": "clip.rig has the cameras of a clip",
    "Skeleton": "dmae.get_skeleton(name) returns one",
    "Decision": "entry.decision('blank') makes one of an entry of dmae.review",
}
"""Where one gets an object, by the name of its class."""


class WrongTypeError(TypeError, ValueError):
    """A value of another type than expected. It is a ValueError as well, as other mistakes in files and options are."""


def decode(kind: Any, value: Any, name: str = "") -> Any:
    """Return a value as an annotated type: a value of `json.loads`, or one that Python gives.

    Dictionaries become dataclasses; lists, tuples and lists what is annotated of them; names of enums their members.
    One text, path or function is taken for a list of it. Iterables that are read as they go are not looked into.

    Raises WrongTypeError, with `name` and what follows it, for another type; ValueError for a number of another size
    than any length, time or rate.
    """
    name = name or getattr(kind, "__name__", str(kind))
    united = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
    if value is None and NoneType in united:
        return None
    kinds = [one for one in united if one is not NoneType and not (one is str and Path in united)]
    for one in kinds:
        if _fits(one, value):
            return _taken(one, value, name)
    configured = any(isinstance(one, type) and issubclass(one, Configuration) for one in kinds)
    words = ["the name of a preset" if configured and one in (str, Path) else _words(one) for one in kinds]
    advice = "".join(f"; {_ADVICE[one.__name__]}" for one in kinds if getattr(one, "__name__", "") in _ADVICE)
    if str in kinds and isinstance(value, FunctionType):
        named = f"{value.__module__}:{value.__qualname__}"
        local = "<" in named  # A lambda or a function inside another: nothing finds them by name
        advice += f"; {'define it in a module and ' * local}name it, as {'module:function' if local else named!r}"
    raise WrongTypeError(f"{name}: expected {_either(words)}, found {_shown(value)}{advice}")


def _fits(kind: Any, value: Any) -> bool:
    """Return whether a value is of a kind, not looking at what it contains."""
    plain = get_origin(kind) or kind
    if plain in _KINDS:
        return isinstance(value, _KINDS[plain][0]) and not (isinstance(value, bool) and plain in (int, float))
    if plain in (list, tuple, Sequence, Iterable):
        return isinstance(value, list | tuple) or _is_one(kind, value) or _is_read_later(plain, value)
    if not isinstance(kind, type) or kind is Any or kind.__module__ == "numpy":
        return True  # Left to the function
    return isinstance(value, kind) or (is_dataclass(kind) and isinstance(value, dict)) or issubclass(kind, Enum)


def _is_one(kind: Any, value: Any) -> bool:
    """Return whether a value is one text, path, name of an enum or function where a list of them is expected."""
    (inner, *_) = get_args(kind)
    kinds = get_args(inner) if get_origin(inner) in (Union, UnionType) else (inner,)
    named = isinstance(value, _TEXT) and any(isinstance(one, type) and issubclass(one, Enum) for one in kinds)
    return named or any(one in (str, Path, Callable) and _fits(one, value) for one in kinds)


def _is_read_later(plain: Any, value: Any) -> bool:
    if plain in (list, tuple) or isinstance(value, str | bytes | Mapping):
        return False
    return isinstance(value, plain) or hasattr(value, "__getitem__")


def _taken(kind: Any, value: Any, name: str) -> Any:
    """Return a value that fits a kind, with what it contains, as that kind."""
    plain, inner = get_origin(kind) or kind, get_args(kind)
    if plain in (list, tuple, Sequence, Iterable):
        value = [value] if _is_one(kind, value) else value
        if not isinstance(value, list | tuple):
            return value
        each = inner if plain is tuple and inner[-1] is not Ellipsis else (inner[0],) * len(value)
        if len(each) != len(value):
            raise WrongTypeError(f"{name}: expected {len(each)} values, found {len(value)}")
        taken = (decode(one, item, f"{name}[{i}]") for i, (one, item) in enumerate(zip(each, value, strict=True)))
        return tuple(taken) if plain is tuple else list(taken)
    if plain in (dict, Mapping):
        return {key: decode(inner[1], item, f"{name}.{key}") for key, item in value.items()} if inner else value
    if plain is float:
        if not abs(number := float(value)) <= _LARGEST:
            raise ValueError(f"{name}: expected a number up to {_LARGEST:g}, found {value!r:.40}")
        return number
    if plain is int:
        return int(value)
    if plain is str:
        return os.fspath(value)
    if isinstance(kind, type) and issubclass(kind, Enum):
        try:
            return kind(value)
        except ValueError:
            raise WrongTypeError(f"{name}={value!r:.40}: expected one of {', '.join(kind.__members__)}") from None
    if isinstance(value, dict) and is_dataclass(kind):
        made: Any = kind
        names = {each.name for each in fields(kind)}
        needed = {f.name for f in fields(kind) if f.default is MISSING and f.default_factory is MISSING}
        if not needed <= set(value) <= names:
            wrong = sorted(value.keys() - names, key=str)
            near = nearest(str(wrong[0]), names) if wrong else None
            meant = f"; did you mean {near}?" if near else ""
            raise WrongTypeError(f"{name}: expected the fields {sorted(names)}, found {sorted(value, key=str)}{meant}")
        hints = type_hints(made)
        return made(**{field: decode(hints[field], item, f"{name}.{field}") for field, item in value.items()})
    return value


def _words(kind: Any) -> str:
    plain, inner = get_origin(kind) or kind, get_args(kind)
    if plain in _KINDS:
        return _KINDS[plain][1]
    if plain in (list, tuple, Sequence, Iterable):
        if getattr(inner[0], "__name__", "") == "Clip":
            return "several clips, as dmae.load_dataset(path)"
        return f"a list{_NOUNS.get(inner[0], '')}"
    return f"a {kind.__module__.partition('.')[0]}.{kind.__name__}"


def _either(words: list[str]) -> str:
    return " or ".join(filter(None, (", ".join(words[:-1]), words[-1])))


def _shown(value: Any) -> str:
    """Return a value in one short line: simple ones as they are, others by their type."""
    simple = value is None or isinstance(value, str | int | float | os.PathLike | list | tuple | dict)
    return " ".join(repr(value).split())[:80] if simple else type(value).__name__


@cache
def type_hints(owner: Any) -> dict[str, Any]:
    """Return the annotations of a dataclass, or of the parameters of a function."""
    if isinstance(owner, type):
        return get_type_hints(owner)
    hints: dict[str, Any] = {}
    for name, annotation in owner.__annotations__.items():
        try:
            hints |= get_type_hints(type("_", (), {"__annotations__": {name: annotation}}), owner.__globals__)
        except NameError:
            continue  # It is imported for type checkers only, and left to the function
    return hints


def _given(kind: Any, value: Any, name: str) -> Any:
    """Return a value of Python as an annotated type. Numbers that are not finite are left to their owner, which says
    what range is expected."""
    several = value if isinstance(value, list | tuple) else [value]
    finite = all(isfinite(each) for each in several if isinstance(each, float))
    return decode(kind, value, name) if finite else value


REQUIRED: Any = "???"
"""Default of an option that has to be given, as Hydra spells it."""


class Configuration:
    """Base of a configuration, a frozen dataclass: its fields are brought to their types when one is made.

    A configuration is the only declaration of its options: Python, Hydra, `--help` and the reference page read it. Its
    constructor answers a name that is no field by the field that is meant, in a TypeError.
    """

    def __new__(cls, *_: Any, **given: Any):
        for name in given.keys() - {each.name for each in fields(cls)}:  # type: ignore[arg-type]
            raise TypeError(f"{cls.__name__}: no field {name}; {fields_meant(cls, name)}")
        return super().__new__(cls)

    def __post_init__(self):
        kind: Any = type(self)
        hints = type_hints(kind)
        for name in (each.name for each in fields(self)):  # type: ignore[arg-type]
            object.__setattr__(self, name, _given(hints[name], getattr(self, name), f"{kind.__name__}.{name}"))


def with_changes(config: Any, changes: dict[str, Any]) -> Any:
    """Return a configuration with some fields changed; a dictionary changes some fields of a nested configuration."""
    nested = {name: getattr(config, name, None) for name, value in changes.items() if isinstance(value, Mapping)}
    merged = {name: with_changes(old, changes[name]) for name, old in nested.items() if isinstance(old, Configuration)}
    return replace(config, **changes | merged)


def fields_meant(kind: type, name: str, also: Iterable[str] = ()) -> str:
    """Return the text for a name that is no field of a configuration: the most similar ones, of its groups as well.

    `also` are names that are accepted besides.
    """
    places = [(each, each) for each in also] + list(_places(kind))
    near = nearest(name, [each for each, _ in places])
    if not near:
        return suggestion(name, list(type_hints(kind)))
    meant = [place for each, place in places if each == near]
    meant = meant[:1] if near in meant else meant[:3]
    return f"did you mean {'one of ' * (len(meant) > 1)}{', '.join(meant)}?"


def _places(kind: Any) -> Iterator[tuple[str, str]]:
    """Yield the name of each field, and how it is given; the fields of groups come last."""
    yield from ((field, field) for field in type_hints(kind))
    for field, group in type_hints(kind).items():
        for name, place in _places(group) if is_dataclass(group) else ():
            yield name, f"{field}={group.__name__}({place if place.endswith(')') else f'{place}=...'})"


def check_arguments(function: Callable[P, R]) -> Callable[P, R]:
    """Decorate a public function, or `__init__`: its arguments are brought to the types of its annotations.

    Raises TypeError for arguments of other types, and for a mistyped name of one.
    """
    known = inspect.signature(function).parameters
    called = function.__qualname__.removesuffix(".__init__")
    names = [name for name in known if name != "self"]
    open_ended = any(each.kind is each.VAR_KEYWORD for each in known.values())

    @wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        for name in kwargs.keys() - known.keys():
            if not open_ended:
                raise TypeError(f"{called}: no argument {name}; {suggestion(name, names)}")
        given = dict(zip(known, args, strict=False)) | kwargs
        if len(given) < len(args) + len(kwargs):
            return function(*args, **kwargs)  # It says that there are too many, or that one is given twice
        hints = type_hints(function)
        taken = {name: _given(hints[name], value, name) if name in hints else value for name, value in given.items()}
        return function(*[taken.pop(name) for name in list(taken)[: len(args)]], **taken)  # type: ignore[arg-type]

    return checked
