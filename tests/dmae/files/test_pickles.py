"""Pickles are read without running them: what NumPy writes comes back, and everything else is refused."""

import io
import pickle
import struct
import time

import numpy as np
import pytest

from dmae.files.arrays import read_npy
from dmae.files.pickles import pickled_values

NUMPY = b"cnumpy\n"


def saved(path, pickled: bytes):
    """Write a `.npy` file that holds a pickle."""
    with path.open("wb") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "|O", "fortran_order": False, "shape": ()})
        file.write(pickled)
    return path


def same(found, wanted) -> bool:
    if isinstance(wanted, np.ndarray):
        if not (isinstance(found, np.ndarray) and found.dtype == wanted.dtype and found.shape == wanted.shape):
            return False
        if wanted.dtype.hasobject:
            return all(map(same, found.flat, wanted.flat))
        return np.array_equal(found, wanted, equal_nan=wanted.dtype.kind == "f")
    if isinstance(wanted, dict):
        return found.keys() == wanted.keys() and all(same(found[key], wanted[key]) for key in wanted)
    if isinstance(wanted, list | tuple):
        return type(found) is type(wanted) and len(found) == len(wanted) and all(map(same, found, wanted))
    return type(found) is type(wanted) and found == wanted


VALUES = [
    None, True, -1, 2**70, 1.5, "text", "é\u2028\n", b"bytes\x00\xff", (), [], {}, (1,), (1, 2, 3, 4),
    [[1], (2, {"a": 3})],
    np.float64(0.1), np.int32(7), np.bool_(True), list(range(3000)), {str(n): n for n in range(3000)},
    np.arange(6.0).reshape(2, 3), np.asfortranarray(np.arange(6).reshape(2, 3)), np.arange(3, dtype=">i2"),
    np.array([True, False]), np.zeros((0, 3), np.float16), np.array(1.5), np.array([[1], "a", None], object),
]  # fmt: skip


@pytest.mark.parametrize("protocol", range(5))
@pytest.mark.parametrize("value", VALUES, ids=lambda value: f"{type(value).__name__}")
def test_values_come_back_as_pickle_reads_them(value, protocol):
    data = pickle.dumps(value, protocol)
    assert same(pickled_values(data), pickle.loads(data))


def test_an_object_that_occurs_repeatedly_is_read_wherever_it_occurs():
    shared, array = {"nose": 0}, np.arange(3.0)
    found = pickled_values(pickle.dumps([{"joints": shared, "meta": array} for _ in range(1000)]))
    assert len(found) == 1000 and found[999]["joints"] == shared
    np.testing.assert_array_equal(found[999]["meta"], array)


def attack_on_dtype() -> bytes:
    """An object dtype that states it holds no objects, so that NumPy would take bytes for addresses."""
    flags_cleared = b"(I3\nS'|'\nNNNI-1\nI-1\nI0\ntb"
    kind = NUMPY + b"dtype\n(S'O8'\nI00\nI01\ntR" + flags_cleared
    empty = b"cnumpy.core.multiarray\n_reconstruct\n" + b"(" + NUMPY + b"ndarray\n(I0\ntS'b'\ntR"
    address = b"C\x08" + struct.pack("<Q", 0x4141414141414141)
    return empty + b"(I1\n(I1\nt" + kind + b"I00\n" + address + b"tb."


def doubling(steps: int) -> bytes:
    """A list of two lists, both of which are the list of two lists before."""
    return b"]" + b"".join(b"q%c(h%ch%cl" % (n, n, n) for n in range(steps)) + b"."


def global_of(module: str, name: str) -> bytes:
    return f"c{module}\n{name}\n".encode()


def key_and_none(number: int) -> bytes:
    """An entry of a dictionary, all of which have the same hash."""
    return b"\x8a\x09" + ((2**61 - 1) * number).to_bytes(9, "little") + b"N"


