"""Surfaces of people, made once and cached on disk."""

import hashlib
import os
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

from dmae.files.contents import write_atomic
from synth.people import body as bodies
from synth.people import hands
from synth.people import mesh as meshes
from synth.people import shape as shapes
from synth.people.body import Body
from synth.people.clothing import PersonLooks

_SLOTS = 512
"""Number of cached files, of half a megabyte each. Each person is assigned to one file and overwrites what is there."""
_DIGEST = hashlib.sha256().digest_size


class Surface(NamedTuple):
    """A part of the visible surface of a person.

    Attributes:
        segment: Segment that it moves with.
        material: Name of its material.
        vertices: (N, 3) m, in the segment's frame.
        faces: (T, 3) vertex indices, counter-clockwise seen from outside.
        normals: (N, 3) float32, unit; None without shading.
        uv: (N, 2) float32 texture coordinates, 1 per repeat; None without shading.
        share: (1,) share of the rotation of the segment's joint that it follows, see `mesh.Mesh`.
    """

    segment: str
    material: str
    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray | None
    uv: np.ndarray | None
    share: np.ndarray


def surfaces(body: Body, looks: PersonLooks, *, shaded: bool) -> list[Surface]:
    """Return the surfaces of a person, `synth.people.shape.parts`, from the cache if they were made before.

    The cache is the folder DMAE_CACHE, else `dmae-synth` in XDG_CACHE_HOME or `~/.cache`. There is none if DMAE_CACHE
    is empty or the folder cannot be written. If the code or the libraries changed, or a file is damaged, surfaces are
    computed again.

    Args:
        body: Proportions.
        looks: Hair, cut of the clothes, and shapes of the hands.
        shaded: Whether to add normals and texture coordinates.
    """
    cut = (looks.hair, looks.top.long, looks.bottom.long, looks.untucked, looks.hands)
    key = hashlib.sha256(repr((_made_by(), body, cut, shaded)).encode()).digest()
    return _cached(key, lambda: _make(body, looks, shaded))


def _make(body: Body, looks: PersonLooks, shaded: bool) -> list[Surface]:
    def light(values: np.ndarray) -> np.ndarray:
        return values.astype(np.float32)

    return [
        Surface(
            segment,
            material,
            mesh.vertices,
            mesh.faces.astype(np.int32),
            light(mesh.normals) if shaded else None,
            light(mesh.uv) if shaded else None,
            np.array([mesh.share]),
        )
        for segment, material, mesh in shapes.parts(body, looks)
    ]


@cache
def _made_by() -> str:
    """Return a hash of the code that makes surfaces, and the versions of its libraries."""
    source = b"".join(Path(module.__file__).read_bytes() for module in (bodies, hands, meshes, shapes))
    libraries = [f"{name} {metadata.version(name)}" for name in ("numpy", "scipy", "trimesh")]
    return " ".join([hashlib.sha256(source).hexdigest(), *libraries])


def _folder() -> Path | None:
    asked = os.environ.get("DMAE_CACHE")
    if asked is not None:
        return Path(asked) if asked else None
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dmae-synth"


def _cached(key: bytes, make: Callable[[], list[Surface]]) -> list[Surface]:
    folder = _folder()
    if folder is None:
        return make()
    path = folder / f"person{int.from_bytes(key[:8]) % _SLOTS:03d}.bin"
    try:
        return _unpack(key, path.read_bytes())
    except (OSError, ValueError, SafetensorError):
        made = make()
    data = save(
        {
            f"{number}/{surface.segment}/{surface.material}/{field}": np.ascontiguousarray(values)
            for number, surface in enumerate(made)
            for field, values in zip(Surface._fields[2:], surface[2:], strict=True)
            if values is not None
        }
    )
    # If the disk is full or read-only, the surfaces are computed again next time.
    with suppress(OSError):
        write_atomic(path, key + hashlib.sha256(data).digest() + data, lasting=False)
    return made


def _unpack(key: bytes, data: bytes) -> list[Surface]:
    """Return the surfaces in a file's bytes. Raise ValueError if they belong to another person, or are damaged."""
    digest, packed = data[len(key) : len(key) + _DIGEST], data[len(key) + _DIGEST :]
    if data[: len(key)] != key or hashlib.sha256(packed).digest() != digest:
        raise ValueError("the file holds another surface, or is damaged")
    fields: dict[int, dict] = {}
    for name, values in load(packed).items():
        number, segment, material, field = name.split("/")
        fields.setdefault(int(number), {"segment": segment, "material": material})[field] = values
    return [Surface(**{"normals": None, "uv": None} | fields[number]) for number in sorted(fields)]
