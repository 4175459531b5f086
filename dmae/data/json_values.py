"""JSON: readable text, and frozen dataclasses decoded from their fields."""

import json
import os
import re
import types
from collections.abc import Iterable, Iterator
from dataclasses import MISSING, asdict, fields, is_dataclass
from enum import Enum
from functools import cache, wraps
from math import isfinite
from numbers import Integral, Real
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from dmae.nearest import nearest, suggestion


def json_text(value) -> str:
    """Return indented JSON of a value. A list that contains only numbers and nulls takes one line."""
    text = json.dumps(value, indent=1, allow_nan=False)
    return re.sub(
        r"\[\n\s*((?:-?[\d.eE+-]+|null)(?:,\s+(?:-?[\d.eE+-]+|null))*)\s*\n\s*\]",
        lambda found: "[" + re.sub(r"\s+", " ", found[1]) + "]",
        text,
    )


def flat(values: dict, prefix: str = "") -> dict[str, Any]:
    """Return nested values by their dotted names."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        nested = isinstance(value, dict) and value
        found |= flat(value, f"{prefix}{name}.") if nested else {f"{prefix}{name}": value}
    return found


T = TypeVar("T")
_LARGEST = 1e9  # Largest absolute value of a float


def checked(configuration: T, name: str = "") -> T:
    """Return a configuration that Python made, as the command line would read it: names of enums as members, tuples and
    single texts as lists, dictionaries as the configurations of groups.

    Raises ValueError, with the name of the field, if a value has another type than its field.
    """
    return decode(type(configuration), asdict(configuration), name)  # type: ignore[call-overload]


def check_fields(configuration: Any) -> None:
    """Bring the fields of a configuration to their types, as `checked` does, in its `__post_init__`. Raises as it.

    Numbers that are not finite are left to `__post_init__`, which says what range is expected.
    """
    kind: type = type(configuration)
    for field, hint in _hints(kind).items():
        value = getattr(configuration, field)
        several = value if isinstance(value, list | tuple) else [value]
        if not is_dataclass(value) and all(isfinite(each) for each in several if isinstance(each, float)):
            object.__setattr__(configuration, field, decode(hint, value, f"{kind.__name__}.{field}"))


def answer_fields(kind: type[T]) -> type[T]:
    """Decorate a configuration: its constructor answers a name that is no field by what is meant, in a TypeError."""
    init = kind.__init__  # type: ignore[misc]

    @wraps(init)
    def checked_init(self, *args, **given):
        for name in given.keys() - {field.name for field in fields(kind)}:  # type: ignore[arg-type]
            raise TypeError(f"{kind.__name__}: no field {name}; {fields_meant(kind, name)}")
        init(self, *args, **given)

    kind.__init__ = checked_init  # type: ignore[misc]
    return kind


def fields_meant(kind: type, name: str, also: Iterable[str] = ()) -> str:
    """Return the text for a name that is no field of a dataclass: the most similar ones, of its groups as well.

    `also` are names that are accepted besides.
    """
    places = [(each, each) for each in also] + list(_places(kind))
    near = nearest(name, [each for each, _ in places])
    if not near:
        return suggestion(name, [each.name for each in fields(kind)])  # type: ignore[arg-type]
    meant = [place for each, place in places if each == near]
    meant = meant[:1] if near in meant else meant[:3]
    return f"did you mean {'one of ' * (len(meant) > 1)}{', '.join(meant)}?"


def _places(kind: type) -> Iterator[tuple[str, str]]:
    """The names of all fields of a dataclass, those of its groups last, and how each is given."""
    groups = []
    for field, hint in _hints(kind).items():
        yield field, field
        groups += [(field, hint)] if is_dataclass(hint) else []
    for field, group in groups:
        for name, place in _places(group):
            yield name, f"{field}={group.__name__}({place if place.endswith(')') else f'{place}=...'})"


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def decode(kind: Any, value: Any, name: str = "") -> Any:
    """Return a value of `json.loads` as a type: dataclasses, tuples, lists, dicts, enums, optionals,
    JSON's own.

    Raises ValueError, with the path `name` of the field, if it does not have this type.
    """
    where = name or getattr(kind, "__name__", str(kind))
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        if value is None and type(None) in inner:
            return None
        *kinds, kind = (one for one in inner if one is not type(None))
        return value if isinstance(value, tuple(kinds)) else decode(kind, value, name)
    if isinstance(kind, type) and is_dataclass(kind):
        if isinstance(value, kind):
            return value
        names = {f.name for f in fields(kind)}
        needed = {f.name for f in fields(kind) if f.default is MISSING and f.default_factory is MISSING}
        if not isinstance(value, dict) or not needed <= set(value) <= names:
            found = sorted(value) if isinstance(value, dict) else type(value).__name__
            raise ValueError(f"{where}: expected the fields {sorted(names)}, found {found}")
        of_fields = _hints(kind)
        return kind(**{field: decode(of_fields[field], item, f"{where}.{field}") for field, item in value.items()})
    if origin in (list, tuple):
        if isinstance(value, str) and _is_text(inner[0]):
            value = [value]
        if not isinstance(value, list | tuple):
            raise ValueError(f"{where}: expected a list, found {_shown(value)}")
        each = inner if origin is tuple and inner[-1] is not Ellipsis else (inner[0],) * len(value)
        if len(each) != len(value):
            raise ValueError(f"{where}: expected {len(each)} values, found {len(value)}")
        return origin(decode(one, item, f"{where}[{i}]") for i, (one, item) in enumerate(zip(each, value, strict=True)))
    if origin is dict:
        if not isinstance(value, dict):
            raise ValueError(f"{where}: expected an object, found {type(value).__name__}")
        return {key: decode(inner[1], item, f"{where}.{key}") for key, item in value.items()}
    if isinstance(kind, type) and issubclass(kind, Enum):
        try:
            return kind(value)
        except ValueError:
            known = ", ".join(kind.__members__)
            raise ValueError(f"{where}={value!r:.40}: expected one of {known}") from None
    if kind is float and isinstance(value, Real) and not isinstance(value, bool):
        if not abs(number := float(value)) <= _LARGEST:
            raise ValueError(f"{where}: expected a number up to {_LARGEST:g}, found {value!r:.40}")
        return number
    if kind is int and isinstance(value, Integral) and not isinstance(value, bool):
        return int(value)
    if kind is str and isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(kind, type) and not isinstance(value, kind):
        raise ValueError(f"{where}: expected {kind.__name__}, found {_shown(value)}")
    return value


def _is_text(kind: Any) -> bool:
    """Return whether values of a type are written as texts: texts, names of enums, or one of several types that is."""
    return kind is str or str in get_args(kind) or (isinstance(kind, type) and issubclass(kind, Enum))


def _shown(value: Any) -> str:
    return " ".join(repr(value).split())[:60]
