"""Checkpoints of training: each with its checksum, and the one before it kept."""

import hashlib
import io
import sys
from pathlib import Path
from typing import Any

import torch
from lightning.pytorch.plugins.io import TorchCheckpointIO

from dmae.completion.weights import check_finite
from dmae.files.contents import read_bytes, write_atomic

CHECKPOINT = "checkpoint.ckpt"
_BEFORE = "checkpoint_before.ckpt"
_MARK = b"dmae checkpoint "
_DIGEST = 64
"""Hexadecimal digits of a SHA-256."""


class CheckedCheckpoints(TorchCheckpointIO):
    """Write checkpoints that hold their checksum: a line with it, then what torch writes.

    The previous checkpoint is kept as well, in case the newest is damaged.
    """

    def save_checkpoint(self, checkpoint: dict[str, Any], path: str | Path, storage_options: Any = None) -> None:
        path, buffer = Path(path), io.BytesIO()
        torch.save(checkpoint, buffer)
        data = buffer.getvalue()
        if path.is_file():
            path.replace(path.with_name(_BEFORE))
        write_atomic(path, _MARK + hashlib.sha256(data).hexdigest().encode() + b"\n" + data)

    def load_checkpoint(self, path: str | Path, map_location: Any = None, weights_only: bool | None = None) -> dict:
        """Raises ValueError where the file is not as it was written."""
        content = _content(Path(path))
        try:
            state = torch.load(io.BytesIO(content), map_location=map_location, weights_only=True)
        # Torch's reader raises errors of many undocumented types. Nothing in the file is run.
        except Exception as error:
            raise ValueError(f"{path}: expected a checkpoint of dmae train, {str(error).partition('.')[0]}") from error
        tensors = state.get("state_dict", {}) if isinstance(state, dict) else None
        if not isinstance(tensors, dict) or not all(isinstance(tensor, torch.Tensor) for tensor in tensors.values()):
            raise ValueError(f"{path}: expected a checkpoint of dmae train, found no weights in it")
        check_finite(tensors, f"{path} is of no use, remove it")
        return state


def newest_checkpoint(folder: Path) -> Path | None:
    """Return the newest checkpoint that is as it was written; None where training has not come to one yet.

    Raises:
        ValueError: there are checkpoints, and all of them are damaged.
    """
    found = [folder / name for name in (CHECKPOINT, _BEFORE) if (folder / name).is_file()]
    errors = []
    for path in found:
        try:
            _content(path)
        except ValueError as error:
            errors.append(error)
            continue
        for error in errors:
            print(f"{error}; training continues from {path.name}, the one before it", file=sys.stderr)
        return path
    if errors:
        names = " and ".join(path.name for path in found)
        raise ValueError(f"{errors[0]}. Remove {names} from {folder} to train from the beginning")
    return None


def _content(path: Path) -> bytes:
    data = read_bytes(path)
    head, content = data[: len(_MARK) + _DIGEST + 1], data[len(_MARK) + _DIGEST + 1 :]
    if head != _MARK + hashlib.sha256(content).hexdigest().encode() + b"\n":
        raise ValueError(f"{path}: does not match its checksum; it is damaged, or of an earlier version of dmae")
    return content
