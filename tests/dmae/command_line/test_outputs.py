"""Where results go: one command at a time, and failed commands leave nothing behind."""

import os

import pytest

from dmae.command_line.outputs import check_out, locked


def test_two_commands_do_not_write_to_one_folder(tmp_path):
    with (
        locked(tmp_path / "set"),
        pytest.raises(ValueError, match=r"out=.*set: another command is writing there"),
        locked(tmp_path / "set"),
    ):
        pass
    with locked(tmp_path / "set"), locked(tmp_path / "other"):
        pass
    assert not list(tmp_path.iterdir())


def test_folders_are_left_where_something_was_written(tmp_path):
    with locked(tmp_path / "a/b/set"):
        (tmp_path / "a/result").touch()
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a", "result"]


def test_a_folder_that_cannot_be_written_is_named_and_not_the_lock(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(ValueError, match=r"out=.*/file/set: cannot be written: .*; choose another"):  # noqa: SIM117
        with locked(tmp_path / "file/set"):
            pass


def test_a_folder_that_is_read_only_is_refused_before_any_work(tmp_path, monkeypatch):
    check_out(tmp_path, "folder")
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # As root everything can be written
    with pytest.raises(ValueError, match=r"out=.*: cannot be written: the folder is read-only; choose another out"):
        check_out(tmp_path, "folder")
    check_out(tmp_path / "new", "folder")
