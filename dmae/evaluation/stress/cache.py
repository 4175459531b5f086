"""A cache of results. The key is a hash of everything on which a result depends, so no result is computed twice."""

import hashlib
import json
from dataclasses import asdict, fields, is_dataclass
from functools import cache
from importlib import metadata
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip
from dmae.data.store import write_atomic
from dmae.evaluation.stress.contenders import Contender, source_hash
from dmae.evaluation.stress.plan import Cell
from dmae.reconstruction.config import CaptureConfig

_PACKAGE = Path(__file__).parents[2]
_CODE = (
    "data", "numerics", "formats/recordings", "reconstruction", "metrics", "completion", "evaluation/corruption",
    "evaluation/reference.py", "evaluation/scores.py", "evaluation/stress/cells.py",
)  # fmt: skip
"""Modules of the package on which the results depend."""
_VERSIONS = ("numpy", "scipy", "torch", "opencv-python-headless")


class Cache:
    """Scores of cells on disk, one small file for each cell; in memory if there is no folder.

    Args:
        folder: Folder of the files, created with the first result. None keeps the results in memory.
    """

    def __init__(self, folder: Path | None):
        self.folder, self._memory = folder, {}

    def get(self, key: str) -> dict | None:
        """Return the result of a key; None if there is no result or its file is damaged."""
        if key not in self._memory:
            try:
                self._memory[key] = json.loads(self._path(key).read_text()) if self.folder else None
            except (OSError, ValueError):
                self._memory[key] = None
        return self._memory[key]

    def put(self, key: str, result: dict) -> None:
        """Store a result."""
        text = json.dumps(result)
        # A result that was just computed and one that is read later are equal, bit by bit.
        self._memory[key] = json.loads(text)
        if self.folder:
            write_atomic(self._path(key), text, lasting=False)

    def _path(self, key: str) -> Path:
        return self.folder / key[:2] / f"{key}.json"


def key_of(clip_hash: str, people: CaptureConfig, cell: Cell, contender: Contender) -> str:
    """Return the key of a contender's scores in a cell of a clip: a hash of everything that they depend on.

    Args:
        clip_hash: Hash of the clip, from `hash_of_clip`.
        people: Configuration that captures the people of a clip without truth.
        cell: The corruptions.
        contender: The contender that is scored.
    """
    own = {name: source_hash(name) for name, _ in cell.levels}
    settings = [clip_hash, asdict(people), asdict(cell), own, contender.settings, code_hash()]
    return hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()


def hash_of_clip(clip: Clip) -> str:
    """Return a hash of a clip without images, poses and provenance, on which results do not depend.

    The hash includes the format of the clip's files, because the scored persons depend on it
    (`dmae.evaluation.reference.scored_actors`).
    """
    digest = hashlib.sha256(str(clip.provenance.get("format")).encode())
    for name in ("id", "fps", "rig", "true_rig", "detections", "truth"):
        _update(digest, getattr(clip, name))
    return digest.hexdigest()


def _update(digest, value) -> None:
    """Add a value of a clip to a hash. Arrays are added with their type and shape."""
    if is_dataclass(value):
        for field in fields(value):
            _update(digest, getattr(value, field.name))
    elif isinstance(value, np.ndarray):
        digest.update(f"{value.dtype}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    else:
        digest.update(f"{value!r};".encode())


@cache
def code_hash() -> str:
    """Return a hash of the code that results depend on, and of the versions of the libraries that it uses."""
    digest = hashlib.sha256(json.dumps({name: metadata.version(name) for name in _VERSIONS}).encode())
    for part in _CODE:
        path = _PACKAGE / part
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            digest.update(file.relative_to(_PACKAGE).as_posix().encode() + file.read_bytes())
    return digest.hexdigest()
