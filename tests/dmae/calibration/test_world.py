"""The floor and the vertical by feet and bodies, in worlds that are tilted and off by known amounts."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import dmae
from dmae.calibration import world as world_module
from dmae.calibration.doctor import diagnose, tilt_fault
from dmae.calibration.faults import Fault
from dmae.calibration.refinement import RefineConfig, refine
from dmae.calibration.world import find_floor, place_clip, place_like, place_rig, place_world, turn_to_z, upright_world
from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.store import save_clip
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture
from tests.support.commands import run_command
from tests.support.faulty_recordings import ring
from tests.support.settled_people import KINDS
from tests.support.stepping_people import stepping_people

FPS = 25.0


def world(tilt_deg: float, height_m: float, angle: float = 0.7) -> np.ndarray:
    """new_from_old of a world that is off."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(np.radians(tilt_deg) * np.array([np.cos(angle), np.sin(angle), 0])).as_matrix()
    T[2, 3] = height_m
    return T


def people(T: np.ndarray, persons: int = 2, places: int = 6, seed: int = 0) -> Poses3D:
    truth = stepping_people(persons, places, rng=np.random.default_rng(seed))
    return Poses3D(truth.skeleton, truth.xyz @ T[:3, :3].T + T[:3, 3])


@pytest.mark.parametrize("tilt", [0.0, 2.0, 35.0, 120.0])
@pytest.mark.parametrize("height", [0.0, 0.05, -0.59])
def test_tilt_and_height_are_found_within_their_intervals(tilt, height):
    T = world(tilt, height)
    floor = find_floor(people(T), FPS)
    assert floor.tilt_interval_deg[0] - 0.01 <= tilt <= floor.tilt_interval_deg[1]
    assert abs(floor.tilt_deg - tilt) < 0.8
    # The point lies on the floor, where the floor was before the world was moved.
    on_floor = np.linalg.inv(T) @ (*floor.place, 1)
    assert abs(on_floor[2]) < 0.02
    np.testing.assert_allclose(floor.up, T[:3, 2], atol=0.015)
    assert floor.height_interval_m[0] < floor.height_m < floor.height_interval_m[1]


def test_a_world_is_not_made_level_by_people_without_ankles():
    poses = people(world(0, 0))
    poses.xyz[:, :, poses.skeleton.index("l_ankle", "r_ankle")] = np.nan
    with pytest.raises(ValueError, match="no ankle is measured, which the floor is found by"):
        place_world(ring(), poses.xyz.reshape(-1, *poses.xyz.shape[2:]), poses.skeleton, None, level=True)


@pytest.mark.parametrize("seed", range(6))
def test_a_sound_world_has_no_finding_and_planted_ones_have(seed):
    def faults(T):
        return [finding.fault for finding in tilt_fault(find_floor(people(T, seed=seed), FPS), ("a", "b"))]

    assert faults(world(2, 0, seed)) == [Fault.tilted]
    # Where z = 0 lies is nobody's fault.
    assert faults(world(0, 0, seed)) == faults(world(0, 0.05, seed)) == faults(world(0, -0.59, seed)) == []


@pytest.mark.parametrize("kind", list(KINDS)[::2] + list(KINDS)[-1:])
def test_intervals_of_the_tilt_hold_or_it_is_not_determined(kind):
    determined = held = 0
    for seed in range(4):
        T = world(seed / 2, 0, angle=seed)
        poses = KINDS[kind](np.random.default_rng(seed))
        floor = find_floor(Poses3D(poses.skeleton, poses.xyz @ T[:3, :3].T), FPS)
        if floor.tilt_deg is not None:
            determined += 1
            held += floor.tilt_interval_deg[0] <= seed / 2 <= floor.tilt_interval_deg[1]
    assert held == determined
    assert determined == 4 or "step" not in kind


def test_lean_of_people_is_not_taken_for_tilt():
    leaning = stepping_people(2, 8, rng=np.random.default_rng(3), lean_deg=8)
    assert find_floor(leaning, FPS).tilt_deg < 0.5


def test_feet_on_boxes_and_chairs_do_not_raise_the_floor():
    poses = stepping_people(3, 6, rng=np.random.default_rng(4))
    xyz = poses.xyz.copy()
    xyz[:, 0, :, 2] += 0.45
    assert abs(find_floor(replace(poses, xyz=xyz), FPS).height_m) < 0.02


def test_too_little_is_said_to_be_not_determined():
    standing = stepping_people(1, 1, rng=np.random.default_rng(5))
    floor = find_floor(standing, FPS)
    assert floor.height_m is None
    assert "not determined" in floor.describe()
    nothing = find_floor(Poses3D(standing.skeleton, np.full_like(standing.xyz, np.nan)), FPS)
    assert (nothing.up, nothing.height_m, nothing.stances) == (None, None, 0)
    assert upright_world(nothing) is None
    assert tilt_fault(nothing, ("a",)) == []
    assert find_floor(Poses3D(standing.skeleton, standing.xyz[:0]), FPS).up is None


def test_one_person_at_one_place_does_not_tell_a_tilt_however_large():
    standing = people(world(25, 0), persons=1, places=1, seed=5)
    assert find_floor(standing, FPS).tilt_deg is None
    moving = people(world(25, 0), persons=1, places=6, seed=5)
    assert find_floor(moving, FPS).tilt_deg == pytest.approx(25, abs=1)


