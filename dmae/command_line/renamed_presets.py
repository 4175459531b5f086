"""Presets in YAML files of users: old names of options in them work as they do on the command line."""

from collections.abc import Iterator

from dmae.command_line.renamed import renamed


def renamed_options(command: str, group: str, values: dict) -> tuple[dict, list[str]]:
    """Return the options of a preset under today's names, and a note for each old one.

    Args:
        command: Program and sub-command, as "synth generate".
        group: The preset's.
        values: Options of the group, nested.
    """
    updated, notes = {}, []
    for names, value in _leaves(values):
        (override,), of_option = renamed(command, [f"{group}.{'.'.join(names)}=value"])
        *parents, last = override.partition("=")[0].split(".")[1:] if of_option else names
        place = updated
        for name in parents:
            place = place.setdefault(name, {})
            if not isinstance(place, dict):
                raise ValueError(f"{group}.{'.'.join(names)}: {name} is given twice, as a value and as a table")
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
