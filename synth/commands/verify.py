"""`synth verify`: check that clips are whole and true."""

import json
from dataclasses import dataclass
from pathlib import Path

from dmae.data.store import write_atomic
from dmae.reporting.tables import Table, print_tables
from synth.datasets.verify import CHECKS, verify

WRITES = "file"
EXAMPLES = ("synth verify path=runs/data", "synth verify path=runs/data/000000 out=runs/verify.json")
_SHOWN = 20
"""So many problems are printed; all are written."""


@dataclass(frozen=True)
class VerifyCommand:
    """Check that clips are whole and true. Exits with status 1 if they are not."""

    path: str = "???"
    """Folder of a clip, or of a data set."""
    out: str | None = None
    """JSON file of what was found; by default `verify.json` in the folder that is checked."""


def default_out(config: VerifyCommand) -> Path:
    return Path(config.path) / "verify.json"


def run(config: VerifyCommand, out: Path) -> None:
    """Print how many clips fail each check, write what is wrong to `out`; ValueError if anything is."""
    clips, problems = verify(Path(config.path))
    write_atomic(out, json.dumps({"clips": clips, "problems": [p._asdict() for p in problems]}, indent=1))
    rows = []
    for check, meaning in CHECKS.items():
        failing = sorted({problem.clip for problem in problems if problem.check == check})
        some = ", ".join(failing[:3]) + (", ..." if len(failing) > 3 else "")
        rows.append((f"{check}: {meaning}", str(len(failing)), some or "-"))
    print_tables([Table(f"{config.path}: {len(clips)} clips", ("check", "fail", "which"), rows)])
    print(out)
    for clip, check, what in problems[:_SHOWN]:
        print(f"{clip}: {check}: {what}")
    if problems:
        more = f"; {len(problems) - _SHOWN} more of them are in {out}" if len(problems) > _SHOWN else ""
        failing = len({problem.clip for problem in problems})
        raise ValueError(f"{config.path}: {len(problems)} problems in {failing} of {len(clips)} clips{more}")