def test_of_long_recordings_some_windows_are_looked_at(monkeypatch):
    moving, looked_at = people(world(4, 0.1)), []
    whole = find_floor(moving, FPS)
    monkeypatch.setattr(world_module, "_WINDOWS", 30)
    windows = world_module._windows
    monkeypatch.setattr(world_module, "_windows", lambda xyz, *more: looked_at.append(len(xyz)) or windows(xyz, *more))
    some = find_floor(moving, FPS)
    assert sum(looked_at) == 2 * 30 * 8 < 2 * len(moving.xyz)
    assert abs(some.tilt_deg - whole.tilt_deg) < 0.5 and abs(some.height_m - whole.height_m) < 0.02


def test_joints_that_were_completed_are_not_used():
    poses = stepping_people(2, 6, rng=np.random.default_rng(6))
    completed = replace(poses, source=np.full_like(poses.source, 3))
    assert find_floor(completed, FPS).stances == 0


def test_a_clip_is_placed_with_everything_in_it_and_its_images_stay():
    T, rig = world(4, 0.3), ring()
    truth = people(T, persons=1)
    rig = place_rig(rig, T)
    xy, _ = rig.project(truth.xyz)
    found = Detections2D(truth.skeleton, xy[:, :, :], np.where(np.isnan(xy[..., 0]), np.nan, 0.9))
    clip = Clip("off", FPS, rig, found, truth=truth)
    clip = replace(clip, poses=capture(clip, CaptureConfig()))
    level = place_clip(clip, upright_world(find_floor(clip.poses, FPS)))
    np.testing.assert_allclose(level.rig.project(level.truth.xyz)[0], xy, atol=0.01)
    assert find_floor(level.poses, FPS).tilt_deg < 0.05
    assert abs(find_floor(level.poses, FPS).height_m) < 1e-3
    np.testing.assert_allclose(np.linalg.norm(level.poses.rays[..., 1, :], axis=-1), 1, atol=1e-5)


@pytest.mark.parametrize("up", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0.3, -0.4, 0.2)])
def test_the_smallest_rotation_to_z(up):
    R = turn_to_z(np.array(up, float))
    np.testing.assert_allclose(R @ up / np.linalg.norm(up), (0, 0, 1), atol=1e-12)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1)


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
    assert [finding.fault for finding in diagnosis.findings] == [Fault.tilted]
    assert "refine.level=true" in diagnosis.findings[0].remedy
    assert diagnosis.floor.height_m < -0.5


def test_calibrate_makes_the_world_level_and_leaves_the_cameras_as_they_are(lifted):
    refined = refine(lifted, RefineConfig(extrinsics=False, level=True))
    assert not any(change.refined or change.moved_cm > 1e-6 for change in refined.changes)
    assert refined.floor.tilt_deg == pytest.approx(3, abs=0.5)
    assert refined.turned_deg == pytest.approx(refined.floor.tilt_deg, abs=0.1)
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
    assert "lifted: made level, with its floor at z = 0; before, z is tilted by" in done.stdout
    kept, level = (dmae.load(tmp_path / name) for name in ("as_it_is", "level"))
    assert kept.provenance["floor"]["levelled"] is False
    assert level.provenance["floor"]["height_m"] == pytest.approx(kept.provenance["floor"]["height_m"])
    assert tilt_fault(find_floor(level.poses, 25.0), level.rig.names) == []
    feet = level.truth.xyz[:40, :, level.truth.skeleton.index("l_heel", "r_heel"), 2]
    assert np.abs(feet - 0.018).max() < 0.04
    # Cameras and people moved together.
    np.testing.assert_allclose(level.rig.project(level.truth.xyz)[0], kept.rig.project(kept.truth.xyz)[0], atol=0.02)


@pytest.mark.slow
def test_planted_tilt_and_height_are_found_on_shelf(shelf):
    poses = dmae.capture(shelf)

    def floor(change: np.ndarray):
        return find_floor(place_clip(replace(shelf, poses=poses), change).poses, shelf.fps)

    assert tilt_fault(floor(np.eye(4)), shelf.rig.names) == []
    assert [each.fault for each in tilt_fault(floor(world(2, 0)), shelf.rig.names)] == [Fault.tilted]
    # The floor of the release is 8 cm below its z = 0.
    assert floor(world(0, 0.05)).height_m == pytest.approx(-0.03, abs=0.015)


def test_a_rig_in_another_world_sees_the_same():
    rig, points = ring(), np.random.default_rng(0).uniform(-1, 2, (5, 3))
    np.testing.assert_allclose(
        place_rig(rig, T).project(points @ T[:3, :3].T + T[:3, 3])[0], rig.project(points)[0], atol=1e-8
    )


def test_a_rig_returns_to_the_place_of_another_though_one_camera_differs():
    rig, T = ring(), np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec([0.02, -0.01, 0.03]).as_matrix(), (0.2, -0.1, 0.05)
    elsewhere = place_rig(rig, T, 1.06)
    np.testing.assert_allclose(place_like(elsewhere, rig).cam_from_world, rig.cam_from_world, atol=1e-9)
    pose = rig.cam_from_world.copy()
    pose[2, :3, 3] += 0.1
    found = place_like(elsewhere, replace(rig, cam_from_world=pose))
    assert np.linalg.norm(found.centers - rig.centers, axis=1).max() < 0.005
