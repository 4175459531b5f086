"""Peak memory over a long recording of one person: `python -m tests.endurance.long_recording 100000`.

Detections of four cameras are captured, completed and exported by the commands, each in a process of its own, and the
most memory that each holds, libraries and mapped files included, is looked up when it has ended. A short recording goes
first: when commands run for the first time ever, functions are compiled, which takes 200 MB more.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from dmae.data.store import save_clip
from tests.support.commands import command_line
from tests.support.detected_people import FPS, detected_clip, walk

LINES = {
    "capture": ("dmae", "capture", "data=recording"),
    "complete": ("dmae", "complete", "clip=captured"),
    **{
        f"export {format}": ("dmae", "export", "clip=completed", f"format={format}")
        for format in ("trc", "npz", "c3d", "bvh", "coco")
    },
}
RESULTS = {"capture": "captured", "complete": "completed"}
MOST_MB = 600.0
"""Of 1,000,000 bytes."""


def write_recording(frames: int, folder: Path) -> None:
    """Write detections of a person who walks to and fro, with a tenth of the joints missed."""
    there = walk((-1.5, 0), (1.5, 0.2), frames=100)
    lap = np.concatenate([there, there[::-1]])
    save_clip(detected_clip(np.resize(lap, (frames, *lap.shape[1:]))[:, None]), folder / "recording")


def peak_memory(line: tuple[str, ...], folder: Path) -> dict[str, float]:
    """Run a command; return the most memory that it held, MB, the time and the processor time, s."""
    begun = time.monotonic()
    process = subprocess.Popen(command_line(*line), cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise RuntimeError(f"{' '.join(line)} ended with {status}")
    return {
        "mb": usage.ru_maxrss * 1024 / 1e6,
        "seconds": time.monotonic() - begun,
        "cpu_seconds": usage.ru_utime + usage.ru_stime,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("frames", type=int)
    parser.add_argument("--stages", nargs="*", default=list(LINES), choices=LINES, help="what is done")
    parser.add_argument("--out", help="JSON file of the figures")
    asked = parser.parse_args()
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        short, long = Path(folder, "short"), Path(folder, "long")
        for frames, place in ((_SHORT, short), (asked.frames, long)):
            # In a process of its own: a child begins with the memory of its parent.
            subprocess.run([sys.executable, "-c", _WRITE, str(frames), str(place)], check=True)
        for name in asked.stages:
            line = (*LINES[name], f"out={RESULTS.get(name, name.replace(' ', '_'))}")
            peak_memory(line, short)
            found[name] = peak_memory(line, long) | {"mb_of_short": peak_memory(line, short)["mb"]}
            print(name, found[name], flush=True)
            if asked.out:
                command = f"python -m tests.endurance.long_recording {asked.frames}"
                made = {"command": command, "frames": asked.frames, "fps": FPS, "found": found}
                Path(asked.out).write_text(json.dumps(made, indent=1) + "\n")
    sys.exit(any(each["mb"] > MOST_MB for each in found.values()))


_SHORT = 300
"""Frames of the recording that shows what commands take of themselves."""
_WRITE = """
import sys
from pathlib import Path
from tests.endurance.long_recording import write_recording
write_recording(int(sys.argv[1]), Path(sys.argv[2]))
"""

if __name__ == "__main__":
    sys.exit(main())
