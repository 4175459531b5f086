"""Peak memory of `synth generate` by the number of clips: `python -m tests.endurance.memory 100 300 1000`.

Clips are short and hold labels alone, on all cores. Memory is that of the command and of all its processes together,
looked at five times a second: a number that does not grow with the clips.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.support.commands import command_line
from tests.support.processes import family

_EVERY = 0.2
OPTIONS = ("seed=1", "scene.seconds=0.4", "scene.persons=[1,2]", "workers=-1")


def peak_memory(line: list[str], folder: Path) -> dict[str, float]:
    """Run a command in a folder; return the peak memory of it and of all its processes, MiB, and the time, s."""
    begun = time.monotonic()
    process = subprocess.Popen(line, cwd=folder, stdout=subprocess.DEVNULL)
    main = total = 0.0
    while process.poll() is None:
        sizes = [_private(number) for number in family(process.pid)]
        main, total = max(main, sizes[0]), max(total, sum(sizes))
        time.sleep(_EVERY)
    if process.returncode:
        raise RuntimeError(f"{line} ended with {process.returncode}")
    return {"main_mib": main, "all_mib": total, "seconds": time.monotonic() - begun}


def _private(number: int) -> float:
    """Return the memory of a process that it shares with no file, MiB; 0 where it has ended."""
    try:
        lines = Path(f"/proc/{number}/status").read_text().splitlines()
    except (FileNotFoundError, ProcessLookupError):
        return 0.0
    held = dict(line.split(":", 1) for line in lines)
    return int(held["RssAnon"].split()[0]) / 1024 if "RssAnon" in held else 0.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("clips", type=int, nargs="+")
    parser.add_argument("--out", help="JSON file of the figures")
    asked = parser.parse_args()
    found = []
    for clips in asked.clips:
        with tempfile.TemporaryDirectory() as folder:
            line = command_line("synth", "generate", *OPTIONS, f"clips={clips}", "out=set")
            found.append({"clips": clips} | peak_memory(line, Path(folder)))
        print(found[-1], flush=True)
        if asked.out:
            command = f"python -m tests.endurance.memory {' '.join(map(str, asked.clips))}"
            made = {"command": command, "generate": list(OPTIONS), "found": found}
            Path(asked.out).write_text(json.dumps(made, indent=1) + "\n")


if __name__ == "__main__":
    sys.exit(main())
