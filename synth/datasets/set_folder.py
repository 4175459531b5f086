"""Claim the folder of a data set when it is begun. Its stored configuration identifies the data set."""

import json
from collections.abc import Collection
from dataclasses import asdict
from enum import Enum
from pathlib import Path

from dmae.data.images import KINDS
from dmae.data.resume import claim_folder
from dmae.data.store import write_atomic
from dmae.files.structured import read_json
from synth.datasets.images.clip_images import image_kinds

CONFIG = "config.json"
_OF_IMAGES = ("images", "quality", "rgb")
"""Settings that may differ when images are added to a data set."""
_OF_COMMANDS = ("config.yaml",)
"""Files that a folder may contain and still counts as empty: a command writes them about its own run."""


def claim(out: Path, settings: dict) -> None:
    """Claim a folder for a data set, and store the settings in it. The folder is new, empty, or contains a part of it.

    Args:
        out: The folder.
        settings: All settings that the clips depend on, as JSON values. `images`, `quality` and `rgb` may differ when
            images are added to existing clips.

    Raises:
        ValueError: the folder contains something else, or a data set of another configuration.
    """
    if out.exists() and not out.is_dir():
        raise ValueError(f"out={out}: expected a folder, found a file")
    others = [path.name for path in sorted(out.glob("*")) if path.name not in _OF_COMMANDS] if out.is_dir() else []
    if others and not (out / CONFIG).is_file():
        raise ValueError(
            f"out={out}: expected a new or empty folder, or a data set; it holds {', '.join(others[:3])}"
            f"{' and more' if len(others) > 3 else ''} and no {CONFIG}"
        )
    claim_folder(out / CONFIG, settings, "a data set", may_differ=_OF_IMAGES)
    kept = read_json(out / CONFIG)
    kinds = {*image_kinds(kept["images"]), *image_kinds(settings["images"])}
    if kinds != {*image_kinds(kept["images"])}:
        kept |= {"quality": settings["quality"], "rgb": settings["rgb"]}
        kept["images"] = [kind for kind in KINDS if kind in kinds]
        write_atomic(out / CONFIG, json.dumps(kept, indent=1))


def as_settings(config, leave: Collection[str] = ()) -> dict:
    """Return the options of a configuration as JSON values, without the names in `leave`."""

    def plain(value):
        return value.name if isinstance(value, Enum) else str(value)

    settings = {name: value for name, value in asdict(config).items() if name not in leave}
    settings["images"] = image_kinds(config.images)
    return json.loads(json.dumps(settings, default=plain))
