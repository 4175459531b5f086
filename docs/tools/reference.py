"""Parts of the reference that are made from the code: commands and their options, corruptions, functions and types."""

import inspect
from importlib import import_module
from pathlib import Path

from dmae.cli import DMAE
from dmae.command_line.options import Command, Group, Option, Program
from dmae.data.typed import REQUIRED
from dmae.evaluation.corruption.registry import corruptions
from synth.cli import SYNTH

ROOT = Path(__file__).parents[2]
PROGRAMS = {program.name: program for program in (DMAE, SYNTH)}


def commands_page(name: str, *, options: bool = False) -> str:
    """Return a page with a section for each command: what it does and examples; on the site also its `options`."""
    program = PROGRAMS[name]
    parts = [f"# The `{name}` command\n\n{program.about}\n\n{_overview(program)}"]
    parts += [_command(command, options) for command in program.commands.values()]
    return "\n\n".join(parts) + "\n"


def functions(*modules: str) -> str:
    """Return a table of the public functions of modules: name, linked to the source, and first sentence."""
    package = modules[0].partition(".")[0]
    names = import_module(package).__all__
    public = [each for module in modules for each in vars(import_module(module)).values()
              if inspect.isfunction(each) and each.__module__ == module and each.__name__ in names]  # fmt: skip
    return _index([(f"{package}.{each.__name__}", each.__module__, each) for each in public])


def types(*names: str) -> str:
    """Return a table of classes, given with their modules: name, linked to the source, and first sentence."""
    split = [name.rpartition(".") for name in names]
    return _index([(name, module, getattr(import_module(module), name)) for module, _, name in split])


def _index(entries: list[tuple[str, str, object]]) -> str:
    rows = []
    for name, module, documented in entries:
        file = import_module(module).__file__.replace(str(ROOT), "../..")
        rows.append(f"| [`{name}`]({file}) | {_cell(inspect.getdoc(documented).partition(chr(10) * 2)[0])} |")
    return "\n".join(["| | |", "| --- | --- |", *rows])


def corruptions_page() -> str:
    """Return a section for each corruption: description, unit and levels."""
    about = (
        "The corruptions of `dmae stress`, one axis for each. `dmae.corrupt(clip, {name: level})` applies one at one "
        "level. At level 0 nothing changes. Corruptions work on real and on simulated clips: the places of people are "
        "taken from the truth, or else from the measurement of all cameras. [Add one](../how-to/add.md#a-corruption)."
    )
    parts = ["# Corruptions", about]
    for entry in corruptions():
        levels, small = (", ".join(f"{level:g}" for level in each) for each in (entry.levels, entry.small))
        parts.append(f"## `{entry.name}`\n\n{inspect.cleandoc(entry.function.__doc__)}")
        people = f" It takes {entry.people} people in an image." if entry.people else ""
        parts.append(f"Levels, in {entry.unit}: {levels}; with `size=small` {small}.{people}")
    return "\n\n".join(parts) + "\n"


def _overview(program: Program) -> str:
    rows = [f"| [`{name}`](#{program.name}-{name}) | {_cell(command.summary)} |" for name, command in
            program.commands.items()]  # fmt: skip
    shared = (
        "Every command takes `key=value` options in any order, `--help`, `--help GROUP` and `--help all`. "
        "`-m key=a,b` runs every combination, in `out/0`, `out/1`, ...; `--config-dir DIR` finds presets of yours. "
        f"`{program.name} <command> --help all` prints every option; the site that `make docs` builds lists them here."
    )
    return "\n".join(["| command | what it does |", "| --- | --- |", *rows, "", shared])


def _command(command: Command, with_options: bool) -> str:
    options = command.options()
    examples = "\n".join(command.examples)
    parts = [f"## `{command}`", f"{options.meaning or command.summary}", f"```text\n{examples}\n```"]
    return "\n\n".join([*parts, *(_tables(options, command) if with_options else ())])


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
