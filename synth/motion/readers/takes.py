"""Takes of motion in files, in folders and in lists, and what the files of the CMU database do not state."""

import csv
import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from dmae.files.contents import read_text
from synth.motion.readers import format_of, reader, take_name
from synth.motion.readers.recording import find_text

# From the database's index: all takes of these subjects, and these single takes, were captured at 60 Hz, others at 120.
_SIXTY_HZ = frozenset({33, 34, 42, 60, 61, 62, 74, 75, 77, 79, 80, 87, 88, 89})
_SIXTY_HZ_TAKES = frozenset({(136, 19)})
_PARTNER_SUBJECTS = {18: 19, 20: 21, 22: 23, 33: 34, 60: 61}
"""Pairs of subjects that were captured together, in the same trials and the same world."""


def true_fps(stem: str, stated: float) -> float:
    """Return the rate at which a take was captured, frames/s. Conversions often state 120 for takes at 60.

    The name of the take identifies it, `<subject>_<trial>`; `salsa_` stands for subjects 60 and 61. A stated rate of
    120 is corrected if the take was captured at 60 Hz. Any other rate is returned as stated. The motion itself does not
    show its rate, except in a jump, in which the body must fall with gravity.
    """
    take = subject_and_trial(stem)
    return 60.0 if (take[0] in _SIXTY_HZ or take in _SIXTY_HZ_TAKES) and 119 < stated < 121 else stated


def partner(path: Path) -> Path | None:
    """Return the take of the other person in a two-person take, in the same frames and world, if beside it."""
    name = take_name(path)
    subject, trial = subject_and_trial(name)
    if name.startswith("salsa_"):
        stems = [f"salsa_{trial + 15:02}" if subject == 60 else f"salsa_{trial:02}"]
    else:
        others = _PARTNER_SUBJECTS | {b: a for a, b in _PARTNER_SUBJECTS.items()}
        stems = [f"{others[subject]:0{digits}}_{trial:02}" for digits in (2, 3) if subject in others]
    places = [path.with_name(stem + path.name[len(name) :]) for stem in stems]
    there = [place for place in places if place.is_file()]
    return there[0] if there else None


def subject(path: Path) -> str:
    """Return the subject of a take from its name: partners count as one, as `60+61`; without a number, the name."""
    number = subject_and_trial(take_name(path))[0]
    for one, other in _PARTNER_SUBJECTS.items():
        if number in (one, other):
            return f"{one}+{other}"
    return str(number) if number else take_name(path)


def subject_and_trial(stem: str) -> tuple[int, int]:
    """Return subject and trial from a file's stem; (0, 0) if it has none."""
    if match := re.fullmatch(r"salsa_(\d+)", stem):
        # 1 to 15 are subject 60, 16 to 30 subject 61.
        return 60 + (int(match[1]) > 15), (int(match[1]) - 1) % 15 + 1
    match = re.match(r"(?:cmu_)?(\d+)_(\d+)", stem)
    return (int(match[1]), int(match[2])) if match else (0, 0)


LIST = ".tsv"
"""Extension of lists of takes: tab-separated tables with the columns `file`, `subject`, `set`, and any others."""
NO_SET = "-"
"""In a list, the set of a take that belongs to no set."""
_MOST_BYTES = 1 << 26
_LONGEST_PATH, _LONGEST_NAME = 1000, 250
"""Greatest length of a path, and of each name in it, bytes; this leaves room for the extension of a compression."""
_UNKNOWN = ("", "?")


@dataclass(frozen=True)
class ListedTake:
    """A line of a list of takes."""

    path: Path  # The file of the take, with the extension of its compression, which the list may leave out
    subject: str  # The person who was recorded; people recorded together count as one
    set: str = NO_SET  # Name of the set, such as `train`, or `-` for none


def find_takes(path: Path, kind: str | None = None, sets: Sequence[str] = ()) -> list[Path]:
    """Return the files of takes at a path: a file, a folder that is searched at any depth and sorted, or a list of
    takes, in its order, from which sets may be chosen. `kind` is the format of the takes; None for all formats.

    Raises:
        FileNotFoundError: there is no such file or folder, or no file of the format in it.
        ValueError: the list is malformed or has no such set, or `sets` is given for a path that is no list.
    """
    if not path.exists():
        raise FileNotFoundError(f"motion path {path}: no such file or folder")
    listed = path.suffix.lower() == LIST and path.is_file()
    if sets and not listed:
        raise ValueError(f"motion path {path}: expected a list of takes ({LIST}) for motion.sets={list(sets)}")
    if listed:
        lines = read_take_list(path)
        known = {line.set for line in lines}
        if unknown := sorted(set(sets) - known):
            raise ValueError(f"{path}: expected sets among {', '.join(sorted(known))}, found {', '.join(unknown)}")
        found = [line.path for line in lines if not sets or line.set in sets]
    else:
        found = sorted(path.rglob("*")) if path.is_dir() else [path]
    fitting = [file for file in found if (format_of(file) if kind is None else format_of(file) == kind)]
    fitting = [file for file in fitting if listed or file.is_file()]
    if not fitting:
        wanted = " ".join(f".{name}" for name in reader) if kind is None else f".{kind}"
        there = sorted({file.suffix for file in found if file.is_file()})
        raise FileNotFoundError(f"motion path {path}: expected {wanted} files, found {there or 'no files'}")
    return fitting


def read_take_list(path: Path) -> list[ListedTake]:
    """Read a list of takes. Lines with other files, such as skeletons, are left out.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: a column is missing, a name is not possible for a file, or a file is listed twice.
    """
    rows = csv.DictReader(read_text(path, _MOST_BYTES).splitlines(), delimiter="\t", strict=True)
    try:
        lines = list(rows)
    except csv.Error as error:
        raise ValueError(f"{path}: expected lines of words separated by tabs, {error}") from None
    missing = [name for name in ("file", "subject", "set") if name not in (rows.fieldnames or ())]
    if missing:
        raise ValueError(
            f"{path}: expected a first line of file, subject and set, separated by tabs, found no {', '.join(missing)}"
        )
    found: dict[Path, ListedTake] = {}
    for number, line in enumerate(lines, 2):
        name = line["file"] or ""
        longest = max(len(part.encode()) for part in re.split(r"[/\\]", name))
        if not name or "\0" in name or len(name.encode()) > _LONGEST_PATH or longest > _LONGEST_NAME:
            raise ValueError(f"{path}, line {number}: expected the name of a file, found {line['file']!r:.80}")
        if format_of(Path(name)) is None:
            continue
        file = path.parent / name
        file = find_text(file) or file
        if file in found:
            raise ValueError(f"{path}, line {number}: {name} is listed twice")
        stated = line["subject"] or ""
        person = subject(file) if stated in _UNKNOWN else stated
        found[file] = ListedTake(file, person, line["set"] or NO_SET)
    return list(found.values())


def find_subject_leaks(lines: Iterable[ListedTake]) -> list[str]:
    """Return a line for each subject with takes in several sets; people recorded together are one subject."""
    places: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for line in lines:
        if line.set != NO_SET:
            by_name = subject(line.path)
            # Lists may give each partner their own number.
            person = by_name if line.subject in by_name.split("+") else line.subject
            places[person][line.set].append(line.path.name)
    return [
        f"subject {person} in " + "; ".join(f"{name}: {', '.join(files[:3])}" for name, files in sorted(sets.items()))
        for person, sets in sorted(places.items())
        if len(sets) > 1
    ]
