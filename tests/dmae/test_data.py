from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from dmae.data import DataConfig, Format, is_data_set, load
from dmae.skeleton import SHELF14
from dmae.store import save_clip, write_manifest

from .examples import full_clip

CONFIGS = Path(__file__).parents[2] / "configs" / "data"


@pytest.fixture
def data_set(tmp_path) -> Path:
    """Two clips that are ok, one that failed."""
    for name in ("a", "b"):
        save_clip(replace(full_clip(), id=name), tmp_path / name)
    write_manifest(
        tmp_path, [{"id": "a", "status": "ok"}, {"id": "b", "status": "ok"}, {"id": "c", "status": "failed"}]
    )
    return tmp_path


def test_a_data_set_is_its_clips_that_are_ok(data_set):
    config = DataConfig(path=str(data_set))
    assert [clip.id for clip in load(config)] == ["a", "b"]
    assert len(load(config)) == 2
    assert is_data_set(config)


def test_a_clip_is_itself(data_set):
    config = DataConfig(path=str(data_set / "b"))
    assert [clip.id for clip in load(config)] == ["b"]
    assert not is_data_set(config)


def test_clips_are_read_when_asked_for(data_set):
    clips = load(DataConfig(path=str(data_set)))
    (data_set / "b" / "clip.json").unlink()
    assert clips[0].id == "a"
    with pytest.raises(FileNotFoundError, match="b: expected a clip folder"):
        clips[1]


def test_cameras_restrict_the_views(data_set):
    clip = load(DataConfig(path=str(data_set), cameras=[2, 0]))[0]
    assert clip.rig.names == ("cam2", "cam0")
    np.testing.assert_array_equal(clip.detections.xy, full_clip().detections.xy[:, [2, 0]])


@pytest.mark.parametrize("cameras", [[0, 4], [-1], [], [1, 1]])
def test_cameras_that_are_not_there_are_refused_with_those_that_are(data_set, cameras):
    with pytest.raises(ValueError, match=r"data\.cameras=\[.*'a', which has 0 \(cam0\), 1 \(cam1\)"):
        load(DataConfig(path=str(data_set), cameras=cameras))[0]


def test_nothing_there_is_said(tmp_path):
    with pytest.raises(FileNotFoundError, match="expected a clip"):
        load(DataConfig(path=str(tmp_path / "nothing")))


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.stem)
def test_presets_are_configurations(path):
    values = yaml.safe_load(path.read_text())
    assert DataConfig(**values).name == Format(path.stem)


def test_every_format_has_a_preset():
    assert {path.stem for path in CONFIGS.glob("*.yaml")} == {kind.value for kind in Format}


def test_shelf(data_folder):
    config = DataConfig(Format.shelf, str(data_folder / "shelf"), [0, 1, 3])
    (clip,) = load(config)
    assert len(clip) == 301
    assert clip.rig.names == ("0", "1", "3")
    assert clip.truth.skeleton == SHELF14
    assert not is_data_set(config)
