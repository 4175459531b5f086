"""Arrays in files: results computed by blocks equal those computed in one piece, and a full disk is an error."""

import errno
import os
import re
from pathlib import Path

import numpy as np
import pytest

from dmae.files import mapped
from dmae.files.mapped import by_frames, column_blocks, empty, frame_blocks, in_steps


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Arrays of a kilobyte lie in files, and are computed with by hundreds of bytes."""
    monkeypatch.setattr(mapped, "LARGE", 1000)
    monkeypatch.setattr(mapped, "_BLOCK", 600)


def random_array(rng, shape=(101, 4, 3)) -> np.ndarray:
    array = empty(shape, np.float64)
    array[:] = rng.normal(size=shape)
    return array


def in_file(array: np.ndarray) -> bool:
    while isinstance(array.base, np.ndarray):
        array = array.base
    return array.base is not None


def test_large_arrays_lie_in_files_and_keep_what_is_written(rng, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    small, large = empty((10, 4), np.float32), empty((100, 4, 3), np.float32)
    assert not in_file(small) and in_file(large) and not any(tmp_path.iterdir())
    large[:] = wanted = rng.normal(size=large.shape)
    for _ in in_steps(range(2)):
        assert np.array_equal(large, wanted.astype(np.float32))
    assert np.array_equal(large, wanted.astype(np.float32))


@pytest.mark.parametrize("frames", [0, 1, 7, 100])
def test_blocks_cover_all_frames_once(frames):
    array = np.zeros((frames, 50))
    covered = [frame for part in frame_blocks(array) for frame in range(frames)[part]]
    assert covered == list(range(frames))


def test_blocks_give_what_the_whole_gives(rng):
    one, other = random_array(rng), random_array(rng)
    found = by_frames(lambda a, b: (a * b).sum(-1), one, other)
    assert found.shape == (101, 4) and np.array_equal(found, (one * other).sum(-1)) and in_file(found)


def test_paths_of_all_frames(rng):
    array, joined = random_array(rng, (101, 5, 3)), np.empty((101, 5, 3))
    parts = list(column_blocks(array))
    for columns, paths in parts:
        joined[:, columns] = paths
    assert len(parts) == 5 and np.array_equal(joined, array)


def test_a_full_disk_is_an_error_and_no_crash(monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full, raising=False)
    with pytest.raises(OSError, match="No space left on device; 8 MB are needed"):
        empty((1_000_000,), np.float64)


def resident_kb(array: np.ndarray) -> int:
    """Return the part of a mapped array that is in memory now, kB."""
    address, inside = array.__array_interface__["data"][0], False
    for line in Path("/proc/self/smaps").read_text().splitlines():
        if found := re.match(r"([0-9a-f]+)-([0-9a-f]+) ", line):
            inside = int(found[1], 16) <= address < int(found[2], 16)
        elif inside and line.startswith("Rss:"):
            return int(line.split()[1])
    raise AssertionError("not mapped")


@pytest.mark.skipif(not Path("/proc/self/smaps").exists(), reason="Linux tells which pages are in memory")
def test_mapped_arrays_leave_memory_after_each_step():
    array = empty((1 << 20,), np.uint8)
    for _ in in_steps(range(2)):
        array[:] = 1
        assert resident_kb(array) >= 1024
    assert resident_kb(array) == 0