HARM = {
    "dtype": attack_on_dtype(),
    "system": global_of("os", "system") + b"(S'true'\ntR.",
    "dotted": b"\x80\x04\x8c\x05numpy\x8c\x0blib.npyio.s\x93.",
    "getattr": global_of("builtins", "getattr") + b".",
    "extension": b"\x80\x02\x82\x01.",
    "persistent": b"Psomething\n.",
    "instance": b"(ios\nsystem\n.",
    "new object": NUMPY + b"ndarray\n)\x81.",
    "build of a list": b"](dtb.",
    "build of a dict": b"}(I1\ntb.",
    "bare dtype": NUMPY + b"dtype\n(S'f8'\nI00\nI01\ntR.",
    "bare function": NUMPY + b"dtype\n.",
    "bare array": b"cnumpy.core.multiarray\n_reconstruct\n(" + NUMPY + b"ndarray\n(I0\ntS'b'\ntR.",
    "structured dtype": NUMPY + b"dtype\n(S'V8'\nI00\nI01\ntR.",
    "dtype of a class": NUMPY + b"dtype\n(" + NUMPY + b"ndarray\nI00\nI01\ntR.",
    "set": b"\x80\x04\x8f.",
    "list in itself": b"]q\x00h\x00a.",
    "deep lists": b"]" * 100 + b"a" * 99 + b".",
    "deep marks": b"(" * 100_000 + b".",
    "doubling lists": doubling(60),
    "nested tuples as a key": b"})" + b"".join(b"q%ch%c\x86" % (n, n) for n in range(60)) + b"Ns.",
    "far place in the memo": b"Nr\xff\xff\xff\x7f0.",
    "long empty array": pickle.dumps(np.zeros((1, 0)), 2).replace(b"K\x01K\x00", b"\x8a\x061234\x00\x00K\x00"),
    "array larger than its bytes": pickle.dumps(np.zeros(10), 2).replace(b"K\x0a\x85", b"J\xff\xff\xff\x7f\x85"),
    "text that states more bytes": b"\x80\x04\x8d" + struct.pack("<Q", 2**62) + b"a.",
    "integer that states more bytes": b"\x80\x04\x8b" + struct.pack("<i", 2**31 - 1) + b"a.",
    "keys of the same hash": b"\x80\x04}(" + b"".join(map(key_and_none, range(1, 200))) + b"u.",
    "dictionary of objects": pickle.dumps({"keypoints": np.array([[1.0, 2.0]], object)}, 2),
    "nothing": b"",
    "no end": b"]",
    "two values": b"]].",
    "pop of nothing": b"0.",
    "unknown opcode": b"\xff.",
}  # fmt: skip


@pytest.mark.parametrize("name", HARM)
def test_harm_is_refused_at_once_with_the_name_of_the_file(tmp_path, name):
    path = saved(tmp_path / "harm.npy", HARM[name])
    started = time.process_time()
    with pytest.raises(ValueError, match=r"harm\.npy: expected an array or a dictionary"):
        read_npy(path)
    assert time.process_time() - started < 2


@pytest.mark.parametrize("name", ["system", "dotted", "getattr", "dtype of a class"])
def test_what_it_asks_for_is_named(tmp_path, name):
    with pytest.raises(ValueError, match=r"it requests "):
        read_npy(saved(tmp_path / "harm.npy", HARM[name]))


def test_a_pickle_changed_anywhere_is_read_or_refused():
    value = [{"id": 1, "K": np.eye(3), "T": [1.5, np.float64(2)], "place": [[1], {}]}, np.array([[1], {}], object)] * 3
    rng = np.random.default_rng(0)
    for protocol in (0, 2, 4):
        data = pickle.dumps(value, protocol)
        for _ in range(1500):
            changed = bytearray(data)
            for place in rng.integers(len(data), size=rng.integers(1, 4)):
                changed[place] = rng.integers(256)
            try:
                pickled_values(bytes(changed))
            except ValueError as error:
                assert str(error)


def test_headers_of_arrays_are_checked_before_memory_is_taken(tmp_path):
    path = tmp_path / "large.npy"
    for shape in ((2**40,), (2**20, 2**20, 2**20), (-1,), (10**9, 0)):
        buffer = io.BytesIO()
        np.lib.format.write_array_header_1_0(buffer, {"descr": "<f8", "fortran_order": False, "shape": shape})
        path.write_bytes(buffer.getvalue() + bytes(8))
        with pytest.raises(ValueError, match=r"large\.npy: expected an array"):
            read_npy(path)
