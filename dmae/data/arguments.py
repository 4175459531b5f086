"""Arguments of public functions: a wrong type, or a mistyped name, is answered in one line by what was expected."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, wraps
from numbers import Integral, Real
from pathlib import Path
from types import NoneType, SimpleNamespace, UnionType
from typing import Any, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Poses3D
from dmae.data.skeleton import Skeleton
from dmae.nearest import suggestion

P = ParamSpec("P")
R = TypeVar("R")

_KINDS: dict[Any, tuple[Any, str, str]] = {
    bool: (bool, "True or False", ""),
    int: (Integral, "a whole number", ""),
    float: (Real, "a number", ""),
    str: (str, "a text", ""),
    Callable: (Callable, "a function", ""),
    Path: (os.PathLike, "a path", ""),
    Clip: (Clip, "a dmae.Clip", "dmae.load reads a clip, dmae.read a recording"),
    Poses3D: (
        Poses3D,
        "dmae.Poses3D",
        "dmae.capture(clip) returns poses, dmae.read_poses(path).poses reads them from a file, and "
        "dmae.Poses3D(skeleton, xyz) takes an array",
    ),
    CameraRig: (CameraRig, "a dmae.CameraRig", "clip.rig has the cameras of a clip"),
    Skeleton: (Skeleton, "a dmae.Skeleton", "poses.skeleton is the skeleton of poses"),
    NoneType: (NoneType, "None", ""),
}
"""What is accepted for an annotation, how it is called, and where one gets it."""
_SERIES = (list, tuple, Sequence, Iterable)


def check_arguments(function: Callable[P, R]) -> Callable[P, R]:
    """Decorate a public function, or `__init__`: it answers arguments that its annotations do not allow by a TypeError.

    One text, path or function is taken for a list of it, as on the command line. Arguments of other types, as
    configurations and arrays, are left to the function.
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
        hints = checked_types(function)
        taken = {name: _taken(name, value, hints[name]) if name in hints else value for name, value in given.items()}
        return function(*[taken.pop(name) for name in list(taken)[: len(args)]], **taken)  # type: ignore[arg-type]

    return checked


@cache
def checked_types(function: Callable) -> dict[str, Any]:
    """Return the annotations of the parameters that are checked here."""
    hints = {}
    for name, annotation in function.__annotations__.items():
        try:
            hint = get_type_hints(SimpleNamespace(__annotations__={name: annotation}), function.__globals__)[name]
        except NameError:
            continue  # A configuration, imported for type checkers only
        if name != "return" and _is_checked(hint):
            hints[name] = hint
    return hints


def _is_checked(hint: Any) -> bool:
    return all(one in _KINDS or _series(one) or _mapping(one) for one in _united(hint))


def _united(hint: Any) -> tuple[Any, ...]:
    return get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)


def _series(hint: Any) -> bool:
    return get_origin(hint) in _SERIES


def _mapping(hint: Any) -> bool:
    return get_origin(hint) in (dict, Mapping) or hint is dict


def _taken(name: str, value: Any, hint: Any) -> Any:
    """Return a value, one in a list where a list of such is expected; TypeError, with the name, for another type."""
    kinds = _united(hint)
    if any(_is(value, kind) for kind in kinds):
        return value
    for kind in filter(_series, kinds):
        of_each = get_args(kind)[0]
        if isinstance(value, list | tuple):
            for index, each in enumerate(value if _is_checked(of_each) else ()):
                _taken(f"{name}[{index}]", each, of_each)
            return value
        if any(one in (str, Path, Callable) and _is(value, one) for one in _united(of_each)):
            return [value]
    words = [_words(kind) for kind in kinds if kind is not NoneType and not (kind is str and Path in kinds)]
    advice = "".join(f"; {_KINDS[kind][2]}" for kind in kinds if kind in _KINDS and _KINDS[kind][2])
    raise TypeError(f"{name}: expected {' or '.join(words)}, found {_shown(value)}{advice}")


def _is(value: Any, kind: Any) -> bool:
    if _mapping(kind):
        return isinstance(value, Mapping)
    if _series(kind):
        # Iterables that are read as they go are not looked into.
        listed = Sequence if get_origin(kind) is Sequence else Iterable
        given = isinstance(value, listed) or hasattr(value, "__getitem__")
        return given and not isinstance(value, str | bytes | Mapping | list | tuple)
    if isinstance(value, bool) and kind in (int, float):
        return False
    return isinstance(value, _KINDS[kind][0])


def _words(kind: Any) -> str:
    if _mapping(kind):
        return "a dictionary"
    if not _series(kind):
        return _KINDS[kind][1]
    each = get_args(kind)[0]
    if each is Clip:
        return "several clips, as dmae.load_dataset(path)"
    nouns = {int: " of whole numbers", float: " of numbers", str: " of texts"}
    return f"a list{nouns.get(each, '')}"


def _shown(value: Any) -> str:
    """Return a value in one short line: simple ones as they are, others by their type."""
    simple = value is None or isinstance(value, str | int | float | os.PathLike | list | tuple | dict)
    text = repr(value)[:80] if simple else type(value).__name__
    return text.partition("\n")[0]
