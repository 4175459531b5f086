"""The `synth` command, and the presets of its options that come from registries."""

from dmae.cli import run_program
from dmae.command_line.options import Preset, Program, presets_of
from dmae.formats.registry import reader as recording_reader
from synth.commands import COMMANDS
from synth.interactions.registry import interaction_choices
from synth.motion.readers import reader
from synth.rooms.config import room_choices, room_presets


def interactions() -> dict[str, Preset]:
    return {name: Preset(meaning, {"kind": name}) for name, meaning in interaction_choices().items()}


def rooms() -> dict[str, Preset]:
    values = room_presets()
    return {name: Preset(meaning, values[name]) for name, meaning in room_choices().items()}


REGISTRIES = {
    "data": presets_of(recording_reader, "name"),
    "interaction": interactions,
    "motion": presets_of(reader, "kind"),
    "scene": rooms,
}
"""Functions that return presets by name, for each group of options."""

SYNTH = Program("synth", "Simulate people, rooms, cameras and detectors, with exact truth.", COMMANDS, REGISTRIES)


def main() -> None:
    run_program(SYNTH)


if __name__ == "__main__":
    main()
