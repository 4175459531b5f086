"""Write `docs/results/fuzz.json`: the totals of runs of the fuzzer.

    python -m tests.fuzz.run --count 10000 --out fuzz.json
    python docs/tools/fuzz.py fuzz.json

Each input that failed in a run is read again with the current readers. Inputs that still fail are `failing`.
"""

import json
import sys
from collections import Counter
from pathlib import Path

from provenance import provenance

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))


def main(files: list[str]) -> None:
    from tests.fuzz.run import OUTCOMES, WRONG, fuzz

    counts: dict[str, Counter] = {}
    failures: list[list] = []
    for file in files:
        found = json.loads(Path(file).read_text())
        failures += found["failures"]
        for name, each in found["counts"].items():
            counts.setdefault(name, Counter()).update(each)
    again = list(fuzz([(name, index, 1) for name, index, *_ in failures]))
    total = sum(counts.values(), Counter())
    tried = {name: sum(each.values()) for name, each in sorted(counts.items())}
    made = {
        "command": "python -m tests.fuzz.run --count 10000 --out fuzz.json && python docs/tools/fuzz.py fuzz.json",
        **provenance("torch", "mujoco"),
        "readers": len(counts),
        "inputs": sum(tried.values()),
        "least": min(tried.values()),
        "outcomes": {name: total[name] for name in OUTCOMES},
        "found": len(failures),
        "failing": [[name, index, kind, why] for name, index, kind, why in again if kind in WRONG],
        "tried": tried,
    }
    (ROOT / "docs/results/fuzz.json").write_text(json.dumps(made, indent=1) + "\n")
    print(f"{made['inputs']} inputs, {made['found']} found wrong, {len(made['failing'])} of them still")


if __name__ == "__main__":
    main(sys.argv[1:])
