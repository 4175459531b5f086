"""Lists of takes with their lengths, and sets of takes that share no subject."""

import csv
import io
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dmae.progress import progress
from synth.motion.readers.cmu import subject
from synth.motion.readers.take_lists import LIST, NO_SET, ListedTake, find_takes, read_take_list
from synth.motion.source import read_take


@dataclass(frozen=True)
class Take:
    """A take of a list.

    Attributes:
        listed: File, subject and set of the take.
        seconds, fps: Length, s, and true frame rate, 1/s; 0 if the take cannot be read.
        notes: Notes on the reading and on repairs, or the reason why the take cannot be read.
    """

    listed: ListedTake
    seconds: float
    fps: float
    notes: str

    @property
    def readable(self) -> bool:
        """Whether the take can be read."""
        return self.seconds > 0


def list_takes(path: Path, shares: Mapping[str, float], *, seed: int = 0) -> list[Take]:
    """Read all takes at a path. Takes of a folder are divided into sets that share no subject.

    Args:
        path: A folder, a file, or a list of takes. Subjects and sets of a list are kept.
        shares: Share of the total duration by name of set; empty for no sets.
        seed: Seed of the order in which subjects are drawn.

    Raises:
        FileNotFoundError: there is no take.
        ValueError: the shares do not add up to 1, the list already has sets, or there are fewer subjects than sets.
    """
    wanted = {name: share for name, share in shares.items() if share > 0}
    if wanted and abs(sum(wanted.values()) - 1) > 1e-6:
        raise ValueError(f"expected shares from 0 to 1 that add up to 1, got {dict(shares)}")
    if path.suffix.lower() == LIST and path.is_file():
        lines = read_take_list(path)
        if wanted:
            raise ValueError(
                f"{path}: a list has its sets already; leave out the shares, or give the folder of its takes"
            )
    else:
        lines = [ListedTake(file, subject(file)) for file in find_takes(path)]
    found = [_read(line) for line in progress(lines, "reading takes")]
    return _divided(found, wanted, seed=seed) if wanted else found


def _read(line: ListedTake) -> Take:
    try:
        motion = read_take(line.path)
    except (ValueError, FileNotFoundError) as error:
        return Take(line, 0.0, 0.0, f"left out: {error}")
    return Take(line, len(motion) / motion.fps, motion.fps, motion.name)


def _divided(takes: Sequence[Take], shares: Mapping[str, float], *, seed: int) -> list[Take]:
    """Return the takes with their sets. In random order, each subject goes to the set that lacks most time."""
    seconds: dict[str, float] = defaultdict(float)
    for take in takes:
        seconds[take.listed.subject] += take.seconds
    people = sorted(person for person, length in seconds.items() if length > 0)
    if len(people) < len(shares):
        raise ValueError(
            f"{len(people)} subjects with takes that can be read, {', '.join(people)}: too few for {len(shares)} sets, "
            f"{', '.join(shares)}; set the share of a set to 0, or add takes of other subjects"
        )
    total = sum(seconds.values())
    lacking = {name: share * total for name, share in shares.items()}
    chosen: dict[str, str] = {}
    for left, index in zip(
        range(len(people), 0, -1), np.random.default_rng(seed).permutation(len(people)), strict=True
    ):
        empty = [name for name in shares if name not in chosen.values()]
        eligible = empty if empty and left <= len(empty) else list(shares)
        chosen[people[index]] = max(eligible, key=lambda name: lacking[name])
        lacking[chosen[people[index]]] -= seconds[people[index]]
    return [
        Take(
            ListedTake(take.listed.path, take.listed.subject, chosen[take.listed.subject] if take.readable else NO_SET),
            take.seconds,
            take.fps,
            take.notes,
        )
        for take in takes
    ]


def as_table(takes: Sequence[Take], folder: Path) -> str:
    """Return a list of takes as text. Paths are relative to the folder in which the list will be written."""
    buffer = io.StringIO()
    table = csv.writer(buffer, delimiter="\t", lineterminator="\n")
    table.writerow(["file", "subject", "set", "seconds", "fps", "notes"])
    for take in takes:
        line = take.listed
        table.writerow(
            [
                _relative_path(line.path, folder),
                line.subject,
                line.set,
                f"{take.seconds:.2f}",
                f"{take.fps:.4g}",
                take.notes,
            ]
        )
    return buffer.getvalue()


def _relative_path(path: Path, folder: Path) -> str:
    """Return a path relative to a folder if it is inside that folder, otherwise the whole path."""
    path, folder = path.resolve(), folder.resolve()
    return path.relative_to(folder).as_posix() if path.is_relative_to(folder) else path.as_posix()
