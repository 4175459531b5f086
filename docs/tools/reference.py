"""Generate pages of the reference from the code: all commands with all of their options."""

import inspect

from dmae.cli import DMAE
from dmae.command_line.options import REQUIRED, Command, Group, Option, Program
from dmae.evaluation.corruption.registry import corruptions
from synth.cli import SYNTH

PROGRAMS = {program.name: program for program in (DMAE, SYNTH)}


def commands_page(name: str) -> str:
    """Return a page with a section for each command: what it does, examples, presets, and a table for each group."""
    program = PROGRAMS[name]
    parts = [f"# The `{name}` command\n\n{program.about}\n\n{_overview(program)}"]
    parts += [_command(command) for command in program.commands.values()]
    return "\n\n".join(parts) + "\n"


def corruptions_page() -> str:
    """Return a section for each corruption: description, unit and levels."""
    about = (
        "The corruptions of `dmae stress`, one axis for each. `dmae.corrupt(clip, {name: level})` applies one at one "
        "level. At level 0 nothing changes. Corruptions work on real and on simulated clips: the places of people are "
        "taken from the truth, or else from the measurement of all cameras. [Add one](../how-to/add_corruption.md)."
    )
    parts = ["# Corruptions", about]
    for entry in corruptions():
        levels, small = (", ".join(f"{level:g}" for level in each) for each in (entry.levels, entry.small))
        parts.append(f"## `{entry.name}` {{ #{entry.name} }}\n\n{inspect.cleandoc(entry.function.__doc__)}")
        people = f" It takes {entry.people} people in an image." if entry.people else ""
        parts.append(f"Levels, in {entry.unit}: {levels}; with `size=small` {small}.{people}")
    return "\n\n".join(parts) + "\n"


def _overview(program: Program) -> str:
    rows = [f"| [`{name}`](#{program.name}-{name}) | {_cell(command.summary)} |" for name, command in
            program.commands.items()]  # fmt: skip
    shared = (
        "Every command takes `key=value` options in any order, `--help`, `--help GROUP` and `--help all`. "
        "`-m key=a,b` runs every combination, in `out/0`, `out/1`, ...; `--config-dir DIR` finds presets of yours."
    )
    return "\n".join(["| command | what it does |", "| --- | --- |", *rows, "", shared])


def _command(command: Command) -> str:
    options = command.options()
    examples = "\n".join(command.examples)
    parts = [
        f"## `{command}` {{ #{command.program}-{command.name} }}",
        f"{options.meaning or command.summary}",
        f"```text\n{examples}\n```",
        *_tables(options, command),
    ]
    return "\n\n".join(parts)


def _tables(group: Group, command: Command):
    plain = [member for member in group.members if isinstance(member, Option)]
    groups = [member for member in group.members if isinstance(member, Group)]
    heading = f"**`{group.key}`** {group.meaning}" if group.key else ""
    if group.presets:
        chosen = "required" if group.preset == REQUIRED else f"default `{group.preset}`"
        presets = "\n".join(f"- `{group.key}={name}`: {_cell(meaning)}" for name, meaning in group.presets.items())
        heading += f"\n\nPresets, {chosen}:\n\n{presets}"
    if heading:
        yield heading
    if plain:
        rows = [f"| `{option.key}` | {_default(option)} | {_meaning(option)} |" for option in plain]
        yield "\n".join(["| option | default | meaning |", "| --- | --- | --- |", *rows])
    for member in groups:
        yield from _tables(member, command)


def _default(option: Option) -> str:
    if option.default == REQUIRED:
        return "required"
    if option.default is None:
        return ""
    if isinstance(option.default, list | tuple):
        text = ",".join(map(str, option.default))
        return f"`[{text}]`" if len(text) < 40 else "all"
    return f"`{str(option.default).lower() if isinstance(option.default, bool) else option.default}`"


def _meaning(option: Option) -> str:
    choices = f" One of {', '.join(f'`{choice}`' for choice in option.choices)}." if option.choices else ""
    return _cell(f"{option.meaning}{choices}")


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
