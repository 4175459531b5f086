"""Runs over many clips that were interrupted: which clips are complete, and of the same command on the same data."""

import json
from dataclasses import asdict
from pathlib import Path

from dmae.command_line.outputs import versions
from dmae.data.store import CHECKSUMS
from dmae.files.checksums import find_damage, number_of, read_checksums
from dmae.files.contents import write_atomic
from dmae.files.structured import read_json

UNFINISHED = "unfinished.json"
"""In the folder of a data set that is being written: the settings of the run. Removed when it is whole."""
_NO_SETTINGS = ("out", "workers", "backend", "dry_run")


def settings_of(command: str, config) -> dict:
    """Return all that the clips of a run depend on, JSON-able: options, data, and versions of packages.

    Of data without checksums, only the path is compared.

    Args:
        command: As "dmae capture".
        config: Its configuration, with `data`.
    """
    path = Path(config.data.path)
    data = number_of(path) or str(path.resolve())
    options = {name: value for name, value in asdict(config).items() if name not in _NO_SETTINGS}
    settings = {"command": command, "options": options, "data": data, "versions": versions()}
    return json.loads(json.dumps(settings))


def whole_clips(out: Path, settings: dict) -> set[str]:
    """Return the names of the clips in a folder that an interrupted run of the same settings has made whole."""
    if not _is_of(out, settings):
        return set()
    folders = (path.parent for path in Path(out).glob(f"*/{CHECKSUMS}"))
    return {folder.name for folder in folders if _is_whole(folder)}


def begin_run(out: Path, settings: dict) -> None:
    """Note in a folder the settings of a run. Clips of runs of other settings lose their checksums: none is whole."""
    if _is_of(out, settings):
        return
    (Path(out) / UNFINISHED).unlink(missing_ok=True)
    for path in Path(out).glob(f"*/{CHECKSUMS}"):
        path.unlink()
    write_atomic(Path(out) / UNFINISHED, json.dumps(settings, indent=1))


def end_run(out: Path) -> None:
    """Remove the stored settings of a run after all its results are written."""
    (Path(out) / UNFINISHED).unlink(missing_ok=True)


def _is_of(out: Path, settings: dict) -> bool:
    path = Path(out) / UNFINISHED
    try:
        return path.is_file() and read_json(path) == settings
    except ValueError:
        return False


def _is_whole(folder: Path) -> bool:
    try:
        return bool(read_checksums(folder)) and not find_damage(folder)
    except ValueError:
        return False
