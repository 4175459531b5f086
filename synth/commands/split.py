"""`synth split`: divide clips for training and testing, without leaks."""

import json
from dataclasses import dataclass
from pathlib import Path

from dmae.data.store import clip_folders
from dmae.files.contents import write_atomic
from dmae.reporting.tables import counted
from synth.datasets.splits import SplitBy, find_leaks, read_splits, split, write_splits

WRITES = "file"
EXAMPLES = (
    "synth split data=runs/data by=person train=0.8 validation=0.1 test=0.1 out=runs/splits.json",
    "synth split data=runs/data by=rig check=runs/splits.json",
)


@dataclass(frozen=True)
class SplitCommand:
    """Divide the clips of a data set so that no person, motion or rig is in two splits, or check an existing
    division."""

    data: str = "???"
    """Folder of a data set."""
    by: SplitBy = SplitBy.person
    """Property that two splits must not share."""
    train: float = 0.8
    """Share of the clips."""
    validation: float = 0.1
    """Share of the clips; 0 for no such split."""
    test: float = 0.1
    """Share of the clips; 0 for no such split."""
    seed: int = 0
    """Seed of the order in which clips are drawn."""
    check: str | None = None
    """JSON file of splits to check, instead of making new ones. Exits with status 1 if there are leaks."""
    out: str | None = None
    """JSON file to write: the splits, by default `splits.json` in the data set; for a check the leaks, by default
    `leaks.json` there."""


def default_out(config: SplitCommand) -> Path:
    return Path(config.data) / ("leaks.json" if config.check else "splits.json")


def run(config: SplitCommand, out: Path) -> None:
    data = Path(config.data)
    if config.check is not None:
        _check(config, data, out)
        return
    shares = {name: getattr(config, name) for name in ("train", "validation", "test")}
    splits = split(data, shares, config.by, seed=config.seed)
    write_splits(out, splits, config.by, config.seed)
    total = sum(map(len, splits.values()))
    for name, clips in splits.items():
        print(f"{out}: {name}: {counted(len(clips), 'clip')}, {len(clips) / total:.0%}")


def _check(config: SplitCommand, data: Path, out: Path) -> None:
    """Write the leaks, and raise ValueError if there are any."""
    path = Path(config.check)
    splits = read_splits(path, [folder.name for folder in clip_folders(data)])
    leaks = find_leaks(data, splits, [config.by])
    text = [str(leak) for leak in leaks]
    write_atomic(out, json.dumps({"leaks": text}, indent=1))
    if leaks:
        raise ValueError(f"{path}: {len(leaks)} leaks; {text[0]}; all are in {out}")
    print(f"{path}: no {config.by.name} is in two splits")
