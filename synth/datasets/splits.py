"""Divide takes and clips for training and testing, so that no subject, person, motion or rig is in two sets."""

import csv
import hashlib
import io
import json
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from safetensors import safe_open
from scipy.cluster.hierarchy import DisjointSet

from dmae.data.clip import person_name
from dmae.data.store import clip_folders
from dmae.data.typed import check_arguments
from dmae.files.contents import write_atomic
from dmae.files.structured import read_json
from dmae.progress import progress
from dmae.reporting.tables import counted
from synth.datasets.config import SplitBy
from synth.motion.readers.takes import LIST, NO_SET, ListedTake, find_takes, read_take_list, subject
from synth.motion.source import read_take


@dataclass(frozen=True)
class Take:
    """A take of a list."""

    listed: ListedTake  # File, subject and set of the take
    # seconds, fps: Length, s, and true frame rate, 1/s; 0 if the take cannot be read
    seconds: float
    fps: float
    notes: str  # Notes on the reading and on repairs, or the reason why the take cannot be read

    @property
    def readable(self) -> bool:
        """Whether the take can be read."""
        return self.seconds > 0


@check_arguments
def takes(
    path: str | Path, *, train: float = 0.0, validation: float = 0.0, test: float = 0.0, seed: int = 0
) -> list[Take]:
    """List takes of recorded motion, and divide them so that no subject is in two sets.

    Args:
        path: A folder of takes, or a list (TSV) of takes. Subjects and sets of a list are kept.
        train: Share of the total duration. If all three shares are 0, no sets are made.
        validation: Share of the total duration.
        test: Share of the total duration.
        seed: Seed of the order in which subjects are drawn.

    Returns:
        The takes: `listed` (file, subject, set), `seconds`, `fps`, `readable`, and `notes`, which give the reason if a
        take cannot be read.

    Raises:
        FileNotFoundError: there is no take.
        ValueError: the shares do not add up to 1, or there are fewer subjects than sets.

    Examples:
        >>> poses, trans = np.zeros((60, 66)), np.tile((0, 0, 1), (60, 1))
        >>> poses[:, 0] = np.pi / 2
        >>> np.savez("2_1.npz", poses=poses, trans=trans, fps=30)
        >>> [(take.listed.subject, take.seconds) for take in synth.takes("2_1.npz")]
        [('2', 2.0)]
    """
    path, wanted = Path(path), _wanted(train, validation, test) if train or validation or test else {}
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


def _wanted(train: float, validation: float, test: float) -> dict[str, float]:
    """Return the shares above 0, by name. Raise ValueError if they are no shares of one whole."""
    shares = {"train": train, "validation": validation, "test": test}
    if min(shares.values()) < 0 or abs(sum(shares.values()) - 1) > 1e-6:
        listed = ", ".join(f"{name}={share:g}" for name, share in shares.items())
        raise ValueError(f"expected shares from 0 to 1 that add up to 1, found {listed}")
    return {name: share for name, share in shares.items() if share > 0}


def _read(line: ListedTake) -> Take:
    try:
        motion = read_take(line.path)
    except (ValueError, FileNotFoundError) as error:
        return Take(line, 0.0, 0.0, f"left out: {error}")
    return Take(line, len(motion) / motion.fps, motion.fps, motion.name)


def _divided(takes: Sequence[Take], shares: Mapping[str, float], *, seed: int) -> list[Take]:
    seconds: dict[str, float] = defaultdict(float)
    for take in takes:
        seconds[take.listed.subject] += take.seconds
    people = sorted(person for person, length in seconds.items() if length > 0)
    if len(people) < len(shares):
        raise ValueError(
            f"{len(people)} subjects with takes that can be read, {', '.join(people)}: too few for {len(shares)} sets, "
            f"{', '.join(shares)}; set the share of a set to 0, or add takes of other subjects"
        )
    chosen = dict(zip(people, _dealt([seconds[person] for person in people], shares, seed=seed), strict=True))
    sets = [chosen[take.listed.subject] if take.readable else NO_SET for take in takes]
    return [replace(take, listed=replace(take.listed, set=name)) for take, name in zip(takes, sets, strict=True)]


