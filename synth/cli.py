"""The `synth` command."""

from dmae.cli import run_program
from dmae.command_line.options import Program
from synth.commands import COMMANDS
from synth.commands.presets import REGISTRIES

SYNTH = Program("synth", "Simulate people, rooms, cameras and detectors, with exact truth.", COMMANDS, REGISTRIES)


def main() -> None:
    run_program(SYNTH)


if __name__ == "__main__":
    main()
