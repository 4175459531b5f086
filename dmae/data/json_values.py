"""JSON as readable text, its numbers, and nested values."""

import json
import re
from math import isfinite
from typing import Any


def json_text(value) -> str:
    """Return indented JSON of a value. A list that contains only numbers and nulls takes one line."""
    text = json.dumps(value, indent=1, allow_nan=False)
    return re.sub(
        r"\[\n\s*((?:-?[\d.eE+-]+|null)(?:,\s+(?:-?[\d.eE+-]+|null))*)\s*\n\s*\]",
        lambda found: "[" + re.sub(r"\s+", " ", found[1]) + "]",
        text,
    )


def rounded(value: float | None, digits: int) -> float | None:
    """Return a rounded number; None, null in JSON, for one that is not known or not finite."""
    return None if value is None or not isfinite(value) else round(float(value), digits)


def flat(values: dict, prefix: str = "") -> dict[str, Any]:
    """Return nested values by their dotted names."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        nested = isinstance(value, dict) and value
        found |= flat(value, f"{prefix}{name}.") if nested else {f"{prefix}{name}": value}
    return found


def merged(values: dict[str, Any], others: dict[str, Any]) -> dict[str, Any]:
    """Return nested values of two dictionaries; where both have a value, the second one counts."""
    both = values | others
    for name in values.keys() & others.keys():
        if isinstance(values[name], dict) and isinstance(others[name], dict):
            both[name] = merged(values[name], others[name])
    return both