def _dealt(sizes: Sequence[float], shares: Mapping[str, float], *, seed: int) -> list[str]:
    """Return the set of each group, given their sizes: in random order, each goes to the set that lacks most, none is
    empty."""
    total, taken, chosen = sum(sizes), dict.fromkeys(shares, 0.0), [""] * len(sizes)
    order = np.random.default_rng(seed).permutation(len(sizes))
    for left, index in zip(range(len(sizes), 0, -1), order, strict=True):
        empty = [name for name in shares if name not in chosen]
        eligible = empty if empty and left <= len(empty) else list(shares)
        chosen[index] = max(eligible, key=lambda name: shares[name] * total - taken[name])
        taken[chosen[index]] += sizes[index]
    return chosen


def as_table(takes: Sequence[Take], folder: Path) -> str:
    """Return a list of takes as text. Paths inside the folder in which it will be written are relative to it."""
    buffer = io.StringIO()
    table = csv.writer(buffer, delimiter="\t", lineterminator="\n")
    table.writerow(["file", "subject", "set", "seconds", "fps", "notes"])
    folder = folder.resolve()
    for take in takes:
        path = take.listed.path.resolve()
        file = (path.relative_to(folder) if path.is_relative_to(folder) else path).as_posix()
        numbers = f"{take.seconds:.2f}", f"{take.fps:.4g}"
        table.writerow([file, take.listed.subject, take.listed.set, *numbers, take.notes])
    return buffer.getvalue()


# Split data sets so that no person, motion or rig is in two splits, and find such leaks in existing splits.

FORMAT = 1
_STRETCH = re.compile(r" (?:-?\d+\.\d\d--?\d+\.\d\d s|to and fro from -?\d+\.\d\d s)")
"""What the name of a stretch has after the name of its take."""
_READING_SEPARATOR = " ("
"""Last separator in the name of a take, after the file stem. The text behind it describes how the file was read."""


class Leak(NamedTuple):
    """Something that is in several splits: its kind, and the clips of each split that contain it."""

    by: SplitBy
    clips: dict[str, list[str]]

    def __str__(self) -> str:
        places = "; ".join(
            f"{split}: {', '.join(names[:3])}{', ...' * (len(names) > 3)}" for split, names in self.clips.items()
        )
        return f"the same {self.by.name} in {places}"


def identities(folder: Path, by: SplitBy) -> set[str]:
    """Return the names of the persons, motions, subjects or rig of a clip. Equal things have equal names.

    A person is identified by all numbers of its `Body`. A recorded motion is identified by the file stem of its take,
    independent of the stretch that was cut from it. Procedural motion is identified by seed, clip and person. A rig is
    identified by K, distortion and pose of all true cameras, to 1e-6. A subject is found by
    `synth.motion.readers.takes.subject`.

    Raises:
        FileNotFoundError: there is no clip in the folder.
        ValueError: the provenance of the clip has no scene, from which persons and motions are read.
    """
    folder = Path(folder)
    if by is SplitBy.rig:
        with safe_open(folder / "arrays.safetensors", framework="numpy") as arrays:
            owner = "true_rig" if "true_rig.K" in arrays.keys() else "rig"  # noqa: SIM118
            numbers = [arrays.get_tensor(f"{owner}.{name}") for name in ("K", "dist", "cam_from_world", "size")]
        return {_digest(b"".join((each.astype(np.float64).round(6) + 0.0).tobytes() for each in numbers))}
    spec = read_json(folder / "clip.json")["provenance"].get("spec")
    if spec is None:
        raise ValueError(
            f"{folder}: no scene in the provenance of the clip, which says who moves how; by=rig needs none"
        )
    persons = spec["persons"]
    if by is SplitBy.person:
        return {_digest(json.dumps(person["body"], sort_keys=True).encode()) for person in persons}
    # A stem may contain dots: any extension stands in for the real one.
    named = (lambda take: subject(Path(f"{take}.take"))) if by is SplitBy.subject else str
    return {
        named(person["motion"][: cut.start()].rsplit(_READING_SEPARATOR, 1)[0])
        if (cut := _STRETCH.search(person["motion"]))
        else f"drawn for {person_name(number)} by {spec['seed']}/{spec['clip']}"
        for number, person in enumerate(persons)
    }


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]


