"""Programs and their sub-commands. A sub-command is a module of the program's package, imported when it is run."""

import importlib
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import ModuleType

from dmae.command_line.options import Group, Registries, read_options
from dmae.command_line.source import DataclassSource, load


@dataclass(frozen=True)
class Command:
    """A sub-command.

    Its module has `run(config, out)`, annotated with the dataclass of its configuration; `EXAMPLES`, command lines;
    `WRITES`, "folder" or "file" as `out` is one, None where it has no `out` or that depends; and where they say more
    than the defaults `default_out(config)` and `interrupted(config, out)`, which states what is complete and how to
    continue.
    """

    program: str
    name: str
    summary: str
    registries: Registries

    def __str__(self) -> str:
        return f"{self.program} {self.name}"

    @property
    def module(self) -> str:
        return f"{self.program}.commands.{self.name.replace('-', '_')}"

    @cached_property
    def configuration(self) -> DataclassSource:
        """The source of the dataclass that `run` takes."""
        source = load(self.module)
        return source.lookup(source.found["run"].args.args[0].annotation.id)

    @property
    def examples(self) -> tuple[str, ...]:
        return load(self.module).lookup("EXAMPLES")

    @property
    def writes(self) -> str | None:
        return load(self.module).lookup("WRITES")

    def options(self, folders: tuple[Path, ...] = ()) -> Group:
        """Its options, with the presets in further folders."""
        return read_options(self.configuration, self.name, folders, self.registries)

    def imported(self) -> tuple[ModuleType, type]:
        """Its module and the class of its configuration."""
        module = importlib.import_module(self.module)
        return module, getattr(module, self.configuration.node.name)


@dataclass(frozen=True)
class Program:
    """A program: its name, one sentence, the summaries of its sub-commands, and registries of presets."""

    name: str
    about: str
    summaries: dict[str, str]
    registries: Registries = field(default_factory=dict)

    @property
    def commands(self) -> dict[str, Command]:
        return {name: Command(self.name, name, summary, self.registries) for name, summary in self.summaries.items()}
