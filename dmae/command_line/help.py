"""Help: of a program, of a command, and of a group of its options."""

import os
import shutil
import sys
import textwrap
from collections.abc import Iterator, Sequence

from dmae.command_line.options import Command, Group, Option, Program
from dmae.command_line.spelling import required
from dmae.data.typed import REQUIRED
from dmae.nearest import suggestion

_FLAGS = (
    ("-m, --multirun", "run every combination of key=a,b values, in out/0, out/1, ..."),
    ("--config-dir DIR", "find presets in DIR too, as DIR/rig/mine.yaml for rig=mine"),
    ("--cfg job", "print the configuration and do nothing; HYDRA_FULL_ERROR=1 shows where an error comes from"),
)
_LEFT = 26  # Columns of names and defaults


def program_help(program: Program) -> str:
    """What a program is and its sub-commands."""
    rows = [_row(name, command.summary) for name, command in program.commands.items()]
    return "\n".join([
        f"usage: {program.name} COMMAND key=value ...",
        "",
        *_wrapped(program.about),
        "",
        _heading("Commands"),
        *(line for row in rows for line in row),
        "",
        f"{program.name} COMMAND --help lists the options of a command; {program.name} --version prints the version.",
    ])  # fmt: skip


def command_help(command: Command, options: Group, topic: str = "") -> str:
    """The options of a command: an overview, or one `topic` (an option, a group, or "all") in full.

    Raises ValueError if the topic is not one of its options.
    """
    if topic and topic != "all":
        found = options.find(topic)
        if found is None:
            names = [member.key for member in options.walk()]
            raise ValueError(f"--help {topic}: no such option; {suggestion(topic, names)}")
        return "\n".join(_topic(command, found))
    needed = "".join(f" {key}=..." for key in required(options))
    lines = [f"usage: {command}{needed} [key=value ...]", "", *_documentation(options.meaning), ""]
    plain = [member for member in options.members if isinstance(member, Option)]
    groups = [member for member in options.members if isinstance(member, Group)]
    sections: dict[str, Sequence[Option | Group]] = {
        "Required": [option for option in plain if option.default == REQUIRED],
        "Options": [option for option in plain if option.default != REQUIRED],
        "Presets (key=NAME), and the options that they set (key.option=value)": [g for g in groups if g.presets],
        "Groups of options (key.option=value)": [group for group in groups if not group.presets],
    }
    for heading, members in sections.items():
        if members:
            lines.append(_heading(heading))
            for member in members:
                lines += _group_line(member) if isinstance(member, Group) else _option(member, topic == "all")
            lines.append("")
    if topic == "all":
        for group in groups:
            lines += [*_topic(command, group, deep=True), ""]
    elif groups:
        lines += [
            f"More: {command} --help {groups[-1].key} prints a group in full, {command} --help all everything.",
            "",
        ]
    lines += [_heading("Examples"), *(f"  {example}" for example in command.examples)]
    lines += ["", _heading("Flags"), *(line for row in _FLAGS for line in _row(*row))]
    return "\n".join(lines)


def _group_line(group: Group) -> Iterator[str]:
    name = group.key if group.preset is None else f"{group.key}={'...' if group.preset == REQUIRED else group.preset}"
    meaning = _first_sentence(group.meaning)
    if group.presets:
        choices = "FOLDER, or a format: " if group.key == "data" else ""
        meaning = f"{meaning} {{{choices}{', '.join(group.presets)}}}"
    yield from _row(name, meaning)
    names = [member.key.removeprefix(f"{group.key}.") for member in group.members]
    yield from textwrap.wrap(
        ", ".join(f".{name}" for name in names), _width(), initial_indent=" " * (_LEFT + 2),
        subsequent_indent=" " * (_LEFT + 2), max_lines=2, placeholder=" ...",
    )  # fmt: skip


def _topic(command: Command, found: Option | Group, deep: bool = False) -> Iterator[str]:
    if isinstance(found, Option):
        yield from _option(found, whole=True)
        return
    yield _heading(f"{command} {found.key}")
    yield from _wrapped(found.meaning)
    if found.presets:
        yield ""
        for name, meaning in found.presets.items():
            chosen = " (default)" if name == found.preset else ""
            yield from _row(f"{found.key}={name}{chosen}", meaning)
    yield ""
    for member in found.members:
        if isinstance(member, Option):
            yield from _option(member, whole=True)
        elif not deep:
            yield from _group_line(member)
            yield f"{' ' * (_LEFT + 2)}more: {command} --help {member.key}"
    if deep:
        for member in found.members:
            if isinstance(member, Group):
                yield ""
                yield from _topic(command, member, deep=True)


def _option(option: Option, whole: bool) -> Iterator[str]:
    meaning = option.meaning if whole else _first_sentence(option.meaning)
    if option.choices:
        meaning = f"{meaning} {{{', '.join(option.choices)}}}"
    elif whole:
        kind = "list" if option.kind == "text" else f"list of {option.kind}s"
        kind = kind if option.many else option.kind
        meaning = f"{meaning} [{kind}]"
    yield from _row(f"{option.key}={_shown(option.default)}", meaning.strip())


def _shown(value: object) -> str:
    """A default as it would be typed."""
    if value == REQUIRED:
        return "..."
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, tuple)):
        if any(isinstance(each, dict) for each in value):
            return f"[{len(value)} entries]"
        return f"[{','.join(_shown(each) for each in value)}]"
    if isinstance(value, dict):
        return f"{{{','.join(f'{key}:{_shown(each)}' for key, each in value.items())}}}"
    return str(getattr(value, "name", value))


def _row(name: str, text: str) -> Iterator[str]:
    lines = textwrap.wrap(text, max(30, _width() - _LEFT - 2)) or [""]
    if len(name) > _LEFT - 2:
        yield f"  {_bold(_short(name))}"
    else:
        yield f"  {_bold(name)}{' ' * (_LEFT - len(name))}{lines.pop(0)}".rstrip()
    for line in lines:
        yield f"{' ' * (_LEFT + 2)}{line}".rstrip()


def _short(name: str) -> str:
    return name if len(name) <= _width() - 2 else f"{name[: _width() - 6]} ..."


def _first_sentence(text: str) -> str:
    first, stop, _ = " ".join(text.split()).partition(". ")
    return first + stop.strip()


def _documentation(text: str) -> list[str]:
    lines = []
    for paragraph in text.split("\n\n"):
        lines += [""] if lines else []
        lines += paragraph.splitlines() if paragraph.startswith(" ") else _wrapped(paragraph)
    return lines


def _wrapped(text: str) -> Sequence[str]:
    return textwrap.wrap(" ".join(text.split()), _width())


def _width() -> int:
    return min(shutil.get_terminal_size((110, 24)).columns, 120)


def _coloured() -> bool:
    return sys.stdout.isatty() and "NO_COLOR" not in os.environ


def _bold(text: str) -> str:
    return f"\033[1m{text}\033[0m" if _coloured() else text


def _heading(text: str) -> str:
    return f"\033[1;36m{text}\033[0m" if _coloured() else text
