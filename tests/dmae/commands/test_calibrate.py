"""`dmae calibrate` writes cameras that every command reads, and the changes."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dmae.calibration.bundle_adjustment import CENTRE, Calibration, Q
from dmae.calibration.config import RefineConfig
from dmae.commands import calibrate as command
from dmae.commands import report, review
from dmae.commands.config import CalibrateCommand, ReportCommand, ReviewCommand
from dmae.data.store import save_clip, write_manifest
from dmae.formats.calibrations import read_calibration
from dmae.formats.reading import DataConfig
from tests.support.clips import full_clip


def test_the_command_writes_cameras_and_what_changed(tmp_path, capsys):
    clip = full_clip()
    xy, _ = clip.rig.project(clip.truth.xyz)
    seen = replace(clip.detections, xy=xy, score=np.where(np.isnan(xy[..., 0]), np.nan, 0.9))
    step = np.zeros((len(clip.rig), Q))
    step[1, CENTRE] = 0.04
    moved = replace(clip, rig=Calibration.of(clip.rig).changed(step).rig, detections=seen, poses=None)
    moved = replace(moved, detection_labels=None)
    save_clip(moved, tmp_path / "clip")
    config = CalibrateCommand(
        DataConfig(path=str(tmp_path / "clip")), RefineConfig(cameras=[clip.rig.names[1]], bodies=40)
    )
    command.run(config, tmp_path / "rig.toml")
    said = capsys.readouterr().out
    assert "what changed" in said
    assert "moved cm" in said and not any(each in said for each in ("focal", "k1", "late"))  # They were not asked for
    found = read_calibration(tmp_path / "rig.toml")
    assert found.names == clip.rig.names
    off = np.linalg.norm(found.centers - clip.rig.centers, axis=-1)
    assert off[1] < 0.01
    np.testing.assert_allclose(off[[0, 2, 3]], 0, atol=1e-6)
    facts = json.loads((tmp_path / "rig.json").read_text())
    assert [each["refined"] for each in facts["changes"]] == [False, True, False, False]
    assert facts["changes"][1]["moved_cm"] == pytest.approx(100 * 0.04 * 3**0.5, abs=1)
    assert np.shape(facts["covariance"]) == (4, Q, Q)


def test_the_changes_do_not_overwrite_the_calibration(tmp_path):
    save_clip(full_clip(), tmp_path / "clip")
    with pytest.raises(ValueError, match=r"rig.json: expected a file with the suffix .toml"):
        command.run(CalibrateCommand(DataConfig(path=str(tmp_path / "clip"))), tmp_path / "rig.json")


def test_files_without_a_suffix_get_that_of_their_command():
    rig, page, table = Path("runs/rig"), Path("runs/page"), Path("runs/doubts")
    assert command.written_path(CalibrateCommand(), rig) == Path("runs/rig.toml")
    assert report.written_path(ReportCommand(clip="walk"), page) == Path("runs/page.html")
    assert review.written_path(ReviewCommand(), table) == Path("runs/doubts.csv")
    with pytest.raises(ValueError, match=r"page.pdf: the report is a page, .html"):
        report.written_path(ReportCommand(clip="walk"), page.with_suffix(".pdf"))
    with pytest.raises(ValueError, match=r"doubts.html: the ranking is a table, .csv"):
        review.written_path(ReviewCommand(), table.with_suffix(".html"))


def test_a_data_set_is_refused_with_the_path_of_a_clip(tmp_path):
    save_clip(full_clip(), tmp_path / "set/a")
    write_manifest(tmp_path / "set", [{"id": "a", "status": "ok"}])
    with pytest.raises(ValueError, match=r"found a data set; name a clip of it, as data.path=.*set/a$"):
        command.run(CalibrateCommand(DataConfig(path=str(tmp_path / "set"))), tmp_path / "rig.toml")


def test_a_calibration_is_never_overwritten_by_its_correction(tmp_path):
    save_clip(full_clip(), tmp_path / "clip")
    (tmp_path / "rig.toml").write_text("the user's own")
    with pytest.raises(ValueError, match=r"expected a new file, .*for example out=.*rig_2.toml"):
        command.run(CalibrateCommand(DataConfig(path=str(tmp_path / "clip"))), tmp_path / "rig.toml")
    (tmp_path / "rig.json").touch()  # as after a correction
    data = DataConfig(path=str(tmp_path / "clip"), calibration=str(tmp_path / "rig.toml"))
    with pytest.raises(ValueError, match=r"other than data.calibration; for example out=.*rig_2.toml"):
        command.run(CalibrateCommand(data), tmp_path / "rig.toml")
    assert (tmp_path / "rig.toml").read_text() == "the user's own"
