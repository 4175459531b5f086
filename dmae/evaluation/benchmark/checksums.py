"""Frozen checksums: check that the clips generated here are the clips of the published scores."""

import hashlib
import json
from enum import StrEnum
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip
from dmae.data.labels import Visibility
from dmae.data.store import write_atomic
from dmae.files.structured import read_json

_LABELS = (
    "rig.K", "rig.dist", "rig.cam_from_world", "rig.size", "truth.xyz", "occlusion.visibility", "occlusion.occluder",
)  # fmt: skip
_DETECTIONS = ("detections.xy", "detections.score", "detection_labels.person", "detection_labels.error")
PARTS = {"labels": _LABELS, "detections": _DETECTIONS}
"""The arrays that each checksum covers."""

_NEAR_M, _NEAR_SHARE = 0.02, 0.02
"""Clips are near if the centres of people differ by at most this distance, m, and the numbers of visible and of
detected joints differ by at most this share."""


class FrozenMatch(StrEnum):
    """Agreement of the clips here with the frozen ones, the best first."""

    equal = "equal"
    """Byte for byte."""
    near = "near"
    """The same scenes up to how this processor rounds. Scores differ in their last digits."""
    unchecked = "unchecked"
    """No checksums are frozen."""


def clip_checksums(clip: Clip) -> dict[str, str]:
    """Return two SHA-256 checksums of a clip: of its cameras and labels, and of its detections.

    They cover the types, shapes and bytes of the arrays. All NaN are equal, and the byte order is little-endian. Raises
    AttributeError if the clip has no labels.
    """
    return {part: _digest(clip, names) for part, names in PARTS.items()}


def freeze(clips: dict[str, Clip], file: Path) -> None:
    """Write the checksums of all clips by id, and the versions of the packages that made them.

    Raises:
        ValueError: the file exists. Frozen checksums never change; a new version of a benchmark has its own file.
    """
    if Path(file).exists():
        raise ValueError(
            f"{file}: exists; stored checksums are not overwritten. Remove the file only if no scores are published yet"
        )
    versions = next(iter(clips.values())).provenance.get("versions", {})
    # Write one line per clip.
    lines = ",\n".join(
        f"  {json.dumps(name)}: {json.dumps({**clip_checksums(clip), 'sample': _sample(clip)})}"
        for name, clip in sorted(clips.items())
    )
    write_atomic(file, f'{{\n "versions": {json.dumps(versions)},\n "clips": {{\n{lines}\n }}\n}}\n')


def check_clip(name: str, clip: Clip, file: Path) -> FrozenMatch:
    """Compare a clip with the frozen checksums and, if they differ, with the frozen sample of the clip.

    Contacts in the simulation amplify rounding differences between processors: without AVX2, joints differ by
    millimetres. Clips with such differences are `near`.

    Raises:
        ValueError: the clip is a different one; the message names the clip, the differences, and the likely reason.
    """
    frozen = read_json(file)
    if name not in frozen["clips"]:
        raise ValueError(
            f"clip {name}: has no checksum in {file}; the definition was changed after its checksums were stored"
        )
    found, expected = clip_checksums(clip), frozen["clips"][name]
    differing = [part for part in PARTS if found[part] != expected[part]]
    if not differing:
        return FrozenMatch.equal
    own = clip.provenance.get("versions", {})
    others = [
        f"{package} {version}, here {own.get(package)}"
        for package, version in frozen["versions"].items()
        if own.get(package) != version and package != "python"
    ]
    if not others and _is_near(_sample(clip), expected["sample"]):
        return FrozenMatch.near
    reason = (
        f"it was frozen with {'; '.join(others)}. Install the pinned versions: pip install -c constraints.txt"
        if others
        else "the versions are the same, so that the generator was changed since"
    )
    raise ValueError(
        f"clip {name}: its {' and '.join(differing)} are not those of the benchmark ({file.name}), so that scores "
        f"would not be comparable. Likely reason: {reason}"
    )


def _sample(clip: Clip) -> dict:
    """Return a small sample of a clip. It identifies the clip even if rounding differs."""
    frames = [0, len(clip) // 2, len(clip) - 1]
    middle = np.nanmean(clip.truth.xyz[frames].astype(np.float64), 2)
    return {
        "middle_m": np.nan_to_num(middle, nan=0.0).round(3).tolist(),
        "visible": int((clip.occlusion.visibility == Visibility.VISIBLE).sum()),
        "detected": int(clip.detections.observed.sum()),
    }


def _is_near(found: dict, frozen: dict) -> bool:
    one, other = (np.array(each["middle_m"]) for each in (found, frozen))
    if one.shape != other.shape or np.abs(one - other).max() > _NEAR_M:
        return False
    return all(abs(found[key] - frozen[key]) <= _NEAR_SHARE * frozen[key] for key in ("visible", "detected"))


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
