"""Checks of the parameters of detector errors."""

from collections.abc import Iterable, Sequence


def check_probabilities(error: str, config: object, names: Iterable[str]) -> None:
    """Raise ValueError if one of these fields of `detector.<error>` is not from 0 to 1."""
    for name in names:
        found = getattr(config, name)
        if not 0 <= found <= 1:
            raise ValueError(f"detector.{error}.{name}: expected a number from 0 to 1, got {found}")


def check_amounts(error: str, config: object, names: Iterable[str]) -> None:
    """Raise ValueError if one of these fields of `detector.<error>` is negative or not finite."""
    for name in names:
        found = getattr(config, name)
        if not 0 <= found < float("inf"):
            raise ValueError(f"detector.{error}.{name}: expected 0 or more, got {found}")


def check_beta(name: str, shape: Sequence[float]) -> None:
    """Raise ValueError if `shape` is not (a, b) of a Beta distribution. With b = 0 the value is always 1."""
    if len(shape) != 2 or not shape[0] > 0 or not shape[1] >= 0:
        raise ValueError(f"{name}: expected a > 0 and b >= 0 of a Beta distribution, got {list(shape)}")