@check_arguments
def split(
    path: str | Path,
    by: str = "person",
    *,
    train: float = 0.8,
    validation: float = 0.1,
    test: float = 0.1,
    seed: int = 0,
    out: str | Path | None = None,
) -> dict[str, list[str]]:
    """Divide the clips of a data set so that no person, motion or rig is in two splits.

    Args:
        path: The data set.
        by: `person`, `motion`, `subject` or `rig`.
        train: Share of the clips.
        validation: Share of the clips; 0 for no such split.
        test: Share of the clips; 0 for no such split.
        seed: Seed of the order in which clips are drawn.
        out: JSON file to write, an input of `export`; by default none is written.

    Returns:
        The names of the clips of each split, by its name.

    Raises:
        ValueError: the shares do not add up to 1, or clips share too much for this number of splits.

    Examples:
        >>> for clip in synth.generate(seconds=1, clips=2, seed=7, out="walks"): pass
        >>> parts = synth.split("walks", train=0.5, validation=0.5, test=0, out="splits.json")
        >>> [len(names) for names in parts.values()]
        [1, 1]
    """
    if by not in SplitBy.__members__:
        raise ValueError(f"by={by!r}: expected one of {', '.join(SplitBy.__members__)}")
    wanted, folders = _wanted(train, validation, test), clip_folders(Path(path))
    found = {folder.name: identities(folder, SplitBy[by]) for folder in progress(folders, "reading clips")}
    groups = _groups(found)
    if len(groups) < len(wanted):
        recorded = SplitBy[by] in (SplitBy.motion, SplitBy.subject)
        before = (
            ". Or divide the recordings before clips are made of them: synth split data=<takes> out=takes.tsv, then "
            "synth generate motion.path=takes.tsv motion.sets=[train] and so on"
        )
        raise ValueError(
            f"{path}: expected {len(wanted)} groups of clips or more that share no {by}, for {len(wanted)} splits; "
            f"found {len(groups)} in {counted(len(folders), 'clip')}; split by something else, or fewer ways"
            f"{before * recorded}"
        )
    made: dict[str, list[str]] = {name: [] for name in wanted}
    for group, name in zip(groups, _dealt([len(group) for group in groups], wanted, seed=seed), strict=True):
        made[name] += group
    made = {name: sorted(names) for name, names in made.items()}
    if out is not None:
        write_splits(Path(out), made, SplitBy[by], seed)
    return made


def _groups(found: dict[str, set[str]]) -> list[list[str]]:
    """Return groups of names of clips. Clips that share something, directly or through others, are in one group."""
    groups, owners = DisjointSet(found), {}
    for name, things in found.items():
        for thing in things:
            groups.merge(name, owners.setdefault(thing, name))
    return [list(group) for group in groups.subsets()]


def find_leaks(data: Path, splits: dict[str, list[str]], kinds: Iterable[SplitBy] = tuple(SplitBy)) -> list[Leak]:
    """Return every person, motion, subject and rig that is in several splits, and every clip that is.

    Raises ValueError if persons or motions are checked, but the provenance of a clip has no scene.
    """
    found = []
    for by in kinds:
        places: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
        for name, clips in splits.items():
            for clip in clips:
                for thing in sorted(identities(Path(data) / clip, by)):  # in the same order in every run
                    places[thing][name].append(clip)
        found += [Leak(by, dict(clips)) for clips in places.values() if len(clips) > 1]
    return found


def write_splits(path: Path, splits: dict[str, list[str]], by: SplitBy, seed: int) -> None:
    """Write a file of splits."""
    write_atomic(path, json.dumps({"format": FORMAT, "by": by.name, "seed": seed, "splits": splits}, indent=1))


def read_splits(path: Path, clips: list[str]) -> dict[str, list[str]]:
    """Read the splits that `write_splits` wrote, of a data set with these clips.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is not a file of splits, names clips that do not exist, or names a clip twice.
    """
    content = read_json(path)
    splits = content.get("splits") if isinstance(content, dict) else None
    if not isinstance(splits, dict) or content.get("format") != FORMAT:
        raise ValueError(
            f"{path}: expected splits of format {FORMAT}, as synth split writes them, found {content!r:.60}"
        )
    place: dict[str, str] = {}
    for name, members in splits.items():
        if not re.fullmatch(r"[A-Za-z][\w-]*", name) or not isinstance(members, list) or not members:
            raise ValueError(f"{path}: expected lists of clips by name of split, found {name!r}: {members!r:.60}")
        for clip in members:
            if clip not in clips:
                raise ValueError(f"{path}: split {name} has clip {clip!r}, which the data set does not have")
            if clip in place:
                raise ValueError(f"{path}: clip {clip} is in {place[clip]} and again in {name}")
            place[clip] = name
    return splits
