"""Read changed files in a process of its own, which is limited in memory and time; one line of JSON for each."""

import json
import os
import resource
import shutil
import signal
import sys
import tempfile
import traceback
import warnings
import zlib
from pathlib import Path

import numpy as np

from tests.fuzz.bombs import plant
from tests.fuzz.mutations import mutated
from tests.fuzz.plausible import nonsense
from tests.fuzz.reader import Reader
from tests.fuzz.readers import READERS

_ROOT = Path(__file__).parents[2]
MEMORY = 500 << 20
"""Bytes beyond those of a process that has read the unchanged files."""
_FAST = Path("/dev/shm")
"""Files in memory, where there is such a folder: on a disk, making and removing them takes most of the time."""
SECONDS = 2.0
"""Of processor time for a file."""


class TooLong(BaseException):
    """The time for a file is over."""


def changed_file(reader: Reader, folder: Path, index: int) -> Path:
    """Change one of a reader's files, the same for the same index; return it. Index -1 and on are bombs."""
    if index < 0:
        return plant(reader, folder, -1 - index)
    rng = np.random.default_rng([zlib.crc32(reader.name.encode()), index])
    files = sorted({path for pattern in reader.targets for path in folder.glob(pattern) if path.is_file()})
    file = files[rng.integers(len(files))]
    file.write_bytes(mutated(file.read_bytes(), rng))
    if reader.repair:
        reader.repair(folder)
    return file


def outcome(reader: Reader, folder: Path) -> tuple[str, str]:
    """Read, and return what came of it: a class, and what is to be known of it."""
    names = [str(folder), *(path.name for path in folder.rglob("*"))]
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            value = reader.read(folder)
            found = nonsense(value, finite=reader.finite)
        return ("nonsense", found) if found else ("read", "")
    except reader.errors as error:
        signal.setitimer(signal.ITIMER_PROF, 0)
        named = reader.unnamed or any(name in str(error) for name in names)
        return "refused" if named else "refused without name", f"{type(error).__name__}: {error}"
    except MemoryError:
        return "memory", _place()
    except TooLong:
        return "hang", _place()
    except BaseException as error:
        kind = "memory" if "alloc" in str(error).lower() and "memory" in str(error).lower() else "undocumented"
        return kind, f"{type(error).__name__}: {str(error)[:200]} {_place()}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


def _place() -> str:
    """Return the last place of the project in the traceback of the current error."""
    trace, place = sys.exc_info()[2], ""
    while trace is not None:
        code = trace.tb_frame.f_code
        if "/dmae/" in code.co_filename or "/synth/" in code.co_filename:
            place = f"at {os.path.relpath(code.co_filename, _ROOT)}:{trace.tb_lineno} in {code.co_name}"
        trace = trace.tb_next
    return place


def _limit_memory() -> None:
    now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + MEMORY, now + MEMORY))


def main() -> None:
    """Read `[[name, first, count], ...]` from the command line, and work it off."""
    plan = json.loads(sys.argv[1])
    by_name = {reader.name: reader for reader in READERS}
    out, err = os.fdopen(os.dup(1), "w"), os.fdopen(os.dup(2), "w")
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)  # libraries print what they make of damaged files
    os.dup2(null, 2)

    def stop(*_):
        raise TooLong

    signal.signal(signal.SIGPROF, stop)
    sys.excepthook = lambda *error: traceback.print_exception(*error, file=err)  # a fault of the fuzzer itself
    with tempfile.TemporaryDirectory(dir=_FAST if os.access(_FAST, os.W_OK) else None) as place:
        os.chdir(place)
        seeds = {}
        for name in dict.fromkeys(name for name, *_ in plan):
            seeds[name] = Path(place) / "seeds" / name.replace("/", "_")
            seeds[name].mkdir(parents=True)
            by_name[name].write(seeds[name])
            by_name[name].read(Path(shutil.copytree(seeds[name], Path(place) / "work")))
            shutil.rmtree(Path(place) / "work")
        _limit_memory()
        for name, first, count in plan:
            for index in range(first, first + count):
                folder = Path(shutil.copytree(seeds[name], Path(place) / "work"))
                file = changed_file(by_name[name], folder, index)
                print(json.dumps([name, index]), file=out, flush=True)
                kind, why = outcome(by_name[name], folder)
                print(json.dumps([name, index, kind, f"{file.name}: {why}"[:600]]), file=out, flush=True)
                shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
