"""A rig that is tilted and lifted: found by the doctor, corrected by calibrate and by capture."""

from dataclasses import replace

import numpy as np
import pytest

import dmae
from dmae.calibration.doctor import diagnose
from dmae.calibration.faults import Fault
from dmae.calibration.findings import floor_faults
from dmae.calibration.refinement import RefineConfig, refine
from dmae.calibration.world import FLOOR_KEY, find_floor, place_clip, place_rig
from dmae.data.clip import Clip, Detections2D
from dmae.data.store import save_clip
from tests.dmae.calibration.world.test_floor import world
from tests.support.commands import run_command
from tests.support.faulty_recordings import ring
from tests.support.stepping_people import stepping_people

T = world(3, -0.59)


@pytest.fixture(scope="module")
def lifted() -> Clip:
    """A sound recording in a world that is off."""
    rng, rig = np.random.default_rng(2), ring()
    truth = stepping_people(2, 5, rng=rng)
    xy = rig.project(truth.xyz)[0]
    xy = np.where(rig.inside(xy)[..., None], xy + rng.normal(0, 1, xy.shape), np.nan)
    found = Detections2D(truth.skeleton, xy, np.where(np.isnan(xy[..., 0]), np.nan, 0.9))
    return place_clip(Clip("lifted", 25.0, rig, found, truth=truth), T)


@pytest.mark.slow
def test_the_doctor_names_it_and_no_camera(lifted):
    diagnosis = diagnose(lifted, max_offset=2)
    assert [finding.fault for finding in diagnosis.findings] == [Fault.tilted, Fault.floor]
    assert "refine.level=true" in diagnosis.findings[0].remedy
    assert diagnosis.floor.height_m < -0.5
    expected = replace(lifted, provenance={FLOOR_KEY: diagnosis.floor.height_m})
    assert [finding.fault for finding in diagnose(expected, max_offset=2).findings] == [Fault.tilted]


def test_calibrate_makes_the_world_level_and_leaves_the_cameras_as_they_are(lifted):
    refined = refine(lifted, RefineConfig(extrinsics=False, level=True))
    assert not any(change.refined or change.moved_cm > 1e-6 for change in refined.changes)
    assert refined.floor.tilt_deg == pytest.approx(3, abs=0.5)
    sound = ring()
    np.testing.assert_allclose(refined.rig.centers[:, 2], sound.centers[:, 2], atol=0.08)
    between = [np.linalg.norm(rig.centers[1:] - rig.centers[0], axis=-1) for rig in (refined.rig, sound)]
    np.testing.assert_allclose(*between, atol=1e-6)
    assert find_floor(dmae.capture(replace(lifted, rig=refined.rig)), 25.0).tilt_deg < 0.1
    with pytest.raises(ValueError, match="nothing to refine"):
        RefineConfig(extrinsics=False)


def test_capture_says_it_and_levels_on_request(lifted, tmp_path):
    save_clip(lifted, tmp_path / "rec")
    done = run_command(tmp_path, "dmae", "capture", "data=rec", "out=as_it_is")
    assert done.returncode == 0, done.stderr
    assert "lifted: z is tilted by 3." in done.stdout or "lifted: z is tilted by 2." in done.stdout
    done = run_command(tmp_path, "dmae", "capture", "data=rec", "level=true", "out=level")
    assert "lifted: made level; before, z is tilted by" in done.stdout
    kept, level = (dmae.load(tmp_path / name) for name in ("as_it_is", "level"))
    assert kept.provenance["floor"]["levelled"] is False
    assert level.provenance["floor"]["height_m"] == pytest.approx(kept.provenance["floor"]["height_m"])
    assert floor_faults(find_floor(level.poses, 25.0), 0.0, level.rig.names) == []
    feet = level.truth.xyz[:40, :, level.truth.skeleton.index("l_heel", "r_heel"), 2]
    assert np.abs(feet - 0.018).max() < 0.04
    # Cameras and people moved together.
    np.testing.assert_allclose(level.rig.project(level.truth.xyz)[0], kept.rig.project(kept.truth.xyz)[0], atol=0.02)


@pytest.mark.slow
def test_planted_tilt_and_height_are_found_on_shelf_as_is_and_moved(shelf):
    clip = shelf
    poses, usual = dmae.capture(clip), clip.provenance[FLOOR_KEY]

    def faults(change: np.ndarray) -> set[Fault]:
        moved = place_clip(replace(clip, poses=poses), change)
        return {each.fault for each in floor_faults(find_floor(moved.poses, clip.fps), usual, clip.rig.names)}

    assert faults(np.eye(4)) == set()
    assert Fault.tilted in faults(world(2, 0))
    assert faults(world(0, 0.05)) == faults(world(0, -0.05)) == {Fault.floor}


def test_a_rig_in_another_world_sees_the_same():
    rig, points = ring(), np.random.default_rng(0).uniform(-1, 2, (5, 3))
    np.testing.assert_allclose(
        place_rig(rig, T).project(points @ T[:3, :3].T + T[:3, 3])[0], rig.project(points)[0], atol=1e-8
    )
