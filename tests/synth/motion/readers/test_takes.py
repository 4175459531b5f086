"""Lists of takes, compressed takes, and takes that cannot be read."""

import gzip
import lzma
from pathlib import Path

import numpy as np
import pytest

from dmae.files.contents import read_unpacked
from synth.commands.config import SplitCommand
from synth.commands.split import run
from synth.motion.config import MotionConfig
from synth.motion.readers.takes import find_subject_leaks, find_takes, read_take_list
from synth.motion.source import load_motion, read_take
from tests.support.motion_files import amc, bvh


def packed(path: Path) -> Path:
    """Replace a file by its compressed form, as xz or gz by turns."""
    new = path.with_name(path.name + ".xz")
    new.write_bytes(lzma.compress(path.read_bytes()))
    path.unlink()
    return new


@pytest.fixture
def folder(tmp_path) -> Path:
    for name in ("60_01", "61_01", "02_01", "05_01"):
        bvh(tmp_path / f"{name}.bvh", [{"root": (n / 99, 0, 0)} for n in range(70)])
    (tmp_path / "07_01.bvh").write_text("HIERARCHY\n")
    return tmp_path


def test_compressed_takes_are_those_that_were_compressed(tmp_path):
    plain = read_take(bvh(tmp_path / "take.bvh", [{}] * 60))
    (tmp_path / "other.bvh.gz").write_bytes(gzip.compress((tmp_path / "take.bvh").read_bytes()))
    for path in (packed(tmp_path / "take.bvh"), tmp_path / "other.bvh.gz"):
        assert np.array_equal(read_take(path).root, plain.root)
    assert [path.name for path in find_takes(tmp_path, "bvh")] == ["other.bvh.gz", "take.bvh.xz"]
    path = amc(tmp_path / "99_01.amc", [{}] * 60)
    packed(path.with_name("99.asf"))
    assert len(read_take(packed(path))) == 59, "its first frame is a T-pose"


@pytest.mark.parametrize("ending", ["xz", "gz"])
def test_what_is_no_compressed_file_is_refused(tmp_path, ending):
    pack = lzma.compress if ending == "xz" else gzip.compress
    path = tmp_path / f"take.bvh.{ending}"
    path.write_bytes(pack(b"a") + pack(b"b"))
    assert read_unpacked(path, 200) == b"ab"
    path.write_bytes(pack(bytes(10**7)))
    with pytest.raises(ValueError, match="at most 1000000 bytes, found more when unpacked"):
        read_unpacked(path, 10**6)
    for wrong in (b"HIERARCHY", pack(b"a" * 999)[:-4], b"\0" * 50):
        path.write_bytes(wrong)
        with pytest.raises(ValueError, match=rf"take.bvh.{ending}: expected a (file compressed|text file)"):
            read_take(path)


def test_takes_that_cannot_be_read_are_left_out_with_a_warning(folder):
    config = MotionConfig(kind="bvh", path=str(folder))
    with pytest.warns(UserWarning, match=r"left out: .*07_01.bvh, line 1.*synth split data="):
        names = {
            load_motion(config, seconds=0.3, fps=25, rng=np.random.default_rng(seed)).name[:5] for seed in range(30)
        }
    assert names == {"60_01", "61_01", "02_01", "05_01"}
    with pytest.raises(ValueError, match=r"07_01.bvh, line 1"):
        load_motion(
            MotionConfig(kind="bvh", path=str(folder / "07_01.bvh")), seconds=1, fps=25, rng=np.random.default_rng(0)
        )
    (folder / "bad").mkdir()
    for name in ("1.bvh", "2.bvh"):
        (folder / "bad" / name).write_text("HIERARCHY\n")
    config = MotionConfig(kind="recorded", path=str(folder / "bad"))
    with (
        pytest.warns(UserWarning, match="left out"),
        pytest.raises(ValueError, match=r"none of 2 takes can be read; the last"),
    ):
        load_motion(config, seconds=1, fps=25, rng=np.random.default_rng(0))


def test_sets_of_a_list_share_no_subject_and_can_be_drawn_from(folder, capsys):
    out = folder / "takes.tsv"
    run(SplitCommand(data=str(folder), train=0.5, validation=0.5, test=0), out)
    assert "07_01.bvh, line 1" in capsys.readouterr().out
    lines = read_take_list(out)
    sets = {line.path.name[:5]: line.set for line in lines}
    assert sets["60_01"] == sets["61_01"], "partners are one subject"
    assert sets["07_01"] == "-"
    assert set(sets.values()) == {"train", "validation", "-"}
    assert find_subject_leaks(lines) == []
    drawn = find_takes(out, None, ["train"])
    assert {path.name[:5] for path in drawn} == {name for name, part in sets.items() if part == "train"}
    out.write_text(out.read_text().replace("61_01.bvh\t60+61\ttrain", "61_01.bvh\t61\tvalidation"))
    out.write_text(out.read_text().replace("60_01.bvh\t60+61\tvalidation", "60_01.bvh\t60\ttrain"))
    with pytest.raises(ValueError, match=r"1 leaks; subject 60\+61 in train: 60_01.bvh; validation: 61_01.bvh"):
        run(SplitCommand(data=str(out)), folder / "checked.tsv")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("file\tset\na.bvh\ttrain\n", "found no subject"),
        ("file\tsubject\tset\na.bvh\t1\tx\na.bvh\t1\ty\n", "line 3: a.bvh is listed twice"),
        ("file\tsubject\tset\n\t1\tx\n", "line 2: expected the name of a file"),
    ],
)
def test_malformed_lists_are_refused(tmp_path, text, message):
    (tmp_path / "takes.tsv").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_take_list(tmp_path / "takes.tsv")


def test_sets_are_asked_of_lists_alone(folder):
    with pytest.raises(ValueError, match=r"expected a list of takes \(\.tsv\)"):
        find_takes(folder, "bvh", ["train"])


def test_the_list_of_the_database_has_no_leak(data_folder):
    lines = read_take_list(data_folder / "cmu_more" / "split.tsv")
    assert len(lines) == 74
    assert find_subject_leaks(lines) == []
