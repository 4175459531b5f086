"""`synth takes`: list takes, check that they can be read, and divide them into sets that share no subject."""

from dataclasses import dataclass
from pathlib import Path

from dmae.files.contents import write_atomic
from synth.datasets.splits import as_table, list_takes
from synth.motion.readers.takes import find_subject_leaks

WRITES = "file"
EXAMPLES = (
    "synth takes path=mocap train=0.8 validation=0.1 test=0.1 out=runs/takes.tsv",
    "synth takes path=runs/takes.tsv out=runs/checked.tsv",
    "synth generate motion=recorded motion.path=runs/takes.tsv motion.sets=[train] out=runs/train",
)


@dataclass(frozen=True)
class TakesCommand:
    """List takes of recorded motion with their subjects, and divide them so that no subject is in two sets; or check a
    list. Takes that cannot be read are listed with the reason, and are not in any set."""

    path: str = "???"
    """Folder of takes, or a list (TSV) to check. Exits with status 1 if a subject is in two sets of the list."""
    train: float = 0.0
    """Share of the seconds; all 0 for no sets."""
    validation: float = 0.0
    """Share of the seconds."""
    test: float = 0.0
    """Share of the seconds."""
    seed: int = 0
    """Seed of the order in which subjects are drawn."""
    out: str | None = None
    """File (TSV) to write, by default `takes.tsv` in the folder."""


def default_out(config: TakesCommand) -> Path:
    path = Path(config.path)
    return path / "takes.tsv" if path.is_dir() else path.with_name(f"{path.stem}_checked.tsv")


def run(config: TakesCommand, out: Path) -> None:
    shares = {name: getattr(config, name) for name in ("train", "validation", "test")}
    takes = list_takes(Path(config.path), shares, seed=config.seed)
    write_atomic(out, as_table(takes, out.parent))
    for take in takes:
        if not take.readable:
            print(take.notes)
    readable = [take for take in takes if take.readable]
    for name in sorted({take.listed.set for take in readable}):
        part = [take for take in readable if take.listed.set == name]
        people = len({take.listed.subject for take in part})
        minutes = sum(take.seconds for take in part) / 60
        print(f"{out}: set {name}: {len(part)} takes of {people} subjects, {minutes:.1f} minutes")
    print(f"{out}: {len(readable)} takes, {len(takes) - len(readable)} left out")
    leaks = find_subject_leaks(take.listed for take in takes)
    if leaks:
        raise ValueError(f"{config.path}: {len(leaks)} leaks; {leaks[0]}")
