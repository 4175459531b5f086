"""Where results go: refuse early what cannot be written, and record how a result was made."""

import platform
from importlib import metadata
from pathlib import Path


def check_out(out: str | Path, writes: str | None) -> None:
    """Make sure that a folder or file can be written, before any work.

    Args:
        out: As the user gave it.
        writes: "folder" or "file"; None where that is not known.

    Raises:
        ValueError: a file is where a folder is needed, or the other way round.
    """
    out = Path(out)
    for parent in out.parents:
        if parent.is_file():
            raise ValueError(f"out={out}: {parent} is a file, not a folder; choose another out")
    if writes == "folder" and out.is_file():
        raise ValueError(f"out={out}: expected a folder, found a file; choose another out, or remove the file")
    if writes == "file" and out.is_dir():
        raise ValueError(f"out={out}: expected a file to write, found a folder; give a file in it, as out={out}/NAME")


def record(configuration: str, out: Path) -> None:
    """Write the resolved configuration, as YAML, beside what was made with it."""
    from dmae.data.store import write_atomic  # loads NumPy, which help does without

    folder = out if out.is_dir() else out.parent
    name = "config.yaml" if out.is_dir() else f"{out.name}.config.yaml"
    write_atomic(folder / name, f"# {versions()}\n{configuration}")


def versions() -> str:
    """Python and the packages that results depend on."""
    packages = ("dmae-synth", "numpy", "torch", "mujoco")
    return ", ".join(
        [f"python {platform.python_version()}", *(f"{name} {metadata.version(name)}" for name in packages)]
    )
