"""Read and write presets of detectors: YAML files of the option group `detector`."""

import json
from collections.abc import Mapping
from dataclasses import is_dataclass
from pathlib import Path

from dmae.data.json_values import decode
from dmae.data.resources import resource_folder
from dmae.files.structured import read_yaml
from synth.detector.config import DetectorConfig


def preset_yaml(config: DetectorConfig, name: str, comments: list[str]) -> str:
    """Return a preset as YAML: the options of a detector that differ from the defaults, one group per line.

    Args:
        config: The detector.
        name: Name of the preset.
        comments: Comment lines at the beginning of the file.
    """
    # The name of a recording may contain line breaks. Without this, the further lines would become options.
    lines = [*(f"# {' '.join(comment.split())}" for comment in comments), f"name: {json.dumps(name)}"]
    for group, options in _changed(config, DetectorConfig()).items():
        if group == "parts":
            lines += ["parts:", *(f"  {kind}: {_flow(part)}" for kind, part in options.items())]
        elif group != "name":
            lines.append(f"{group}: {_flow(options)}")
    return "\n".join(lines) + "\n"


def _changed(config, default) -> dict:
    """Return the fields of a dataclass that differ from its defaults, including nested fields."""
    values = {key: (value, vars(default)[key]) for key, value in vars(config).items()}
    return {
        key: _changed(value, usual) if is_dataclass(value) else value
        for key, (value, usual) in values.items()
        if value != usual
    }


def _flow(value) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    text = json.dumps(value)
    # For YAML 1.1, 2e-05 is text and 2.0e-05 is a number.
    return text.replace("e", ".0e") if isinstance(value, float) and "e" in text and "." not in text else text


def load_preset(name: str) -> DetectorConfig:
    """Return a preset by its name, or from a YAML file.

    Raises:
        ValueError: there is no such preset, or the file is not a preset.
    """
    folder = resource_folder("dmae", "configs") / "detector"
    path = Path(name) if name.endswith(".yaml") else folder / f"{name}.yaml"
    if not path.is_file():
        there = ", ".join(sorted(each.stem for each in folder.glob("*.yaml")))
        raise ValueError(f"detector {name}: expected a YAML file, or one of {there}")
    return decode(DetectorConfig, read_yaml(path), str(path))
