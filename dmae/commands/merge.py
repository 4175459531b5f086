"""`dmae merge`: what several machines made of parts of a data set, joined."""

import json
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from dmae.data.json_values import json_text
from dmae.data.store import CHECKSUMS, read_manifest, write_manifest
from dmae.evaluation.joining import join_scores, join_stress
from dmae.evaluation.scores import read_scores
from dmae.evaluation.stress.page import write_result
from dmae.files.checksums import clip_checksum, end_data_set, refuse_damaged, write_checksums
from dmae.files.contents import check_vacant, whole_folder, write_atomic
from dmae.files.structured import read_json
from dmae.parts import Part, read_parts
from dmae.progress import progress
from dmae.reporting.tables import counted

WRITES = "folder"
EXAMPLES = (
    "dmae merge data=[runs/shards/1,runs/shards/2,runs/shards/3] out=runs/captured",
    "dmae merge data=[runs/scores_shards/1,runs/scores_shards/2] out=runs/scores",
)


@dataclass(frozen=True)
class MergePartsCommand:
    """Join parts that `dmae capture`, `evaluate` or `stress` made with shard=..., first=... or clips=...

    Parts of generated data sets are joined by `synth merge`.
    """

    data: list[str] = field(default_factory=list)
    """Folders of the parts, in any order."""
    partial: bool = False
    """Join even if clips are missing."""
    clips: str | None = None
    """For stress tests: folder of the data set, if it has moved since the first part was made."""
    out: str = "runs/merged"
    """Folder to write; it does not exist yet, or is empty."""


def run(config: MergePartsCommand, out: Path) -> None:
    """Join the parts, and print what was joined."""
    said = join_parts([Path(folder) for folder in config.data], out, partial=config.partial, clips=config.clips)
    print(f"{out}: {said}")


def join_parts(folders: Sequence[Path], out: Path, *, partial: bool, clips: str | None) -> str:
    """Join parts into a folder, which is written whole or not at all; return what was joined.

    Args:
        folders: Of the parts, in any order.
        out: Does not exist yet, or is empty.
        partial, clips: As of the command.

    Raises:
        FileNotFoundError: a folder holds no part.
        ValueError: parts do not belong together or are damaged, clips are missing, or `out` is not empty.
    """
    check_vacant(out, "what is joined")
    parts = read_parts(folders, partial=partial)
    command = parts[0][1].command
    if command not in _JOIN:
        raise ValueError(f"{parts[0][0]}: expected a part made by {', '.join(_JOIN)}, found one by {command!r}")
    with whole_folder(out) as folder:
        return _JOIN[command](parts, folder, out, clips)


def interrupted(config: MergePartsCommand, out: Path) -> str:
    return f"nothing was written to {out}; the same command starts again"


def _join_captured(parts: list[tuple[Path, Part]], folder: Path, out: Path, clips: str | None) -> str:
    """Join data sets. Files are hard links to those of the parts, where the file system has links."""
    for path, _ in parts:
        refuse_damaged(path, None)
    lines, checksums = [], {}
    found = [(path, line) for path, _ in parts for line in read_manifest(path)]
    for path, line in progress(found, "joining clips", len(found)):
        name = line["id"]
        if name in checksums:
            raise ValueError(f"clip {name} is in {path} and in another part; leave one out of data")
        shutil.copytree(path / name, folder / name, copy_function=_link, ignore=shutil.ignore_patterns(CHECKSUMS))
        _move_images(path / name, folder / name, out / name)
        write_checksums(folder / name)
        checksums[name] = clip_checksum(folder / name)
        lines.append(line)
    write_manifest(folder, lines)
    end_data_set(folder, (), checksums)
    return counted(len(lines), "clip")


def _move_images(source: Path, folder: Path, final: Path) -> None:
    """Have the clip in a folder, which will be at `final`, refer to the images that it referred to at its source."""
    meta = read_json(source / "clip.json")
    images = meta["images"]
    if images and not (source / images["folder"]).resolve().is_relative_to(source.resolve()):
        images["folder"] = os.path.relpath((source / images["folder"]).resolve(), final.resolve())
        write_atomic(folder / "clip.json", json.dumps(meta, indent=1))


def _join_scores(parts: list[tuple[Path, Part]], folder: Path, out: Path, clips: str | None) -> str:
    total = sum(part.stop - part.first for _, part in parts)
    scores = join_scores([read_scores(path) for path, _ in parts], total)
    write_atomic(folder / "scores.json", json_text(scores))
    return f"scores.json of {total} clips"


def _join_stress(parts: list[tuple[Path, Part]], folder: Path, out: Path, clips: str | None) -> str:
    write_result(join_stress(parts, folder, clips), folder)
    return f"stress.json and stress.html of {sum(part.stop - part.first for _, part in parts)} clips"


_JOIN = {"dmae capture": _join_captured, "dmae evaluate": _join_scores, "dmae stress": _join_stress}


def _link(source: str, target: str) -> None:
    try:
        os.link(source, target)
    except OSError:
        # The folder is on another file system, or the file system has no links.
        shutil.copy2(source, target)
