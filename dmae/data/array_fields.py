"""Convert array fields of frozen dataclasses to their type, and check their shape."""

from typing import Any

import numpy as np

from dmae.files.mapped import LARGE

_LONGEST_EMPTY = 1_000_000
"""Largest length of an axis in an array of size zero. A file can state any length if another axis has length 0."""
ANY = -1
"""Marks an axis of any length in an expected shape."""


def set_array(owner: Any, name: str, dtype: type, shape: tuple[int, ...], default: float | None = None) -> None:
    """Convert a field of a frozen dataclass to an array of a checked shape. Call it in `__post_init__`.

    Args:
        owner: The dataclass instance.
        name: Name of the field.
        dtype: Type of the array.
        shape: Expected shape; `ANY` matches any length.
        default: Value that fills the array if the field is None.

    Raises:
        ValueError: the array has another shape.
    """
    value = getattr(owner, name)
    # Numbers too large for the type become infinite. `check_numbers` of the owner refuses them.
    with np.errstate(over="ignore"):
        array = _full(shape, default, dtype) if value is None else np.asarray(value, dtype)
    if array.ndim != len(shape) or any(want not in (ANY, n) for want, n in zip(shape, array.shape, strict=True)):
        expected = tuple("any" if n == ANY else n for n in shape)
        raise ValueError(f"{type(owner).__name__}.{name}: expected shape {expected}, found {array.shape}")
    if array.size == 0 and max(array.shape, default=0) > _LONGEST_EMPTY:
        raise ValueError(f"{type(owner).__name__}.{name}: found an empty array of shape {array.shape}")
    object.__setattr__(owner, name, array)


def _full(shape: tuple[int, ...], value: float, dtype: type) -> np.ndarray:
    """Return an array filled with one value. A large array is read-only and takes no memory."""
    filled = np.broadcast_to(np.array(value, dtype), shape)
    return filled if filled.nbytes >= LARGE else filled.copy()
