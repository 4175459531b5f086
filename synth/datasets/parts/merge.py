"""Join the parts of a data set into one. The result is the same as from a single run."""

import os
import shutil
from pathlib import Path

from dmae.data.store import CHECKSUMS, MANIFEST, read_manifest, write_manifest
from dmae.files.checksums import clip_checksum, end_data_set, refuse_damaged
from dmae.files.contents import check_vacant, whole_folder
from dmae.files.structured import read_json
from dmae.parts import SHARD
from dmae.progress import progress
from synth.datasets.clip import clip_id
from synth.datasets.generate import CONFIG

_SHOWN = 3
"""Greatest number of clip names in a message."""


def merge(data: list[Path], out: Path, *, partial: bool = False) -> list[dict]:
    """Join data sets with the same configuration and seed, which contain different clips.

    The files are hard links to the files of the parts if the file system allows it, otherwise copies. The joined data
    set appears only when it is complete.

    Args:
        data: Folders of the parts, in any order.
        out: Folder of the joined data set; it must be empty or not exist.
        partial: Whether clips may be missing, between other clips or in shards.

    Returns:
        The lines of the manifest.

    Raises:
        FileNotFoundError: a part is not a data set.
        ValueError: a part is damaged or has another configuration, a clip is in two parts, clips are missing, or `out`
            is not empty.
    """
    data, out = [Path(path) for path in data], Path(out)
    if not data:
        raise ValueError("data: expected the folders of the parts, as data=[runs/1,runs/2], got none")
    check_vacant(out, "the joined data set")
    lines = _lines(data)
    if not partial:
        _check_complete(data, set(lines))
    for path in data:
        refuse_damaged(path, None)
    with whole_folder(out) as folder:
        shutil.copyfile(data[0] / CONFIG, folder / CONFIG)
        checksums = {}
        for name in progress(sorted(lines), "joining clips", len(lines)):
            path, line = lines[name]
            if line["status"] == "ok":
                shutil.copytree(path / name, folder / name, copy_function=_link)
                checksums[name] = clip_checksum(folder / name)
        write_manifest(folder, [line for _, line in lines.values()])
        end_data_set(folder, (CONFIG,), checksums)
    return read_manifest(out)


def _lines(data: list[Path]) -> dict[str, tuple[Path, dict]]:
    """Return for each clip, by its name, its part and its line of the manifest."""
    lines: dict[str, tuple[Path, dict]] = {}
    settings = None
    for path in data:
        for name in (MANIFEST, CONFIG, CHECKSUMS):
            if not (path / name).is_file():
                raise FileNotFoundError(
                    f"{path}: expected a data set with {name}, as synth generate makes it; was the command interrupted?"
                )
        found = read_json(path / CONFIG)
        if settings is not None and found != settings:
            differing = sorted(key for key in found | settings if found.get(key) != settings.get(key))
            raise ValueError(
                f"{path}: expected the configuration of {data[0]}, {CONFIG} differs in {', '.join(differing)}"
            )
        settings = found
        for line in read_manifest(path):
            if line["id"] in lines:
                raise ValueError(f"clip {line['id']} is in {lines[line['id']][0]} and in {path}; leave one out of data")
            lines[line["id"]] = path, line
    return lines


def _check_complete(data: list[Path], names: set[str]) -> None:
    """Raise ValueError if clips between other clips, or clips of absent shards, are missing."""
    shards = [read_json(path / SHARD) for path in data if (path / SHARD).is_file()]
    prefix = read_json(data[0] / CONFIG).get("prefix", "")
    numbers = [int(name.removeprefix(prefix)) for name in names]
    last = max([*numbers, *(shard["first"] + shard["clips"] - 1 for shard in shards)])
    first = min([shard["first"] for shard in shards], default=0)
    missing = [
        name for number in range(min(first, *numbers), last + 1) if (name := prefix + clip_id(number)) not in names
    ]
    if missing:
        more = f" and {len(missing) - _SHOWN} more" if len(missing) > _SHOWN else ""
        raise ValueError(
            f"clips {', '.join(missing[:_SHOWN])}{more} are in none of {', '.join(map(str, data))}; give the folders "
            "that hold them, or partial=true to join without them"
        )


def _link(source: str, target: str) -> None:
    try:
        os.link(source, target)
    except OSError:
        # The folder is on another file system, or the file system has no links.
        shutil.copy2(source, target)
