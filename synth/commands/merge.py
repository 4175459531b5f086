"""`synth merge`: join the parts of a data set that several machines made."""

from dataclasses import dataclass, field
from pathlib import Path

from dmae.reporting.words import counted
from synth.datasets.parts.merge import merge

WRITES = "folder"
EXAMPLES = (
    "synth merge data=[runs/shards/1,runs/shards/2,runs/shards/3] out=runs/data",
    "synth merge data=[runs/a,runs/c] partial=true out=runs/some",
)


@dataclass(frozen=True)
class MergeCommand:
    """Join the parts of a data set: ranges or shards of one configuration and seed."""

    data: list[str] = field(default_factory=list)
    """Folders of the parts, in any order."""
    partial: bool = False
    """Join even if clips are missing, between others or of shards."""
    out: str = "runs/merged"
    """Folder of the data set; it does not exist yet, or is empty."""


def run(config: MergeCommand, out: Path) -> None:
    lines = merge(config.data, out, partial=config.partial)
    failed = sum(line["status"] != "ok" for line in lines)
    print(f"{out}: {counted(len(lines) - failed, 'clip')}, {failed} failed")


def interrupted(config: MergeCommand, out: Path) -> str:
    return f"nothing was written to {out}; the same command starts again"
