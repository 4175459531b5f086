"""Memory and time of capture and completion, by length and by frame rate: `docs/results/lengths_and_rates.json`.

    python docs/tools/lengths_and_rates.py                # ten minutes of one core
    python docs/tools/lengths_and_rates.py 1000 100000    # these lengths; then the rates

One person walks to and fro before two cameras. Each command is a process of its own, and the most memory that it holds,
libraries and mapped files included, is looked up when it has ended. The first run of all compiles functions, so a short
recording goes first and is not recorded.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))
from tests.endurance.long_recording import LINES, RESULTS, peak_memory

ROOT = Path(__file__).parents[2]
LENGTHS = 1_000, 10_000
RATES = 0.001, 1 / 75, 1.5, 25, 250, 1000
AT_RATES = 300
"""Frames of the recordings of other rates."""
WRITE = """
import sys
from dataclasses import replace
from pathlib import Path
from dmae.data.store import load_clip, save_clip
from tests.endurance.long_recording import write_recording
folder = Path(sys.argv[1])
write_recording(int(sys.argv[2]), folder)
save_clip(replace(load_clip(folder / "recording").select(views=[0, 1]), fps=float(sys.argv[3])), folder / "two")
"""


def measured(frames: int, fps: float = 25.0) -> list[str]:
    """Return MB and seconds of processor time, of capture and of completion."""
    with tempfile.TemporaryDirectory() as name:
        folder, row = Path(name), []
        # In a process of its own: a child begins with the memory of its parent.
        subprocess.run([sys.executable, "-c", WRITE, name, str(frames), str(fps)], check=True, cwd=ROOT)
        for step in ("capture", "complete"):
            line = [part.replace("recording", "two") for part in LINES[step]]
            found = peak_memory((*line, f"out={RESULTS[step]}"), folder)
            row += [f"{found['mb']:.0f}", f"{found['cpu_seconds']:.1f}"]
    return row


if __name__ == "__main__":
    lengths = [int(each) for each in sys.argv[1:]] or LENGTHS
    measured(300)
    tables = {}
    for name, label, cells in (
        ("rates", "frames/s", [(f"{rate:.3g}", (AT_RATES, rate)) for rate in RATES]),
        ("lengths", "frames", [(f"{length:,}", (length,)) for length in lengths]),
    ):
        rows = []
        for text, options in cells:
            rows.append([text, *measured(*options)])
            print(name, *rows[-1], flush=True)
        tables[name] = [label, "capture, MB", "s", "complete, MB", "s"], rows
    # Imported last, as it takes memory, with which children would begin.
    from planted_recordings import write_tables

    write_tables("lengths_and_rates", tables)
