"""Clips with the cameras of rigs: every rig in every room, and calibrations in error that are told from the truth."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dmae.clip import Visibility
from dmae.resources import resource_folder
from dmae.store import load_clip, read_manifest
from synth.dataset import generate
from synth.generate import GenerateConfig, ImageKinds, generate_clip
from synth.mistakes import DetectorConfig
from synth.render import Quality
from synth.rigs import CameraConfig, ErrorConfig, JitterConfig, RigConfig
from synth.spec import SceneConfig
from synth.stands import RingConfig

from .test_rigs import LEFT, PRESETS, config

ARENAS = sorted(path.stem for path in resource_folder("synth", "scenes").glob("*.xml"))
SCENE = SceneConfig(persons=[1, 1], seconds=0.16, props=[0, 0])
RING = RingConfig(views=3, focal=90, size=[96, 72])
ERROR = ErrorConfig(focal=0.02, principal_point=1, distortion=0.01, rotation=0.01, translation=0.03)
ARRAYS = ("visibility", "hidden_by", "detected_person")


@pytest.mark.parametrize("arena", ARENAS)
@pytest.mark.parametrize("rig", PRESETS)
def test_every_rig_works_in_every_arena(rig, arena):
    clip = generate_clip(GenerateConfig(rig=config(rig), scene=replace(SCENE, arena=arena)), 0)
    assert clip.visibility.shape[:2] == (4, len(clip.rig))
    assert (clip.visibility == Visibility.VISIBLE).any()
    assert clip.true_rig is None


def test_labels_and_detections_are_those_of_the_true_cameras_and_the_calibration_s_error_is_told(tmp_path):
    exact = GenerateConfig(str(tmp_path / "a"), seed=3, clips=2, scene=SCENE, rig=RigConfig(ring=RING))
    off = replace(exact, out=str(tmp_path / "b"), rig=replace(exact.rig, error=ERROR))
    lines = [generate(exact), generate(off)]
    for index in range(2):
        known, told = (load_clip(Path(config.out) / f"{index:06d}") for config in (exact, off))
        assert known.true_rig is None
        np.testing.assert_array_equal(known.rig.cam_from_world, told.true_rig.cam_from_world)
        np.testing.assert_array_equal(known.rig.K, told.true_rig.K)
        assert not np.isclose(told.rig.K, told.true_rig.K).all()
        for name in ARRAYS:
            np.testing.assert_array_equal(getattr(known, name), getattr(told, name))
        np.testing.assert_array_equal(known.truth.xyz, told.truth.xyz)
        np.testing.assert_array_equal(known.detections.xy, told.detections.xy)
        assert "calibration_error" not in lines[0][index]
        found = lines[1][index]["calibration_error"]
        assert len(found) == 3
        assert all(0.05 < error < 20 for error in found)
        # What the line says is how far off the people are.
        people = told.truth.xyz[:, 0].astype(float)
        apart = told.rig.project(people)[0] - told.true_rig.project(people)[0]
        assert np.nanmax(np.linalg.norm(apart, axis=-1)) < 4 * max(found)
    assert read_manifest(off.out) == lines[1]
    errors = [load_clip(Path(off.out) / f"{index:06d}") for index in range(2)]
    shifts = [clip.rig.K[:, 0, 0] / clip.true_rig.K[:, 0, 0] for clip in errors]
    assert not np.allclose(*shifts), "drawn anew for each clip"


@pytest.mark.filterwarnings("ignore:no OpenGL")
def test_pictures_are_the_true_cameras(tmp_path):
    exact = GenerateConfig(
        str(tmp_path / "a"), clips=1, scene=SCENE, rig=RigConfig(ring=RING), images=ImageKinds.all,
        quality=Quality.draft,
    )  # fmt: skip
    off = replace(exact, out=str(tmp_path / "b"), rig=replace(exact.rig, error=ERROR))
    generate(exact), generate(off)
    known, told = (load_clip(Path(config.out) / "000000").images for config in (exact, off))
    for view in known.views:
        np.testing.assert_array_equal(list(known.read("ids", view)), list(told.read("ids", view)))


def test_jitter_is_another_in_each_clip_and_leaves_the_people_as_they_are():
    still = GenerateConfig(scene=SCENE, rig=RigConfig(ring=RING), detector=DetectorConfig())
    held = replace(still, rig=replace(still.rig, jitter=JitterConfig(0.03, 0.01)))
    clips = [[generate_clip(config, index) for index in range(2)] for config in (still, held)]
    for before, after in zip(*clips, strict=True):
        shift = np.linalg.norm(before.rig.centers - after.rig.centers, axis=1)
        assert ((shift > 0) & (shift < 0.2)).all()
        np.testing.assert_array_equal(before.truth.xyz, after.truth.xyz)
        assert after.true_rig is None
    shifts = [after.rig.centers - before.rig.centers for before, after in zip(*clips, strict=True)]
    assert not np.allclose(*shifts)


SEES_NOBODY = replace(CameraConfig(**LEFT), cam_from_world=[], position=[3.0, 0, 1], target=[9.0, 0, 1])


@pytest.mark.parametrize(
    ("rig", "complaint"),
    [
        (RigConfig(cameras=[SEES_NOBODY]), "'left'.*sees nobody"),
        (
            RigConfig(cameras=[replace(SEES_NOBODY, position=[0.618, -0.484, 0.28], target=[0.0] * 3)]),
            "'left'.*'shelf'",
        ),
        (RigConfig(cameras=[CameraConfig(**LEFT | {"dist": [-5.0, 0, 0, 0, 0]})]), "'left'.*cannot be rendered"),
        (RigConfig(cameras=[CameraConfig(**LEFT | {"K": [50, 3, 32, 0, 50, 24, 0, 0, 1]})]), "'left'.*no skew"),
        (RigConfig(path="nowhere.toml"), r"nowhere\.toml"),
    ],
)
def test_cameras_that_cannot_be_are_refused_before_anything_is_written(rig, complaint, tmp_path):
    out = tmp_path / "data"
    with pytest.raises((ValueError, FileNotFoundError), match=complaint):
        generate(GenerateConfig(str(out), clips=1, rig=rig, scene=replace(SCENE, arena="office")))
    assert not out.exists()
