"""Presets in YAML files of users: old names of options in them work as they do on the command line."""

import shutil
from collections.abc import Iterator
from pathlib import Path

from dmae.command_line.renamed import renamed


def update_presets(command: str, folder: Path, copy: Path) -> list[str]:
    """Copy a folder of presets, with new names of options in the place of old ones.

    Args:
        command: Program and sub-command, as "synth generate".
        folder: As `--config-dir` names it: it holds `<group>/<name>.yaml`.
        copy: Folder to make; it is made only if a preset has old names.

    Returns:
        A note for each old name, with the file that has it.
    """
    import yaml

    notes = []
    for file in sorted(folder.glob("*/*.yaml")):
        text = file.read_text()
        try:
            values = yaml.safe_load(text)
        except yaml.YAMLError:
            continue  # Hydra reports it, if the preset is used
        if not isinstance(values, dict):
            continue
        updated, of_file = _updated(command, file.parent.name, values)
        if of_file:
            if not copy.exists():
                shutil.copytree(folder, copy)
            top = [line for line in text.splitlines() if line.startswith("#")]
            content = "\n".join([*top, yaml.safe_dump(updated, sort_keys=False)])
            (copy / file.relative_to(folder)).write_text(content)
            notes += [f"{file}: {note}" for note in of_file]
    return notes


def _updated(command: str, group: str, values: dict) -> tuple[dict, list[str]]:
    updated, notes = {}, []
    for names, value in _leaves(values):
        (override,), of_option = renamed(command, [f"{group}.{'.'.join(names)}=value"])
        *parents, last = override.partition("=")[0].split(".")[1:]
        place = updated
        for name in parents:
            place = place.setdefault(name, {})
        place[last] = value
        notes += of_option
    return updated, notes


def _leaves(values: dict, above: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], object]]:
    """Yield the names that lead to each value, and the value; an empty dictionary is a value."""
    for name, value in values.items():
        if isinstance(value, dict) and value:
            yield from _leaves(value, (*above, str(name)))
        else:
            yield (*above, str(name)), value
