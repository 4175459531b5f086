"""What may import what. Found out in fresh interpreters and in the source, not from what this process loaded."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
HEAVY = {"torch", "lightning", "mujoco", "hydra", "omegaconf"}


def loaded_by(statement: str) -> set[str]:
    """Top-level modules a fresh interpreter holds after a statement."""
    code = f"import sys; {statement}; print(*{{name.partition('.')[0] for name in sys.modules}})"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    return set(run.stdout.split())


def imports_of(path: Path) -> set[str]:
    """Modules that a file imports anywhere, inside functions included."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}.{alias.name}" for alias in node.names} | {node.module}
    return found


def tops(path: Path) -> set[str]:
    return {name.partition(".")[0] for name in imports_of(path)}


@pytest.mark.parametrize(
    "statement",
    [
        "import dmae, synth",
        "import dmae.skeleton, dmae.cameras, dmae.clip, dmae.store, dmae.images, dmae.rng",
        "import dmae.mapping, dmae.metrics, dmae.baselines, dmae.data, dmae.formats.npz",
        "import dmae.regression, dmae.regression.solvers, dmae.regress",
    ],
)
def test_importing_loads_nothing_heavy(statement):
    assert not loaded_by(statement) & HEAVY


def test_vocabulary_imports_only_downwards():
    order = ["skeleton", "cameras", "images", "clip", "store"]
    for height, name in enumerate(order):
        modules = {module for module in imports_of(ROOT / "dmae" / f"{name}.py") if module.startswith("dmae.")}
        assert {module.split(".")[1] for module in modules} <= set(order[:height])


@pytest.mark.parametrize("path", sorted((ROOT / "dmae").rglob("*.py")), ids=lambda path: path.name)
def test_dmae_knows_neither_generator_nor_physics(path):
    assert not tops(path) & {"synth", "mujoco"}


@pytest.mark.parametrize("path", sorted((ROOT / "synth").rglob("*.py")), ids=lambda path: path.name)
def test_synth_knows_no_learning(path):
    assert not tops(path) & {"torch", "lightning"}


def test_only_the_commands_know_hydra():
    files = [*(ROOT / "dmae").rglob("*.py"), *(ROOT / "synth").rglob("*.py")]
    knowing = {path.relative_to(ROOT).as_posix() for path in files if tops(path) & {"hydra", "omegaconf"}}
    assert knowing <= {"dmae/cli.py", "synth/cli.py"}
