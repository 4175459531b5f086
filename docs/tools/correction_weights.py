"""Say in a model how much of its corrections is applied to hidden joints of body parts.

python docs/tools/correction_weights.py MODEL arm=0.5
"""

import json
import sys
from pathlib import Path

from dmae.data.skeleton import decode_skeleton
from dmae.data.store import write_atomic
from dmae.evaluation.benchmark.holes import PARTS, part_of


def main(folder: Path, options: dict[str, float]) -> None:
    unknown = options.keys() - PARTS
    if unknown:
        raise SystemExit(f"error: no body part {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}")
    record = json.loads((folder / "model.json").read_text())
    joints = decode_skeleton(record["skeleton"], "skeleton").joints
    parts = [(joint, list(PARTS)[part_of(joint)]) for joint in joints]
    weights = {joint: options[part] for joint, part in parts if part in options}
    sha256 = record.pop("sha256")
    write_atomic(
        folder / "model.json", json.dumps({**record, "correction_weights": weights, "sha256": sha256}, indent=1)
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]), {part: float(weight) for part, weight in (each.split("=") for each in sys.argv[2:])})
