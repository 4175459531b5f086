"""Readable JSON: indented, with each list of numbers on one line."""

import json
import re


def json_text(value) -> str:
    """Return indented JSON of a value. A list that contains only numbers and nulls takes one line."""
    text = json.dumps(value, indent=1, allow_nan=False)
    return re.sub(
        r"\[\n\s*((?:-?[\d.eE+-]+|null)(?:,\s+(?:-?[\d.eE+-]+|null))*)\s*\n\s*\]",
        lambda found: "[" + re.sub(r"\s+", " ", found[1]) + "]",
        text,
    )
