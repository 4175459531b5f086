"""Pieces of a job over many clips: which clips a piece holds, and whether pieces belong together."""

import json
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

from dmae.data.json_values import decode
from dmae.data.resume import claim_folder
from dmae.files.contents import write_atomic
from dmae.files.structured import read_json

SHARD = "shard.json"
"""File in the folder of a shard of a generated data set: the number of the shard and the range of its clips."""
PART = "part.json"
"""File in the folder that a command wrote for some of the clips of a data set: a `Part`."""


@dataclass(frozen=True)
class Part:
    """What a command made of some of the clips of a data set.

    Attributes:
        command: Name of the command, as "dmae capture".
        options: All of its options that the result depends on, JSON-able.
        data: Which data set it is: the number that its checksums give it, or else the name of its folder.
        of: Number of clips of the data set.
        first, stop: Number of the first clip, and of the one after the last.
    """

    command: str
    options: dict
    data: str
    of: int
    first: int
    stop: int


def clip_numbers(first: int, clips: int, shard: str | None) -> range:
    """Return the numbers of the clips to make: `first` and on, or one of the equal pieces of these.

    Args:
        first: Number of the first clip.
        clips: How many clips, of all shards together.
        shard: As "3/16", the third of sixteen pieces; None for all.

    Raises:
        ValueError: there is no such shard, or it would hold no clip.
    """
    if shard is None:
        return range(first, first + clips)
    found = re.fullmatch(r"(\d{1,9})/(\d{1,9})", shard)
    number, count = map(int, found.groups()) if found else (0, 0)
    if not 1 <= number <= count:
        raise ValueError(f"shard: expected K/N, K from 1 to N, as shard=3/16; got {shard!r}")
    if count > clips:
        raise ValueError(f"shard={shard}: expected at most as many shards as clips, {clips}")
    return range(first + clips * (number - 1) // count, first + clips * number // count)


def claim_shard(out: Path, first: int, clips: int, shard: str | None) -> None:
    """Note in the folder of a data set which shard it holds; of a whole data set, or a range, nothing is noted.

    Raises:
        ValueError: the folder holds another shard, or is no shard's.
    """
    out = Path(out)
    if shard is None:
        if (out / SHARD).is_file():
            raise ValueError(f"out={out}: the folder holds a shard, see {SHARD}; give its shard=..., or another out")
        return
    if not (out / SHARD).is_file() and any(out.glob("*/clip.json")):
        raise ValueError(f"out={out}: expected a folder of its own for shard={shard}, found clips of no shard")
    claim_folder(out / SHARD, {"shard": shard, "first": first, "clips": clips}, "a shard")


def numbers_of(total: int, first: int, clips: int | None, shard: str | None) -> range:
    """Return the numbers of those of `total` clips that `first=`, `clips=` and `shard=` of a command name.

    Args:
        clips: How many, of all shards together; None for all from `first` on.

    Raises:
        ValueError: there are no such clips.
    """
    if not 0 <= first < max(total, 1):
        raise ValueError(f"first={first}: expected the number of a clip, from 0 to {total - 1}")
    if clips is not None and not 1 <= clips <= total - first:
        raise ValueError(f"clips={clips}: expected from 1 to {total - first}, there are {total} clips")
    return clip_numbers(first, total - first if clips is None else clips, shard)


def write_part(out: Path, part: Part | None) -> None:
    """Write `part.json` of a result; of a whole one remove that of an earlier run."""
    path = Path(out) / PART
    if part is None:
        path.unlink(missing_ok=True)
    else:
        write_atomic(path, json.dumps(asdict(part), indent=1))


def read_parts(folders: Sequence[Path], *, partial: bool = False) -> list[tuple[Path, Part]]:
    """Read the parts of a result, and check that they belong together.

    Args:
        folders: In any order.
        partial: Whether clips may be missing.

    Returns:
        Each folder and its part, in the order of the clips.

    Raises:
        FileNotFoundError: a folder holds no part.
        ValueError: parts are of other commands, options or data, a clip is in two of them, or clips are missing.
    """
    if not folders:
        raise ValueError("data: expected the folders of the parts, as data=[runs/1,runs/2], got none")
    found = sorted(((Path(folder), _read_part(Path(folder))) for folder in folders), key=lambda each: each[1].first)
    start, expected = found[0]
    for folder, part in found[1:]:
        for name in ("command", "of", "data", "options"):
            one, other = _compared(getattr(expected, name)), _compared(getattr(part, name))
            if one != other:
                raise ValueError(f"{folder}: expected a part of the same as {start}, {_differing(name, one, other)}")
    for (before, one), (folder, other) in pairwise(found):
        if other.first < one.stop:
            raise ValueError(f"clip number {other.first} is in {before} and in {folder}; leave one out of data")
    ends = [0, *(part.stop for _, part in found)]
    firsts = [*(part.first for _, part in found), expected.of]
    missing = [f"{end} to {first - 1}" for end, first in zip(ends, firsts, strict=True) if end < first]
    if missing and not partial:
        raise ValueError(
            f"clips number {', '.join(missing)} are in none of {', '.join(str(folder) for folder, _ in found)}; give "
            "the folders that hold them, or partial=true to join without them"
        )
    return found


def _read_part(folder: Path) -> Part:
    path = folder / PART
    if not path.is_file():
        raise FileNotFoundError(
            f"{folder}: expected {PART}, which commands with shard=..., first=... or clips=... write at the end; "
            "was the command interrupted?"
        )
    part = decode(Part, read_json(path), str(path))
    if not 0 <= part.first < part.stop <= part.of:
        raise ValueError(f"{path}: expected 0 <= first < stop <= of, found {part.first}, {part.stop}, {part.of}")
    return part


def _compared(value):
    """Return what parts must share: machines may have the same data set at different paths."""
    if isinstance(value, dict) and isinstance(value.get("data"), dict):
        return value | {"data": value["data"] | {"path": None}}
    return value


def _differing(name: str, one, other) -> str:
    if isinstance(one, dict) and isinstance(other, dict):
        keys = sorted(key for key in one | other if one.get(key) != other.get(key))
        return f"{name} differ in {', '.join(keys)}"
    return f"found {name} {other!r:.80}, not {one!r:.80}"
