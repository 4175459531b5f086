"""Array fields of frozen dataclasses: convert them to their type, check their shape, compare and print them."""

from dataclasses import fields
from typing import Any

import numpy as np

from dmae.files.mapped import LARGE

_LONGEST_EMPTY = 1_000_000
"""Largest length of an axis in an array of size zero. A file can state any length if another axis has length 0."""
_MOST_SHOWN = 8  # Longest tuple that is printed whole
UNSET: Any = None
"""Default of an array that `__post_init__` makes."""


def set_array(owner: Any, name: str, dtype: type, shape: tuple[int | str, ...], default: float | None = None) -> None:
    """Convert a field of a frozen dataclass, in its `__post_init__`, to an array of a shape.

    An axis of any length is given by its letter, as "F". A field that is None becomes an array of the default. Raises
    ValueError if the array has another shape.
    """
    value, place = getattr(owner, name), f"{type(owner).__name__}.{name}"
    array = _full(shape, default, dtype) if value is None else as_numbers(place, value, dtype)
    if array.ndim != len(shape) or any(want not in (n, str(want)) for want, n in zip(shape, array.shape, strict=True)):
        expected = f"({', '.join(map(str, shape))}{',' if len(shape) == 1 else ''})"
        raise ValueError(f"{place}: expected shape {expected}, found {array.shape}")
    if array.size == 0 and max(array.shape, default=0) > _LONGEST_EMPTY:
        raise ValueError(f"{place}: found an empty array of shape {array.shape}")
    object.__setattr__(owner, name, array)


def as_numbers(name: str, value: Any, dtype: type = np.float64) -> np.ndarray:
    """Return a value as an array; TypeError, with its name, if it is not an array of numbers."""
    try:
        # Numbers too large for the type become infinite. `check_numbers` of their owner refuses them.
        with np.errstate(over="ignore"):
            return np.asarray(value, dtype)
    except (TypeError, ValueError):
        found = repr(value) if isinstance(value, str) else type(value).__name__
        if isinstance(value, list | tuple):
            found += " with parts that are no numbers, or of different lengths"
        raise TypeError(f"{name}: expected an array of numbers, found {found:.80}") from None


def same_fields(self: Any, other: Any) -> bool:
    """Compare dataclasses field by field (`__eq__ = same_fields`): arrays as wholes, where NaN equals NaN."""
    if type(self) is not type(other):
        return NotImplemented
    return all(_same(getattr(self, field.name), getattr(other, field.name)) for field in fields(self))


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    return one == other


def short_repr(self: Any) -> str:
    """Return a dataclass as text (`__repr__ = short_repr`): arrays by shape, skeletons by name, dictionaries by keys.

    Fields that are None or empty are left out.
    """
    found = {field.name: getattr(self, field.name) for field in fields(self)}
    empty = [name for name, value in found.items() if value is None or (isinstance(value, dict | tuple) and not value)]
    shown = (f"{name}={_short(value)}" for name, value in found.items() if name not in empty)
    return f"{type(self).__name__}({', '.join(shown)})"


def _short(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.dtype}[{', '.join(map(str, value.shape))}]"
    if isinstance(value, dict):
        return f"{{{', '.join(map(str, value))}}}"
    if isinstance(value, tuple) and len(value) > _MOST_SHOWN:
        return f"({value[0]!r}, ..., {value[-1]!r})"
    return value.name if hasattr(value, "joints") else repr(value)


def _full(shape: tuple[Any, ...], value: float | None, dtype: type) -> np.ndarray:
    """Return an array filled with one value. A large array is read-only and takes no memory."""
    filled = np.broadcast_to(np.array(value, dtype), shape)
    return filled if filled.nbytes >= LARGE else filled.copy()
