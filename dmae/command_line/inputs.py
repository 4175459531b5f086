"""What is read: refuse a path that does not exist, or that holds something else, before the modules of a command load.

They take seconds, with torch ten. A field of a configuration declares what it names by its metadata: `reads` is a kind
below, or "skeleton", the name or file of one; `words` are names that it takes instead, or a function that returns them.
Of poses, `walk.trc` may be files of several people, `walk_P1.trc` and so on.
"""

from collections.abc import Collection, Iterator
from dataclasses import fields, is_dataclass
from glob import escape
from pathlib import Path
from typing import Any

from dmae.command_line.options import Group
from dmae.command_line.spelling import similar_path
from dmae.data.typed import REQUIRED

_KINDS = {
    "path": "a file, or a folder that is not empty",
    "poses": "a file, or a folder that is not empty",
    "clips": "the folder of a clip (with clip.json), or of a data set of clips",
    "clip": "the folder of one clip (with clip.json)",
    "model": "a folder that `dmae train` wrote (with model.json)",
}


def check_inputs(configuration: Any, options: Group) -> None:
    """Check each path that a configuration of a command with these options names.

    Raises FileNotFoundError where there is none, with the most similar name; ValueError where it holds something else.
    """
    for key, kind, words, path in _inputs(configuration, ""):
        if path in words:
            continue
        if kind == "skeleton" and (Path(path).exists() or not path.endswith((".yaml", ".yml"))):
            _check_skeleton(key, path)
            continue
        if kind == "poses" and any(Path(path).parent.glob(f"{escape(Path(path).stem)}_*{Path(path).suffix}")):
            continue
        if not Path(path).exists():
            option = options.find(key)
            meaning = option.meaning.partition(". ")[0].rstrip(".") if option else ""
            similar = similar_path(path, words)
            raise FileNotFoundError(f"{key}={path}: no such file or folder{similar} Expected: {meaning}")
        if found := _instead(key, Path(path), kind):
            raise ValueError(f"{key}={path}: expected {_KINDS[kind]}, found {found}")


def _inputs(configuration: Any, prefix: str) -> Iterator[tuple[str, str, Collection[str], str]]:
    """Yield key, kind, words and path of all that is read."""
    for each in fields(configuration):
        value, key = getattr(configuration, each.name), f"{prefix}{each.name}"
        if is_dataclass(value):
            yield from _inputs(value, f"{key}.")
        elif "reads" in each.metadata:
            for path in value if isinstance(value, list) else [value]:
                if path and path != REQUIRED:
                    words = each.metadata.get("words", ())
                    yield key, each.metadata["reads"], words() if callable(words) else words, str(path)


def _check_skeleton(key: str, name: str) -> None:
    from dmae.data.skeleton import option_skeleton  # it loads NumPy, which `--help` does not need

    option_skeleton(key, name)


def _instead(key: str, path: Path, kind: str) -> str | None:
    """Return what a path holds if that is not what is expected; None if it is."""
    if path.is_dir() and not any(path.iterdir()):
        return "an empty folder"
    if kind in ("path", "poses"):
        return None
    if not path.is_dir():
        return "a file"
    if kind == "model":
        return None if (path / "model.json").is_file() else "a folder without model.json"
    if (path / "clip.json").is_file():
        return None
    data_set, clips = (path / "manifest.jsonl").is_file(), sorted(path.glob("*/clip.json"))
    if data_set and kind == "clips":
        return None
    if not clips and not data_set:
        return "a folder without clips"
    # Of what `dmae run` writes, the clip that was written last is the completed one.
    one = clips and (clips[0] if data_set else max(clips, key=lambda clip: clip.stat().st_mtime)).parent
    return f"a {'data set' if data_set else 'folder'} of clips{f'; name one, as {key}={one}' if one else ''}"
