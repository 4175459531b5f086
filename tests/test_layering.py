"""Allowed imports between packages, checked in the source and from fresh interpreters."""

import subprocess
import sys

import pytest

from tests.support.source_tree import ROOT, circles, imported_modules, imported_packages, modules

HEAVY = {"torch", "lightning", "mujoco", "hydra", "omegaconf"}

LAYERS = (
    (
        "dmae.data",
        "dmae.files",
        "dmae.nearest",
        "dmae.numerics",
        "dmae.parallel",
        "dmae.progress",
        "dmae.registry",
    ),
    ("dmae.command_line", "dmae.formats", "dmae.reporting"),
    ("dmae.reconstruction", "dmae.datasets", "dmae.metrics", "dmae.viewing"),
    ("dmae.calibration", "dmae.detection"),
    ("dmae.completion",),
    ("dmae.online",),
    ("dmae.evaluation",),
    ("dmae.regression",),
    ("synth.checks", "synth.errors", "synth.textures"),
    ("synth.people",),
    ("synth.motion",),
    ("synth.rooms",),
    ("synth.interactions", "synth.rigs"),
    ("synth.scene",),
    ("synth.physics",),
    ("synth.rendering",),
    ("synth.labels", "synth.detector"),
    ("synth.datasets", "synth.recognition"),
    ("synth.planning",),
    ("dmae.commands",),
    ("dmae.cli",),
    ("dmae.verbs",),
    ("synth.commands",),
    ("synth.cli",),
    ("synth.verbs",),
    ("dmae.__main__", "synth.__main__"),
)
"""Rooms, lowest first. A room imports from rooms of lower layers; those of the lowest layer may import each other."""


def room(module: str) -> str:
    return ".".join(module.split(".")[:2])


def heights() -> dict[str, int]:
    return {name: height for height, layer in enumerate(LAYERS) for name in layer}


def test_every_room_has_a_layer():
    rooms = {room(name) for name in modules()} - {"dmae", "synth"}
    assert rooms == set(heights())


def test_imports_go_down():
    height, climbing = heights(), []
    for name in modules():
        for other in imported_modules(name):
            here, there = room(name), room(other)
            if here == there or there in ("dmae", "synth") or here in ("dmae", "synth"):
                continue
            ground = height[here] == height[there] == 0
            if not (height[there] < height[here] or ground):
                climbing.append(f"{name} imports {other}, which lies above it or beside it")
    assert climbing == []


def test_no_modules_import_each_other():
    assert circles() == []


def test_dmae_knows_neither_generator_nor_physics():
    knowing = {name for name, path in modules().items() if imported_packages(path) & {"synth", "mujoco"}}
    both = {"dmae.commands.demo", "dmae.commands.pretrain"}  # they simulate and learn
    both |= {"dmae.formats.retargeting"}  # robots are MuJoCo models; they are loaded in its functions only
    assert {name for name in knowing if name.startswith("dmae")} <= both


def test_synth_knows_no_learning():
    knowing = {name for name, path in modules().items() if imported_packages(path) & {"torch", "lightning"}}
    assert {name for name in knowing if name.startswith("synth")} == set()
    above = ("dmae.completion", "dmae.online", "dmae.evaluation", "dmae.regression")
    users = {name for name in modules() if any(other.startswith(above) for other in imported_modules(name))}
    assert {name for name in users if name.startswith("synth")} == set()


def test_only_the_command_lines_know_hydra():
    knowing = {name for name, path in modules().items() if imported_packages(path) & {"hydra", "omegaconf"}}
    assert knowing <= {"dmae.cli", "dmae.command_line.spelling"}


def loaded_by(statement: str) -> set[str]:
    """Top-level modules that a fresh interpreter holds after a statement."""
    code = f"import sys; {statement}; print(*{{name.partition('.')[0] for name in sys.modules}})"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    return set(run.stdout.split())


@pytest.mark.parametrize(
    "statement",
    [
        "import dmae, synth",
        "import dmae.data.clip, dmae.data.store, dmae.data.conversion, dmae.data.rng",
        "import dmae.formats.reading, dmae.completion.methods, dmae.metrics",
        "import dmae.regression, dmae.regression.solvers",
        "import dmae.commands.evaluate, dmae.commands.stress, dmae.commands.benchmark",
    ],
)
def test_importing_loads_nothing_heavy(statement):
    assert not loaded_by(statement) & HEAVY


@pytest.mark.parametrize("program", ["dmae", "synth"])
def test_options_load_nothing_heavy(program):
    """Help reads the dataclasses of options; all of a program together load NumPy at most."""
    read = f"from {program}.cli import {program.upper()} as p; [command.options() for command in p.commands.values()]"
    assert not loaded_by(read) & (HEAVY | {"scipy", "cv2", "numba", "joblib"})
