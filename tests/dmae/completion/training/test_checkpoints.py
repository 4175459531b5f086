"""Checkpoints: damage is found, the one before is used, and training continues to the same weights."""

import pytest
import torch

from dmae.completion.training.checkpoints import CheckedCheckpoints, newest_checkpoint


@pytest.fixture
def folder(tmp_path):
    for step in (5, 10):
        CheckedCheckpoints().save_checkpoint({"step": step, "x": torch.arange(9)}, tmp_path / "checkpoint.ckpt")
    return tmp_path


def flip(path, at=-200):
    data = bytearray(path.read_bytes())
    data[at] ^= 1
    path.write_bytes(data)


def test_the_newest_is_read_as_it_was_written(folder):
    read = CheckedCheckpoints().load_checkpoint(newest_checkpoint(folder))
    assert read["step"] == 10 and torch.equal(read["x"], torch.arange(9))


@pytest.mark.parametrize("at", [0, 30, 100, -1])
def test_of_a_damaged_one_the_one_before_is_used(folder, at, capsys):
    flip(folder / "checkpoint.ckpt", at)
    with pytest.raises(ValueError, match=r"checkpoint\.ckpt: does not match its checksum"):
        CheckedCheckpoints().load_checkpoint(folder / "checkpoint.ckpt")
    assert CheckedCheckpoints().load_checkpoint(newest_checkpoint(folder))["step"] == 5
    assert "training continues from checkpoint_before.ckpt" in capsys.readouterr().err


def test_where_all_are_damaged_what_to_do_is_said(folder):
    flip(folder / "checkpoint_before.ckpt")
    (folder / "checkpoint.ckpt").write_bytes((folder / "checkpoint.ckpt").read_bytes()[:100])
    with pytest.raises(ValueError, match=r"Remove checkpoint\.ckpt and checkpoint_before\.ckpt from"):
        newest_checkpoint(folder)


def test_before_the_first_there_is_none(tmp_path):
    assert newest_checkpoint(tmp_path) is None
