"""Check the types of the arguments of public functions, so that errors name the argument and what to do."""

from collections.abc import Callable
from functools import wraps
from inspect import signature
from typing import TypeVar

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Poses3D
from dmae.data.skeleton import Skeleton

F = TypeVar("F", bound=Callable)

_ONE = {
    "Clip": Clip,
    "Poses3D": Poses3D,
    "Poses3D | None": Poses3D | None,
    "CameraRig": CameraRig,
    "Skeleton": Skeleton,
}
"""The annotations that are checked, and the types that they allow."""

_SEVERAL = {"Iterable[Clip]", "Sequence[Clip]", "Clip | Sequence[Clip]", "str | Path | Iterable[Clip]"}

_ADVICE = {
    ("Clip", str): "dmae.load reads a clip, dmae.read a recording",
    ("Clip", Poses3D): "dataclasses.replace(clip, poses=poses) is a clip with these poses",
    ("Clip", list): "give one of them",
    ("Clip", np.ndarray): "dmae.Clip is made of cameras and dmae.Detections2D",
    ("Poses3D", Clip): "dmae.capture(clip) returns poses; a captured clip has clip.poses",
    ("Poses3D", np.ndarray): "dmae.Poses3D(skeleton, xyz) is made of an array",
    ("Poses3D", str): "dmae.read_poses(path).poses reads a file",
    ("CameraRig", Clip): "give clip.rig",
    ("Skeleton", str): "dmae.get_skeleton returns a skeleton by its name",
    ("clips", Clip): "give [clip]",
    ("clips", str): "dmae.load_dataset reads the clips of a folder",
}
"""What to do with a value of the second type where the first is expected."""


def checked(function: F) -> F:
    """Return the function, with a check of each argument that is annotated as clip, poses, rig or skeleton.

    The check comes before Python's own check for missing arguments, because an argument of the wrong type is often the
    cause of a missing one.

    Raises:
        TypeError: an argument has another type; the message names the argument, its type, and what to do.
    """
    parameters = signature(function)
    annotations = {name: parameter.annotation for name, parameter in parameters.parameters.items()}

    @wraps(function)
    def with_checks(*args, **kwargs):
        try:
            given = parameters.bind_partial(*args, **kwargs).arguments
        except TypeError:
            return function(*args, **kwargs)  # an unknown argument: Python's message names it
        for name, value in given.items():
            _check(f"{function.__name__}: {name}", annotations[name], value)
        return function(*args, **kwargs)

    return with_checks


def _check(name: str, annotation: str, value: object) -> None:
    if annotation in _ONE and not isinstance(value, _ONE[annotation]):
        raise _wrong(name, annotation.removesuffix(" | None"), value)
    if annotation not in _SEVERAL:
        return
    if isinstance(value, Clip):
        if not annotation.startswith("Clip"):
            raise _wrong(name, "clips", value)
    elif isinstance(value, list | tuple):
        for index, each in enumerate(value):
            if not isinstance(each, Clip):
                raise _wrong(f"{name}[{index}]", "Clip", each)
    elif isinstance(value, np.ndarray | Poses3D) or (_is_path(value) and "Path" not in annotation):
        raise _wrong(name, "clips", value)


def _is_path(value: object) -> bool:
    return isinstance(value, str) or hasattr(value, "__fspath__")


def _wrong(name: str, expected: str, value: object) -> TypeError:
    kind = str if _is_path(value) else type(value)
    advice = _ADVICE.get((expected, list if kind is tuple else kind))
    said = f"an array of shape {value.shape}" if isinstance(value, np.ndarray) else f"a {type(value).__name__}"
    said = f"{value!r:.80}" if kind is str else said
    wanted = "several clips" if expected == "clips" else f"a dmae.{expected}"
    return TypeError(f"{name}: expected {wanted}, found {said}{f'; {advice}' if advice else ''}")
