"""Physical labels in the folder of a clip: contacts, support forces of people, and points on their surfaces."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from dmae.data.typed import check_arguments
from dmae.files.checks import check_numbers
from dmae.files.contents import write_atomic
from dmae.files.structured import parse_json
from synth.labels.forces import BodyForces, PeopleContacts
from synth.labels.surfaces import SurfaceLabels

FORMAT = 2
FILE = "physics.safetensors"
"""Name of the file with the labels, in the folder of a clip."""
KINDS = ("contacts", "forces", "surface")
_TYPES = {"contacts": PeopleContacts, "forces": BodyForces, "surface": SurfaceLabels}
_TEXTS = ("names",)
_MOST = 1e8
"""Greatest valid number in a label: m, m/s, N, N m or a count."""


@dataclass(frozen=True)
class PhysicalLabels:
    """Physical labels of a clip; None for kinds that were not requested."""

    contacts: PeopleContacts | None = None  # Contacts of people, with forces and overlaps
    forces: BodyForces | None = None  # Forces that support people
    # 512 points on each person, their visibility in each camera, and what they touch
    surface: SurfaceLabels | None = None

    @property
    def kinds(self) -> tuple[str, ...]:
        """The members of `KINDS` that are present."""
        return tuple(kind for kind in KINDS if getattr(self, kind) is not None)


def check_kinds(kinds: Sequence[str]) -> tuple[str, ...]:
    """Return kinds of labels in the order of `KINDS`. Raises ValueError if a kind is unknown, or there is none."""
    if not kinds or set(kinds) - set(KINDS):
        raise ValueError(f"labels: expected a list of {', '.join(KINDS)}; found {list(kinds)}")
    return tuple(kind for kind in KINDS if kind in kinds)


def save_physical_labels(labels: PhysicalLabels, folder: Path) -> None:
    """Write labels into the folder of their clip. The file is complete or does not appear."""
    arrays, words = {}, {"format": FORMAT, "kinds": labels.kinds}
    for kind in labels.kinds:
        for field in fields(_TYPES[kind]):
            value, key = getattr(getattr(labels, kind), field.name), f"{kind}.{field.name}"
            if field.name in _TEXTS:
                words[key] = value
            else:
                arrays[key] = np.ascontiguousarray(value)
    # Only one metadata entry, because safetensors writes several entries in arbitrary order.
    write_atomic(Path(folder) / FILE, save(arrays, {"physics": json.dumps(words)}))


@check_arguments
def physical_labels(clip: str | Path) -> PhysicalLabels:
    """Read the labels that `label` added to a clip: `contacts`, `forces`, `surface`. Missing ones are None.

    Args:
        clip: Folder of the clip.

    Raises:
        FileNotFoundError: the clip has no such labels.
        ValueError: the file is malformed, or of another format version.

    Examples:
        >>> for clip in synth.generate(clips=1, seconds=0.2, persons=[1, 1], out="walks"): pass
        >>> synth.label("walks", ["surface"])
        1
        >>> points = synth.physical_labels("walks/000000").surface
        >>> points.names[0], points.xyz.shape
        ('pelvis.1.front', (5, 1, 512, 3))
    """
    path = Path(clip) / FILE
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file; `synth label data={clip}` makes it from the state of bodies")
    try:
        with safe_open(path, "np") as file:
            words = parse_json((file.metadata() or {}).get("physics", "{}"))
            if not isinstance(words, dict) or words.get("format") != FORMAT:
                raise ValueError(f"expected physical labels of format {FORMAT}")
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        parts: dict = {kind: _part(kind, arrays, words) for kind in check_kinds(words["kinds"])}
        return PhysicalLabels(**parts)
    except (SafetensorError, ValueError, KeyError, TypeError, IndexError) as error:
        raise ValueError(f"{path}: {error}") from None


def _part(kind: str, arrays: dict[str, np.ndarray], words: dict) -> object:
    """Return one kind of labels after a check that the shapes of its arrays agree."""
    values = {}
    for field in fields(_TYPES[kind]):
        key = f"{kind}.{field.name}"
        values[field.name] = tuple(words[key]) if field.name in _TEXTS else arrays[key]
        if field.name not in _TEXTS:
            check_numbers(key, arrays[key], _MOST)
    return _TYPES[kind](**values)
