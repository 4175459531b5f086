"""A full disk: the message names the file, and nothing of it is left."""

import errno

import pytest

from dmae.data.store import save_clip
from dmae.files.contents import write_atomic
from tests.support.clips import full_clip


def test_a_full_disk_is_an_error_with_the_name_of_the_file(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("before")

    def full(handle):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match=r"No space left on device: '.*file'") as caught:
        write_atomic(tmp_path / "file", "after")
    assert caught.value.errno == errno.ENOSPC
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"file": "before"}
    with pytest.raises(OSError, match="arrays"):
        save_clip(full_clip(frames=2), tmp_path / "clip")
    assert not list((tmp_path / "clip").iterdir())
