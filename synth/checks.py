"""Checks of numbers in configurations. The error names the option, what it expects, and what it found."""

from math import inf


def check_range(
    group: str, config: object, least: float, most: float, *names: str, above: bool = False, unit: str = ""
) -> None:
    """Raise ValueError unless fields of a group of options are numbers from `least` to `most`, or None.

    `most` may be infinite, numbers may not. With `above`, numbers are more than `least`.
    """
    for name in names:
        value = getattr(config, name)
        if value is not None and not _within(value, least, most, above):
            raise ValueError(f"{_path(group, name)}: expected {_bounds(least, most, above, unit)}, found {value}")


def check_pairs(
    group: str, config: object, least: float, most: float, *names: str, above: bool = False, unit: str = ""
) -> None:
    """Raise ValueError unless fields are ascending pairs of numbers that `check_range` accepts."""
    for name in names:
        found = getattr(config, name)
        if len(found) != 2 or not (found[0] <= found[1] and all(_within(value, least, most, above) for value in found)):
            bounds = _bounds(least, most, above, unit)
            raise ValueError(f"{_path(group, name)}: expected [least, greatest], {bounds}, found {found}")


def _path(group: str, name: str) -> str:
    return f"{group}.{name}" if group else name


def _within(value: float, least: float, most: float, above: bool) -> bool:
    return (least < value if above else least <= value) and value <= most and value < inf


def _bounds(least: float, most: float, above: bool, unit: str) -> str:
    if most == inf:
        return f"more than {least:g}{unit}" if above else f"{least:g}{unit} or more"
    if above:
        return f"more than {least:g} and at most {most:g}{unit}"
    return f"{least:g} to {most:g}{unit}" if unit else f"a number from {least:g} to {most:g}"
