"""Safetensors files written in pieces have the bytes of the library, and are read back."""

import hashlib

import numpy as np
import pytest
from safetensors.numpy import save

from dmae.files import arrays as arrays_module
from dmae.files import mapped
from dmae.files.arrays import read_tensors, tensor_pieces


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.fixture
def arrays(rng) -> dict[str, np.ndarray]:
    """One array of each type, in no order, and some of no or odd shape."""
    made = {f"n{i}": (50 * rng.normal(size=(40 + i, 3))).astype(t) for i, t in enumerate(arrays_module._NAMES)}
    turned = {"turned": rng.normal(size=(3, 30)).T, "é": np.zeros((0, 4), np.float32), "scalar": np.array(3.0)}
    return turned | dict(reversed(made.items()))


def test_pieces_are_the_bytes_of_the_library(arrays, monkeypatch):
    whole = save({name: np.ascontiguousarray(array) for name, array in arrays.items() if array.ndim})
    monkeypatch.setattr(mapped, "_BLOCK", 100)
    pieces = list(tensor_pieces({name: array for name, array in arrays.items() if array.ndim}))
    assert len(pieces) > 50 and b"".join(pieces) == whole


@pytest.mark.parametrize("large", [False, True])
def test_files_are_read_as_they_were_written(arrays, large, tmp_path, monkeypatch):
    path, data = tmp_path / "arrays.safetensors", b"".join(tensor_pieces(arrays))
    path.write_bytes(data)
    monkeypatch.setattr(arrays_module, "LARGE", 0 if large else 1 << 30)
    found = read_tensors(path, hashlib.sha256(data).hexdigest())
    assert found.keys() == arrays.keys()
    for name, array in arrays.items():
        assert found[name].dtype == array.dtype and np.array_equal(found[name], array), name
        assert not found[name].flags.writeable or not large


@pytest.mark.parametrize("large", [False, True])
@pytest.mark.parametrize("damage", ["other", "cut", "header", "unknown type"])
def test_damaged_files_are_refused(arrays, damage, large, tmp_path, monkeypatch):
    path, data = tmp_path / "arrays.safetensors", b"".join(tensor_pieces(arrays))
    digest = hashlib.sha256(data).hexdigest()
    if damage == "other":
        data = data[:-1] + b"\2"
    elif damage == "cut":
        data, digest = data[:-8], hashlib.sha256(data[:-8]).hexdigest()
    else:
        data = data.replace(b'"shape"', b'"shapf"') if damage == "header" else data.replace(b'"F16"', b'"F8_E4M3"')
        digest = hashlib.sha256(data).hexdigest()
    path.write_bytes(data)
    monkeypatch.setattr(arrays_module, "LARGE", 0 if large else 1 << 30)
    with pytest.raises(ValueError, match=r"arrays.safetensors: (does not match|expected)"):
        read_tensors(path, digest)
