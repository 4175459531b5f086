"""Which clips of a data set a part of it holds: a range, or a shard of all clips."""

import re
from pathlib import Path

from dmae.data.resume import claim_folder

SHARD = "shard.json"
"""In the folder of a shard: which one it is, and of which clips."""


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
