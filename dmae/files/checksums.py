"""Checksums of clips and data sets: they show damaged, missing, foreign and exchanged files of any content."""

import hashlib
import json
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from fnmatch import fnmatch
from pathlib import Path
from typing import NamedTuple

from filelock import FileLock

from dmae.data.store import CHECKSUMS, MANIFEST, clip_folders, read_manifest, write_manifest
from dmae.files.contents import write_atomic
from dmae.files.structured import read_json

FORMAT = 1
RECORD = "config.yaml"
"""The options that a command ran with, written to its output. The file begins with its own checksum."""
_BESIDE = (
    RECORD, ".*.lock", "*.config.yaml", "verify.json", "splits.json", "leaks.json", "statistics", "errors", "realism",
    "report*.html", "decisions.json", "*_review.csv",
)  # fmt: skip
"""Files that commands write about a clip or data set into its folder. They are not part of it."""
_FOREIGN = "a file that does not belong to the clip", "does not belong to the data set"
_OWN = "# sha256 of what follows: "
_SHOWN = 3  # Largest number of damaged files in a message


class Checksum(NamedTuple):
    """Size of a file, bytes, and its SHA-256."""

    bytes: int
    sha256: str


def checksum(path: Path) -> Checksum:
    """Return the checksum of a file, which is read in pieces."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return Checksum(path.stat().st_size, digest)


def write_checksums(folder: Path, files: dict[str, Checksum] | None = None) -> None:
    """Write `checksums.json` of a folder: the given ones by path, or those of all its files."""
    folder = Path(folder)
    if files is None:
        files = {name: checksum(folder / name) for name in _names(folder)}
    write_atomic(folder / CHECKSUMS, _text(files))


def read_checksums(folder: Path) -> dict[str, Checksum] | None:
    """Read `checksums.json` of a folder; None if there is none, ValueError if malformed."""
    path = Path(folder) / CHECKSUMS
    if not path.is_file():
        return None
    found = read_json(path)
    try:
        files = {name: Checksum(**entry) for name, entry in found["files"].items()}
        same = _text(files).encode() == path.read_bytes()
    except (KeyError, TypeError, AttributeError):
        same = False
    if not same:
        raise ValueError(f"{path}: expected checksums as they were written; the file was changed or damaged")
    return files


def number_of(folder: Path) -> str | None:
    """Return one number for a clip or data set: the SHA-256 of its `checksums.json`; None if there is none."""
    found = clip_checksum(folder)
    return found and found.sha256


def begin_data_set(path: Path) -> dict[str, Checksum | None]:
    """Return the checksums of the clips of a data set, by name, and remove them until `seal`, as it is written to."""
    with _locked(path):
        return _take_checksums(path)


def seal(path: Path, made: Iterable[dict], own: Iterable[str], before: dict[str, Checksum | None]) -> None:
    """Write the manifest and `checksums.json` of a data set, with the clips that other commands have noted meanwhile.

    Args:
        made: Manifest lines of the clips that were made or kept; they replace earlier ones.
        own: Files of the data set besides its manifest, where they exist.
        before: Checksums from `begin_data_set`, which the clips that others made keep.
    """
    path, made = Path(path), list(made)
    with _locked(path):
        lines = {line["id"]: line for line in read_manifest(path)} if (path / MANIFEST).is_file() else {}
        lines |= {line["id"]: line for line in made}
        write_manifest(path, list(lines.values()))
        clips = before | _take_checksums(path) | {line["id"]: clip_checksum(path / line["id"]) for line in made}
        files = {name: checksum(path / name) for name in (MANIFEST, *own) if (path / name).is_file()}
        write_checksums(path, files | {f"{name}/{CHECKSUMS}": entry for name, entry in clips.items() if entry})


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Keep other commands, which may be filling the same folder, from its manifest and checksums."""
    with FileLock(Path(path) / ".manifest.lock") as lock:
        try:
            yield
        finally:
            Path(lock.lock_file).unlink(missing_ok=True)


def _take_checksums(path: Path) -> dict[str, Checksum | None]:
    try:
        files = read_checksums(path) or {}
    except ValueError:
        files = {}
    (Path(path) / CHECKSUMS).unlink(missing_ok=True)
    return {clip: entry for name, entry in files.items() if (clip := _clip(name))}


def clip_checksum(folder: Path) -> Checksum | None:
    """Return the checksum of the `checksums.json` of a clip; None if there is none."""
    path = Path(folder) / CHECKSUMS
    return checksum(path) if path.is_file() else None


def with_own_checksum(text: str) -> str:
    """Return a text after a first line with its SHA-256, a YAML comment."""
    return f"{_OWN}{hashlib.sha256(text.encode()).hexdigest()}\n{text}"


def _keeps_own_checksum(path: Path) -> bool:
    first, _, rest = path.read_bytes().partition(b"\n")
    return first == f"{_OWN}{hashlib.sha256(rest).hexdigest()}".encode()


def find_damage(folder: Path, *, fast: bool = False) -> list[str]:
    """Return descriptions of missing, foreign and changed files of a clip; none if it has no checksums.

    `fast` compares sizes, and contents only of JSON files.
    """
    try:
        files = read_checksums(folder)
    except ValueError as error:
        return [str(error)]
    if files is None:
        return []
    there = set(_names(folder))
    return [
        *(f"{name}: missing" for name in sorted(files.keys() - there)),
        *(f"{name}: {_FOREIGN[0]}" for name in sorted(there - files.keys())),
        *_changed(folder, files, there, fast),
    ]


