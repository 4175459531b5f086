"""Frozen checksums: whether the clips made here are those that others were scored on."""

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
"""The arrays that each checksum is of."""

_NEAR_M, _NEAR_SHARE = 0.02, 0.02
"""Clips are near if the middles of people lie within this distance, m, and numbers of visible and of detected joints
differ by at most this share."""


class FrozenMatch(StrEnum):
    """How the clips here agree with those that were frozen, the best first."""

    equal = "equal"
    """Byte for byte."""
    near = "near"
    """The same scenes up to how this processor rounds. Scores differ in their last digits."""
    unchecked = "unchecked"
    """No checksums are frozen."""


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
        raise ValueError(
            f"{file}: exists; stored checksums are not overwritten. Remove the file only if no scores are published yet"
        )
    versions = next(iter(clips.values())).provenance.get("versions", {})
    # A line a clip.
    lines = ",\n".join(
        f"  {json.dumps(name)}: {json.dumps({**clip_checksums(clip), 'sample': _sample(clip)})}"
        for name, clip in sorted(clips.items())
    )
    write_atomic(file, f'{{\n "versions": {json.dumps(versions)},\n "clips": {{\n{lines}\n }}\n}}\n')


def check_clip(name: str, clip: Clip, file: Path) -> FrozenMatch:
    """Compare a clip with the frozen checksums, or else with a sample of what was frozen.

    The generator's contacts amplify how a processor rounds: one without AVX2 makes joints that are millimetres off.
    That far, clips are `near`.

    Raises:
        ValueError: it is another clip; the message names the clip, what differs, and the likely reason.
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
    """Return a little of a clip, by which the same clip is known after other rounding."""
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
