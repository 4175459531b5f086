"""Fuzz every reader: `python -m tests.fuzz.run --count 10000`; ends with status 1 where one fails.

Each changed file is read in a child process with 500 MB and two seconds; what became of it is one of `OUTCOMES`.
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
_BATCH = 500
"""Inputs of a reader before the next reader's turn."""
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


def read_counts(path: Path | None) -> dict:
    """Return what a file of an earlier run holds; without one, nothing."""
    if path is None or not path.is_file():
        return {"counts": {}, "failures": []}
    return json.loads(path.read_text())


def plan_of(names: list[str], first: int, count: int, done: dict[str, dict[str, int]]) -> list[tuple[str, int, int]]:
    """Return what is left to try: a batch of each reader in turn, so that a run that is stopped has tried all."""
    return [
        (name, start, min(_BATCH, first + count - start))
        for number in range(-(-count // _BATCH))
        for name in names
        if (start := first + sum(done.get(name, {}).values()) + number * _BATCH) < first + count
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000, help="inputs for each reader")
    parser.add_argument("--first", type=int, default=0, help="index of the first input")
    parser.add_argument("--readers", nargs="*", default=[""], help="beginnings of the names of readers; all by default")
    parser.add_argument("--out", type=Path, help="JSON file of counts and failures; a run goes on where it ends")
    asked = parser.parse_args()
    from tests.fuzz.readers import READERS

    names = [reader.name for reader in READERS if reader.name.startswith(tuple(asked.readers))]
    found = read_counts(asked.out)
    failures, counts = found["failures"], {name: Counter(found["counts"].get(name, {})) for name in names}
    plan = plan_of(names, asked.first, asked.count, found["counts"])
    ends = {(name, first + count - 1) for name, first, count in plan}
    for name, index, kind, why in fuzz(plan):
        counts[name][kind] += 1
        if kind in WRONG:
            failures.append([name, index, kind, why])
            print(name, index, kind, why, flush=True)
        if asked.out and (name, index) in ends:
            found["counts"] |= {name: dict(each) for name, each in counts.items() if each}
            asked.out.write_text(json.dumps(found, indent=1) + "\n")
    width = max(map(len, names))
    print(" " * width, *(f"{kind:>10.10}" for kind in OUTCOMES))
    for name in names:
        print(f"{name:{width}}", *(f"{counts[name][kind]:>10}" for kind in OUTCOMES))
    total = sum(counts.values(), Counter())
    print(f"{'all':{width}}", *(f"{total[kind]:>10}" for kind in OUTCOMES))
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
