"""Frozen checksums: whether the clips made here are those that others were scored on."""

import hashlib
import json
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip
from dmae.data.store import read_json, write_atomic

_LABELS = (
    "rig.K", "rig.dist", "rig.cam_from_world", "rig.size", "truth.xyz", "occlusion.visibility", "occlusion.occluder",
)  # fmt: skip
_DETECTIONS = ("detections.xy", "detections.score", "detection_labels.person", "detection_labels.error")
PARTS = {"labels": _LABELS, "detections": _DETECTIONS}
"""The arrays that each checksum is of."""


def clip_checksums(clip: Clip) -> dict[str, str]:
    """Return SHA-256 of the cameras and labels of a clip, and of its detections: of types, shapes and all bytes.

    Every NaN counts as the same, and the order of bytes is little-endian. Raises AttributeError if the clip has no
    labels.
    """
    return {part: _digest(clip, names) for part, names in PARTS.items()}


def freeze(clips: dict[str, Clip], file: Path) -> None:
    """Write the checksums of all clips, by id, and the versions that they were made with.

    Raises:
        ValueError: the file exists. Frozen checksums are not changed; another version of a benchmark has its own.
    """
    if Path(file).exists():
        raise ValueError(f"{file}: exists; frozen checksums stay. Remove the file only if no scores are published yet")
    frozen = {
        "versions": next(iter(clips.values())).provenance.get("versions", {}),
        "clips": {name: clip_checksums(clip) for name, clip in sorted(clips.items())},
    }
    write_atomic(file, json.dumps(frozen, indent=1) + "\n")


def check_clip(name: str, clip: Clip, file: Path) -> None:
    """Compare a clip with the frozen checksums.

    Raises:
        ValueError: it is another clip; the message names the clip, what differs, and the likely reason.
    """
    frozen = read_json(file)
    if name not in frozen["clips"]:
        raise ValueError(f"clip {name}: has no checksum in {file}; the definition was changed after it was frozen")
    found, expected = clip_checksums(clip), frozen["clips"][name]
    differing = [part for part in PARTS if found[part] != expected[part]]
    if not differing:
        return
    own = clip.provenance.get("versions", {})
    others = [
        f"{package} {version}, here {own.get(package)}"
        for package, version in frozen["versions"].items()
        if own.get(package) != version
    ]
    reason = (
        f"it was frozen with {'; '.join(others)}. Install the pinned versions: pip install -c constraints.txt"
        if others
        else "the versions are the same, so either the generator was changed, or this processor rounds otherwise than "
        "that on which it was frozen"
    )
    raise ValueError(
        f"clip {name}: its {' and '.join(differing)} are not those of the "
        f"benchmark ({file.name}), so that scores would not be comparable. Likely reason: {reason}"
    )


def _digest(clip: Clip, names: tuple[str, ...]) -> str:
    digest = hashlib.sha256()
    for name in names:
        owner, _, field = name.partition(".")
        array = np.asarray(getattr(getattr(clip, owner), field))
        array = array.astype(array.dtype.newbyteorder("<"))
        if array.dtype.kind == "f":
            array = np.where(np.isnan(array), array.dtype.type(np.nan), array)
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
