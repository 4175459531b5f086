"""Array fields of frozen dataclasses: converted to their type and checked for their shape."""

from typing import Any

import numpy as np

from dmae.files.mapped import LARGE

_LONGEST_EMPTY = 1_000_000
"""Length of an axis where another has length zero: a file without contents can state any."""
ANY = -1
"""In an expected shape: an axis of any length."""


def set_array(owner: Any, name: str, dtype: type, shape: tuple[int, ...], default: float | None = None) -> None:
    """Convert a field of a frozen dataclass to an array of a checked shape. Call it in `__post_init__`.

    Args:
        owner: The dataclass instance.
        name: The field.
        dtype: Type of the array.
        shape: Expected shape; `ANY` matches any length.
        default: What fills the array where the field is None.

    Raises:
        ValueError: the array has another shape.
    """
    value = getattr(owner, name)
    # What is too large for the type becomes infinite, which is for the owner to judge.
    with np.errstate(over="ignore"):
        array = _full(shape, default, dtype) if value is None else np.asarray(value, dtype)
    if array.ndim != len(shape) or any(want not in (ANY, n) for want, n in zip(shape, array.shape, strict=True)):
        expected = tuple("any" if n == ANY else n for n in shape)
        raise ValueError(f"{type(owner).__name__}.{name}: expected shape {expected}, found {array.shape}")
    if array.size == 0 and max(array.shape, default=0) > _LONGEST_EMPTY:
        raise ValueError(f"{type(owner).__name__}.{name}: found an empty array of shape {array.shape}")
    object.__setattr__(owner, name, array)


def _full(shape: tuple[int, ...], value: float, dtype: type) -> np.ndarray:
    """Return an array of one value; a large one is to be read only, and takes no memory."""
    filled = np.broadcast_to(np.array(value, dtype), shape)
    return filled if filled.nbytes >= LARGE else filled.copy()
