"""Write detectors as presets, YAML files of the option group `detector`."""

import json
from collections.abc import Mapping
from dataclasses import is_dataclass

from synth.detector.config import DetectorConfig


def preset_yaml(config: DetectorConfig, name: str, comments: list[str]) -> str:
    """Return a preset: the options of a detector that differ from the defaults, a group a line.

    Args:
        config: The detector.
        name: Name of the preset.
        comments: Lines at its head.
    """
    # A comment of several lines, from a recording's name, would become options.
    lines = [*(f"# {' '.join(comment.split())}" for comment in comments), f"name: {json.dumps(name)}"]
    for group, options in _changed(config, DetectorConfig()).items():
        if group == "parts":
            lines += ["parts:", *(f"  {kind}: {_flow(part)}" for kind, part in options.items())]
        elif group != "name":
            lines.append(f"{group}: {_flow(options)}")
    return "\n".join(lines) + "\n"


def _changed(config, default) -> dict:
    """Return the fields of a dataclass that differ from its defaults, nested ones alike."""
    values = {key: (value, vars(default)[key]) for key, value in vars(config).items()}
    return {
        key: _changed(value, usual) if is_dataclass(value) else value
        for key, (value, usual) in values.items()
        if value != usual
    }


def _flow(value) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_flow(item)}" for key, item in value.items()) + "}"
    return json.dumps(value)
