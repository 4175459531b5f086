"""Fuzz every reader: `python -m tests.fuzz.run --count 10000`; ends with status 1 where one fails.

Each changed file is read in a child process with 500 MB and two seconds; what became of it is one of `OUTCOMES`.
`--show NAME INDEX` prints a changed file's folder and what became of it.
"""

import argparse
import json
import queue
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

FINE = ("read", "refused")
WRONG = ("refused without name", "undocumented", "crash", "hang", "memory", "nonsense")
OUTCOMES = (*FINE, *WRONG)
_SILENT = 20.0
"""Seconds without a line after which a child hangs in code that Python cannot interrupt."""


def fuzz(plan: list[tuple[str, int, int]]) -> Iterator[tuple[str, int, str, str]]:
    """Yield name, index, outcome and detail of each input; children that die are replaced.

    Args:
        plan: Name of a reader, first index and number of inputs.
    """
    left = [list(each) for each in plan if each[2]]
    while left:
        child = subprocess.Popen(
            [sys.executable, "-m", "tests.fuzz.child", json.dumps(left)], stdout=subprocess.PIPE, text=True
        )
        lines: queue.Queue = queue.Queue()
        reading = threading.Thread(target=_drain, args=(child.stdout, lines), daemon=True)
        reading.start()
        begun = None
        while True:
            try:
                line = lines.get(timeout=_SILENT if begun else 300)
            except queue.Empty:
                child.kill()
                line = None
            if line is None:
                break
            name, index, *rest = json.loads(line)
            begun = (name, index)
            if rest:
                yield name, index, *rest
                begun = None
                _advance(left, name, index)
        status = child.wait()
        reading.join()
        child.stdout.close()
        if begun:
            yield *begun, "hang" if status == -9 else "crash", f"the process ended with {status}"
            _advance(left, *begun)
        elif left:
            raise RuntimeError(f"the child ended with {status} before {left[0]}")


def _drain(stream, lines: queue.Queue) -> None:
    for line in stream:
        lines.put(line)
    lines.put(None)


def _advance(left: list[list], name: str, index: int) -> None:
    while left and left[0][0] != name:
        left.pop(0)
    done = index + 1 - left[0][1]
    left[0][1:] = [index + 1, left[0][2] - done]
    if not left[0][2]:
        left.pop(0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000, help="inputs for each reader")
    parser.add_argument("--first", type=int, default=0, help="index of the first input")
    parser.add_argument("--readers", nargs="*", default=[""], help="beginnings of the names of readers; all by default")
    parser.add_argument("--out", help="JSON file of the counts and of all failures")
    asked = parser.parse_args()
    from tests.fuzz.readers import READERS

    names = [reader.name for reader in READERS if reader.name.startswith(tuple(asked.readers))]
    counts: dict[str, Counter] = {name: Counter() for name in names}
    failures = []
    for name, index, kind, why in fuzz([(name, asked.first, asked.count) for name in names]):
        counts[name][kind] += 1
        if kind in WRONG:
            failures.append([name, index, kind, why])
    width = max(map(len, names))
    print(" " * width, *(f"{kind:>10.10}" for kind in OUTCOMES))
    for name in names:
        print(f"{name:{width}}", *(f"{counts[name][kind]:>10}" for kind in OUTCOMES))
    total = sum(counts.values(), Counter())
    print(f"{'all':{width}}", *(f"{total[kind]:>10}" for kind in OUTCOMES))
    if asked.out:
        content = {"counts": {name: dict(each) for name, each in counts.items()}, "failures": failures}
        Path(asked.out).write_text(json.dumps(content, indent=1))
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
