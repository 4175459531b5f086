"""Record what a command measures in `docs/results/`, with the command line, versions, date and commit.

    python docs/tools/record.py             # everything in RECORDED
    python docs/tools/record.py shelf       # one of them

The command is run with `out=` in a temporary folder, and the `scores.json` that it leaves is kept,
less its single runs.
"""

import json
import os
import platform
import subprocess
import sys
import tempfile
from datetime import date
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).parents[2]
_ALL = "measured,linear,pchip_body,kalman,reject_pchip,rays,gaussian_process,reject_gaussian_process"

RECORDED = {
    "shelf": (
        f"dmae evaluate data=shelf data.path=$DMAE_DATA/shelf views=[5,4,3] "
        f"methods=[{_ALL},dmae,dmae_reject,dmae_denoise,dmae_online]",
        "10 minutes",
    ),
    "shelf_holes": (
        "dmae evaluate data=shelf data.path=$DMAE_DATA/shelf views=[3] reference=capture smooth=0 "
        "methods=[linear,pchip_body,rays,gaussian_process,reject_gaussian_process,dmae,dmae_reject]",
        "5 minutes",
    ),
    "shelf_paper": (
        "dmae evaluate data=shelf data.path=$DMAE_DATA/shelf views=[5,4,3] capture=paper methods=[linear]",
        "2 minutes",
    ),
    "benchmark_occlusion_v1": (
        "dmae benchmark name=occlusion-v1 size=full workers=2 methods=[measured,linear,linear_body,pchip_body,kalman,"
        "rays,gaussian_process,reject_pchip,reject_gaussian_process,dmae,dmae_reject]",
        "15 minutes",
    ),
    "regress": ("dmae regress solver=dmae.regression.solvers:ours", "1 minute"),
}
"""Results to the command that makes them and about how long that takes on two cores."""


def record(name: str, command: str) -> Path:
    """Run a command and write its scores to `docs/results/<name>.json`.

    Raises:
        CalledProcessError: the command failed.
    """
    programs = Path(sys.executable).parent
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "out")
        line = f"{programs}/{command}" + (f" out={out}" if command.split()[1] in ("evaluate", "benchmark") else "")
        done = subprocess.run(line, shell=True, check=True, cwd=folder, stdout=subprocess.PIPE, text=True)
        found = (
            {"scores": less_runs(json.loads((out / "scores.json").read_text()))}
            if out.is_dir()
            else {"printed": done.stdout}
        )
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True).stdout
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("dmae-synth", "numpy", "torch", "mujoco"))
    made = {
        "command": command.replace("$DMAE_DATA", "DATA"),
        "date": date.today().isoformat(),
        "commit": commit.strip(),
        "versions": f"python {platform.python_version()}, {versions}",
        **found,
    }
    path = ROOT / "docs/results" / f"{name}.json"
    path.write_text(json.dumps(made, indent=1) + "\n")
    return path


def less_runs(scores: dict) -> dict:
    """The scores without those of single clips."""
    for result in scores.get("results", []):
        result.pop("runs", None)
    scores.pop("clips", None)
    for task in ("completion", "capture"):
        for entry in scores.get(task, {}).values():
            entry.pop("clips")
    return scores


if __name__ == "__main__":
    if not os.environ.get("DMAE_DATA"):
        sys.exit("set DMAE_DATA to the folder that holds shelf/")
    for wanted in sys.argv[1:] or RECORDED:
        if wanted not in RECORDED:
            sys.exit(f"no results {wanted!r}; there are {', '.join(RECORDED)}")
        text, duration = RECORDED[wanted]
        print(f"{wanted}, about {duration}: {text}")
        print(record(wanted, text))
