"""Surfaces of people, made once and kept on disk."""

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

from dmae.store import write_atomic
from synth import body as bodies
from synth import mesh as meshes
from synth import shape as shapes
from synth.body import Body
from synth.looks import Looks

_SLOTS = 512
"""Files that are kept, of half a megabyte each. A person has one of them, which the next one in it overwrites."""
_DIGEST = hashlib.sha256().digest_size


class Surface(NamedTuple):
    """Part of what shows of a person.

    Attributes:
        segment: Which it moves with.
        material: What it is made of.
        vertices: (N, 3) m, in the segment's frame.
        faces: (T, 3) vertex indices, counter-clockwise seen from outside.
        normals: (N, 3) float32, unit; None where light is left out.
        uv: (N, 2) float32 texture coordinates, 1 a repeat; None where light is left out.
    """

    segment: str
    material: str
    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray | None
    uv: np.ndarray | None


def surfaces(body: Body, looks: Looks, *, shaded: bool) -> list[Surface]:
    """What shows of a person: `synth.shape.parts`, from disk where they have been made before.

    They are kept in the folder DMAE_CACHE, else `dmae-synth` in XDG_CACHE_HOME or `~/.cache`; nowhere if DMAE_CACHE is
    empty or the folder cannot be written. What the code, the libraries or the disk have changed since is made anew.

    Args:
        body: Proportions.
        looks: Of which hair and the cut of clothes count.
        shaded: Whether light is to fall on them.
    """
    cut = (looks.hair, looks.top.long, looks.bottom.long, looks.untucked)
    key = hashlib.sha256(repr((_made_by(), body, cut, shaded)).encode()).digest()
    return _kept(key, lambda: _make(body, looks, shaded))


def _make(body: Body, looks: Looks, shaded: bool) -> list[Surface]:
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
        )
        for segment, material, mesh in shapes.parts(body, looks)
    ]


@cache
def _made_by() -> str:
    """The code that makes surfaces, as a hash, and the libraries that it makes them with."""
    source = b"".join(Path(module.__file__).read_bytes() for module in (bodies, meshes, shapes))
    libraries = [f"{name} {metadata.version(name)}" for name in ("numpy", "scipy", "trimesh")]
    return " ".join([hashlib.sha256(source).hexdigest(), *libraries])


def _folder() -> Path | None:
    asked = os.environ.get("DMAE_CACHE")
    if asked is not None:
        return Path(asked) if asked else None
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dmae-synth"


def _kept(key: bytes, make: Callable[[], list[Surface]]) -> list[Surface]:
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
    # A full or read-only disk is no reason to stop.
    with suppress(OSError):
        write_atomic(path, key + hashlib.sha256(data).digest() + data, lasting=False)
    return made


def _unpack(key: bytes, data: bytes) -> list[Surface]:
    """The surfaces in a file's bytes; ValueError if they are another person's, or not whole."""
    digest, packed = data[len(key) : len(key) + _DIGEST], data[len(key) + _DIGEST :]
    if data[: len(key)] != key or hashlib.sha256(packed).digest() != digest:
        raise ValueError("not what was kept under this key")
    fields: dict[int, dict] = {}
    for name, values in load(packed).items():
        number, segment, material, field = name.split("/")
        fields.setdefault(int(number), {"segment": segment, "material": material})[field] = values
    return [Surface(**{"normals": None, "uv": None} | fields[number]) for number in sorted(fields)]