def find_data_set_damage(path: Path, clips: Collection[str]) -> list[tuple[str | None, str]]:
    """Compare the own files of a data set, and the places of its complete clips, by name, with its checksums.

    Returns pairs of the name of a clip, or None for the data set, and a description; none without checksums.
    """
    path = Path(path)
    try:
        files = read_checksums(path)
    except ValueError as error:
        return [(None, str(error))]
    if files is None:
        sealed = [name for name in clips if (path / name / CHECKSUMS).is_file()]
        if not sealed:
            return []
        return [(None, f"{CHECKSUMS}: missing, and clip {sealed[0]} has one; was its command interrupted?")]
    problems: list[tuple[str | None, str]] = []
    there = {name for name in files if (path / name).is_file()}
    for name in sorted(files.keys() - there):
        clip = _clip(name)
        lost = f"{name}: missing" if clip is None or (path / clip).is_dir() else "the folder of the clip is missing"
        problems.append((clip, lost))
    problems += [(_clip(what.partition(":")[0]), what) for what in _changed(path, files, there, fast=False)]
    if (path / RECORD).is_file() and not _keeps_own_checksum(path / RECORD):
        problems.append((None, f"{RECORD}: its content was changed or damaged"))
    known = {CHECKSUMS, *(name.partition("/")[0] for name in files), *clips}
    for other in sorted(path.iterdir()):
        if other.name not in known and not _is_beside(other.name):
            problems.append((None, f"{other.name}: {_FOREIGN[1]}"))
    listed = {_clip(name) for name in files}
    for name in sorted(set(clips) - listed):
        if (path / name / CHECKSUMS).is_file():
            problems.append((name, f"{name}: a clip that is not in {CHECKSUMS} of the data set"))
    return problems


def refuse_damaged(path: Path, instead: str | None) -> None:
    """Raise ValueError if files of a data set or clip are missing, foreign, of another size, or exchanged.

    Sizes are compared, and the contents of JSON files, if there are checksums. The message names the option `instead`
    that skips this check, if there is one.
    """
    path = Path(path)
    if (path / "clip.json").is_file():
        found: list[tuple[str | None, str]] = [(None, what) for what in find_damage(path, fast=True)]
    elif not (path / MANIFEST).is_file():
        return
    else:
        folders = clip_folders(path)
        found = find_data_set_damage(path, [folder.name for folder in folders])
        found += [(folder.name, what) for folder in folders for what in find_damage(folder, fast=True)]
    if found:
        shown = "; ".join(f"{clip}: {what}" if clip else what for clip, what in found[:_SHOWN])
        advice = f", or use them as they are by {instead}" if instead else ""
        if all(what.endswith(_FOREIGN) for _, what in found):
            raise ValueError(
                f"{path}: {shown}. `synth verify data={path}` lists all such files; move them elsewhere{advice}"
            )
        files = "1 file is not as it was" if len(found) == 1 else f"{len(found)} files are not as they were"
        raise ValueError(
            f"{path}: {files} written: {shown}. `synth verify data={path}` lists all; make the clips again{advice}"
        )


def _changed(folder: Path, files: dict[str, Checksum], there: set[str], fast: bool) -> list[str]:
    """Return descriptions of existing files that differ from their checksums."""
    owner = {entry.sha256: name for name, entry in files.items()}
    differences = (
        (name, _difference(folder / name, files[name], owner, fast)) for name in sorted(files.keys() & there)
    )
    return [f"{name}: {what}" for name, what in differences if what]


def _difference(path: Path, expected: Checksum, owner: dict[str, str], fast: bool) -> str | None:
    """Return a description of the difference between a file and its checksum; None if they agree."""
    if not path.is_file():
        return "expected a file"
    try:
        size = path.stat().st_size
        if size != expected.bytes:
            return f"expected {expected.bytes} bytes, found {size}"
        found = expected.sha256 if fast and path.suffix != ".json" else checksum(path).sha256
    except OSError as error:
        return f"cannot be read: {error.strerror}"
    if found == expected.sha256:
        return None
    return f"it holds {owner[found]}" if found in owner else "its content was changed or damaged"


def _names(folder: Path) -> list[str]:
    """Return the paths of the files in a clip's folder, relative to it."""
    return [
        path.relative_to(folder).as_posix()
        for path in sorted(folder.rglob("*"))
        if not path.is_dir() and path != folder / CHECKSUMS and not _is_beside(path.relative_to(folder).parts[0])
    ]


def _is_beside(name: str) -> bool:
    return any(fnmatch(name, pattern) for pattern in _BESIDE)


def _clip(name: str) -> str | None:
    """Return the clip that a file of a data set belongs to; None for a file of its own."""
    clip, slash, _ = name.partition("/")
    return clip if slash else None


def _text(files: dict[str, Checksum]) -> str:
    """Return the content of `checksums.json`, with a checksum of itself."""
    entries = {name: files[name]._asdict() for name in sorted(files)}
    digest = hashlib.sha256(json.dumps(entries).encode()).hexdigest()
    return json.dumps({"format": FORMAT, "files": entries, "sha256_of_files": digest}, indent=1)
