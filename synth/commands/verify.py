"""`synth verify`: check that clips are complete and true."""

import json
from pathlib import Path

from dmae.files.contents import write_atomic
from dmae.reporting.tables import Table, counted, listed, print_tables
from synth.commands.config import VerifyCommand
from synth.datasets.verify import CHECKS, DATA_SET, verify

_SHOWN = 20
"""Greatest number of problems, and of clip names, that are printed. The file contains all of them."""


def default_out(config: VerifyCommand) -> Path:
    return Path(config.data) / "verify.json"


def run(config: VerifyCommand, out: Path) -> None:
    """Print the number of clips that fail each check, and write all problems to `out`; ValueError if there are any."""
    found = verify(Path(config.data), fast=config.fast)
    written = found._asdict() | {"problems": [problem._asdict() for problem in found.problems]}
    write_atomic(out, json.dumps(written, indent=1))
    rows = []
    for check, meaning in CHECKS.items():
        failing = sorted({problem.clip for problem in found.problems if problem.check == check})
        rows.append((f"{check}: {meaning}", str(len(failing)), listed(failing, 3) or "-"))
    print_tables([Table(f"{config.data}: {counted(len(found.clips), 'clip')}", ("check", "fail", "which"), rows)])
    print(out)
    if found.without:
        print(
            f"{len(found.without)} of {len(found.clips)} clips have no checksums: they were saved or captured "
            "one by one. Changes that cause no contradiction are not found in them"
        )
    for clip, check, what in found.problems[:_SHOWN]:
        print(f"{clip}: {check}: {what}")
    if found.again:
        print(f"to regenerate, with the command that made the data set: {listed(found.again, _SHOWN)}")
    if not found.problems:
        if found.number:
            print(f"sha256 of all: {found.number}")
        return
    more = f"; {len(found.problems) - _SHOWN} more of them are in {out}" if len(found.problems) > _SHOWN else ""
    where = f"{len(found.again)} of {counted(len(found.clips), 'clip')}"
    where += " and in the data set's own files" if any(problem.clip == DATA_SET for problem in found.problems) else ""
    raise ValueError(f"{config.data}: {counted(len(found.problems), 'problem')} in {where}{more}")
