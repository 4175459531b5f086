"""Data sets that were captured or completed have checksums: changed files are found and refused."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from dmae.commands import report, review
from dmae.commands.config import ReportCommand, ReviewCommand
from dmae.data.store import CHECKSUMS, save_clip, write_manifest
from dmae.files.checksums import refuse_damaged, seal, write_checksums
from synth.commands import config as options
from synth.commands import detector_errors, realism, split, stats
from synth.commands import verify as verify_command
from synth.datasets.verify import verify
from tests.support.commands import dmae
from tests.support.stressed_clips import strollers


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Return a folder with a captured data set and what became of it by completion."""
    folder = tmp_path_factory.mktemp("captured")
    for name in "ab":
        save_clip(strollers(frames=16, persons=1, views=3, name=name), folder / "data" / name)
    write_manifest(folder / "data", [{"id": name, "status": "ok"} for name in "ab"])
    for line in (["capture", "data=data", "out=captured"], ["complete", "clip=captured", "out=completed"]):
        done = dmae(folder, *line)
        assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(params=["captured", "completed"])
def made(request, folder, tmp_path) -> Path:
    return Path(shutil.copytree(folder / request.param, tmp_path / request.param))


def test_they_verify(made):
    found = verify(made)
    assert not found.problems
    assert found.number
    assert not found.without


def test_every_flipped_bit_is_found(made):
    rng = np.random.default_rng(0)
    files = sorted(path for path in made.rglob("*") if path.is_file())
    for _ in range(30):
        path = files[rng.integers(len(files))]
        data = path.read_bytes()
        changed = bytearray(data)
        changed[rng.integers(len(data))] ^= 1 << int(rng.integers(8))
        path.write_bytes(changed)
        assert verify(made).problems, path
        path.write_bytes(data)


@pytest.mark.parametrize("name", ["a/clip.json", "manifest.jsonl", "a", CHECKSUMS])
def test_a_missing_file_is_found_and_refused(name, made):
    path = made / name
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    if name != "manifest.jsonl":
        with pytest.raises(ValueError, match="1 file is not as it was written"):
            refuse_damaged(made, "examples.damaged=true")
    assert verify(made).problems


def test_files_that_do_not_belong_are_to_be_moved(made):
    (made / "walk.trc").touch()
    (made / "a/walk.trc").touch()
    both = "walk.trc: does not belong to the data set; a: walk.trc: a file that does not belong to the clip"
    with pytest.raises(ValueError, match=f"{both}.*; move them elsewhere, or use them as they are by x=true"):
        refuse_damaged(made, "x=true")
    (made / "a/clip.json").unlink()
    with pytest.raises(ValueError, match="3 files are not as they were written"):
        refuse_damaged(made, "x=true")


def test_no_command_writes_clips_into_a_data_set(made):
    for out in (made / "captured", made / "a/captured"):
        done = dmae(made.parent, "capture", f"data={made}/a", f"out={out}")
        assert done.returncode == 1 and f"is in the data set {made}; choose a folder beside it" in done.stderr
        assert not out.exists()
    (made / CHECKSUMS).unlink()  # As of one that is put together by hand
    done = dmae(made.parent, "convert", f"data={made}/a", f"out={made}/c")
    assert done.returncode == 0, done.stderr


def test_training_and_completion_refuse_a_changed_clip(made):
    (made / "b/clip.json").write_text((made / "b/clip.json").read_text().replace("}", " }", 1))
    for line in (["train", f"data={made}", "out=model"], ["complete", f"clip={made}", "out=more"]):
        done = dmae(made.parent, *line)
        assert done.returncode == 1
        assert "b: clip.json" in done.stderr
        assert "damaged=true" in done.stderr
    done = dmae(made.parent, "complete", f"clip={made}", "damaged=true", "out=more")
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("part", ["", "a"])
def test_what_commands_write_beside_the_clips_by_default_is_no_damage(part, tmp_path):
    data = tmp_path / "data"
    save_clip(strollers(frames=4, persons=1, views=2, name="a"), data / "a")
    write_checksums(data / "a")
    seal(data, [{"id": "a", "status": "ok"}], (), {})
    path = str(data / part)
    for place in (
        verify_command.default_out(options.VerifyCommand(path)),
        detector_errors.default_out(options.DetectorErrorsCommand(data=path)) / "errors.json",
        realism.default_out(options.RealismCommand(data=path)) / "realism.json",
        stats.default_out(options.StatsCommand(data=path)) / "statistics.json",
        split.default_out(options.SplitCommand(str(data))),
        split.default_out(options.SplitCommand(str(data), check="splits.json")),
        report.default_out(ReportCommand(clip=path)),
        review.default_out(ReviewCommand(clip=str(data / "a"))),
    ):
        place.parent.mkdir(exist_ok=True)
        place.write_text("{}")
    assert verify(data).problems == []
    refuse_damaged(data, None)
