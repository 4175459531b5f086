"""Arrays in files: results computed by blocks equal those computed in one piece, and a full disk is an error."""

import errno
import os

import numpy as np
import pytest

from dmae.files import mapped
from dmae.files.mapped import by_frames, column_blocks, empty, frame_blocks, release, total


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
    release(large, small, large[3:, 1])
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
    assert np.array_equal(total(lambda a: a[..., 0] > 0, one), (one[..., 0] > 0).sum(0))


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
