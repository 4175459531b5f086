"""Clips with the cameras of rigs: every rig in every room, and calibrations with errors."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dmae.data.labels import Visibility
from dmae.data.resources import resource_folder
from dmae.data.store import load_clip, read_manifest
from synth.datasets.clip import GenerateConfig, generate_clip
from synth.datasets.generate import generate
from synth.detector.config import DetectorConfig
from synth.rendering.renderer import ImageQuality
from synth.rigs.placement import CameraConfig, RingConfig
from synth.rigs.rig import JitterConfig, MiscalibrationConfig, RigConfig
from synth.scene.spec import SceneConfig
from tests.support.rigs import LEFT, PRESETS, config

ARENAS = sorted(path.stem for path in resource_folder("synth", "scenes").glob("*.xml"))
SCENE = SceneConfig(persons=[1, 1], seconds=0.16, props=[0, 0])
RING = RingConfig(views=3, focal=90, size=[96, 72])
ERROR = MiscalibrationConfig(focal=0.02, principal_point=1, distortion=0.01, rotation=0.01, translation=0.03)


@pytest.mark.parametrize("arena", ARENAS)
@pytest.mark.parametrize("rig", PRESETS)
def test_every_rig_works_in_every_arena(rig, arena):
    clip = generate_clip(GenerateConfig(rig=config(rig), scene=replace(SCENE, arena=arena)), 0)
    assert clip.occlusion.visibility.shape[:2] == (4, len(clip.rig))
    assert (clip.occlusion.visibility == Visibility.VISIBLE).any()
    assert clip.true_rig is None


def test_labels_and_detections_belong_to_the_true_cameras_and_the_manifest_states_the_calibration_error(tmp_path):
    exact = GenerateConfig(str(tmp_path / "a"), seed=3, clips=2, scene=SCENE, rig=RigConfig(ring=RING))
    off = replace(exact, out=str(tmp_path / "b"), rig=replace(exact.rig, error=ERROR))
    lines = [generate(exact), generate(off)]
    for index in range(2):
        known, erroneous = (load_clip(Path(config.out) / f"{index:06d}") for config in (exact, off))
        assert known.true_rig is None
        np.testing.assert_array_equal(known.rig.cam_from_world, erroneous.true_rig.cam_from_world)
        np.testing.assert_array_equal(known.rig.K, erroneous.true_rig.K)
        assert not np.isclose(erroneous.rig.K, erroneous.true_rig.K).all()
        np.testing.assert_array_equal(known.occlusion.visibility, erroneous.occlusion.visibility)
        np.testing.assert_array_equal(known.occlusion.occluder, erroneous.occlusion.occluder)
        np.testing.assert_array_equal(known.detection_labels.person, erroneous.detection_labels.person)
        np.testing.assert_array_equal(known.truth.xyz, erroneous.truth.xyz)
        np.testing.assert_array_equal(known.detections.xy, erroneous.detections.xy)
        assert "calibration_error" not in lines[0][index]
        found = lines[1][index]["calibration_error"]
        assert len(found) == 3
        assert all(0.05 < error < 20 for error in found)
        # What the line says is how far off the people are.
        people = erroneous.truth.xyz[:, 0].astype(float)
        apart = erroneous.rig.project(people)[0] - erroneous.true_rig.project(people)[0]
        assert np.nanmax(np.linalg.norm(apart, axis=-1)) < 4 * max(found)
    assert read_manifest(off.out) == lines[1]
    errors = [load_clip(Path(off.out) / f"{index:06d}") for index in range(2)]
    shifts = [clip.rig.K[:, 0, 0] / clip.true_rig.K[:, 0, 0] for clip in errors]
    assert not np.allclose(*shifts), "drawn anew for each clip"


@pytest.mark.filterwarnings("ignore:no OpenGL")
def test_images_are_rendered_by_the_true_cameras(tmp_path):
    exact = GenerateConfig(
        str(tmp_path / "a"), clips=1, scene=SCENE, rig=RigConfig(ring=RING), images=["all"],
        quality=ImageQuality.draft,
    )  # fmt: skip
    off = replace(exact, out=str(tmp_path / "b"), rig=replace(exact.rig, error=ERROR))
    generate(exact), generate(off)
    known, erroneous = (load_clip(Path(config.out) / "000000").images for config in (exact, off))
    for view in known.views:
        np.testing.assert_array_equal(list(known.read("ids", view)), list(erroneous.read("ids", view)))


def test_jitter_differs_by_clip_and_leaves_people_unchanged():
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
        (RigConfig(cameras=[SEES_NOBODY]), "'left'.*sees no people"),
        (
            RigConfig(cameras=[replace(SEES_NOBODY, position=[0.618, -0.484, 0.28], target=[0.0] * 3)]),
            "'left'.*'shelf'",
        ),
        (RigConfig(cameras=[CameraConfig(**LEFT | {"dist": [-5.0, 0, 0, 0, 0]})]), "'left'.*cannot be rendered"),
        (RigConfig(cameras=[CameraConfig(**LEFT | {"K": [50, 3, 32, 0, 50, 24, 0, 0, 1]})]), "'left'.*no skew"),
        (RigConfig(path="nowhere.toml"), r"nowhere\.toml"),
    ],
)
def test_impossible_cameras_are_refused_before_anything_is_written(rig, complaint, tmp_path):
    out = tmp_path / "data"
    with pytest.raises((ValueError, FileNotFoundError), match=complaint):
        generate(GenerateConfig(str(out), clips=1, rig=rig, scene=replace(SCENE, arena="office")))
    assert not out.exists()
