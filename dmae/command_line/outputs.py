"""Where results go: refuse early what cannot be written, keep other commands out, record how a result was made."""

import json
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path


def check_out(out: str | Path, writes: str | None) -> None:
    """Make sure that a folder or file (`writes`, None if not known) can be written, before any work.

    Raises ValueError if a file is where a folder is needed, or the other way round, or a folder is read-only.
    """
    out = Path(out)
    for parent in out.parents:
        if parent.is_file():
            raise ValueError(f"out={out}: {parent} is a file, not a folder; choose another out")
    if writes == "folder" and out.is_file():
        raise ValueError(f"out={out}: expected a folder, found a file; choose another out, or remove the file")
    if writes == "folder" and out.is_dir() and not os.access(out, os.W_OK | os.X_OK):
        raise ValueError(f"out={out}: cannot be written: the folder is read-only; choose another out")
    if writes == "file" and out.is_dir():
        raise ValueError(f"out={out}: expected a file to write, found a folder; give a file in it, as out={out}/NAME")


@contextmanager
def locked(out: Path, first: int | None = None) -> Iterator[None]:
    """Lock `out` against other commands for the length of the block; where they fill it with clips, from `first` on.

    The lock is on a file in the parent folder, which is removed afterwards. A command that is killed leaves the file
    behind, but no lock. Raises ValueError if another command is writing there, or the folder cannot be written.
    """
    from filelock import FileLock, Timeout

    made = [folder for folder in out.absolute().parents if not folder.exists()]
    lock = FileLock(out.absolute().parent / f".{out.name}{first or ''}.lock", timeout=0)
    try:
        out.absolute().parent.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        raise ValueError(
            f"out={out}: another command is writing there; wait until it has ended, or choose another out"
        ) from None
    except OSError as error:
        raise ValueError(f"out={out}: cannot be written: {error.strerror or error}; choose another out") from None
    try:
        yield
    finally:
        Path(lock.lock_file).unlink(missing_ok=True)
        lock.release()
        for folder in made:
            if not any(folder.iterdir()):
                folder.rmdir()


def record(configuration: str, out: Path) -> None:
    """Write the resolved configuration, as YAML, to the output of its command."""
    from dmae.files.checksums import RECORD, with_own_checksum  # it loads NumPy, which `--help` does not need
    from dmae.files.contents import write_atomic

    folder = out if out.is_dir() else out.parent
    name = RECORD if out.is_dir() else f"{out.name}.{RECORD}"
    write_atomic(folder / name, with_own_checksum(f"# {versions()}\n{configuration}"))


def record_options(config, out: Path) -> None:
    """Write the configuration of one step of a command to the step's output."""
    import yaml

    options = json.loads(json.dumps(asdict(replace(config, out=str(out)))))
    record(yaml.safe_dump(options, sort_keys=False, allow_unicode=True), out)


def versions() -> str:
    """Python and the packages that results depend on."""
    from importlib import metadata  # a tenth of the time of `--help`, which does not need it

    packages = ("dmae-synth", "numpy", "torch", "mujoco")
    return ", ".join(
        [f"python {platform.python_version()}", *(f"{name} {metadata.version(name)}" for name in packages)]
    )
