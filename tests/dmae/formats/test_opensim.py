"""Our joint angles beside those of OpenSim's inverse kinematics with Pose2Sim's models, where both are installed."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Clip, Poses3D
from dmae.data.skeleton import BODY25
from dmae.numerics.kinematics import ANGLES, body_motion, joint_angles
from tests.dmae.formats.test_animation import simulated
from tests.support.clips import full_clip
from tests.support.opensim_ik import opensim_angles, setup_folder

pytestmark = pytest.mark.skipif(setup_folder() is None, reason="needs the packages opensim and pose2sim")


def clip_of(poses: Poses3D) -> Clip:
    return replace(full_clip(len(poses.xyz)), truth=None, occlusion=None, detection_labels=None, poses=poses)


def test_knees_and_ankles_agree_and_all_are_nearer_to_the_truth(tmp_path):
    poses, knee = simulated(BODY25)
    (theirs,) = opensim_angles(clip_of(poses), tmp_path)
    found, _ = joint_angles(body_motion(poses, 0))
    ours = dict(zip([angle.name for angle in ANGLES], found.T, strict=True))
    for name, share, apart in (("hip_flexion", 1 / 1.4, 13), ("knee_angle", 1, 2.5), ("ankle_angle", 0.4 / 1.4, 2.5)):
        for side in "rl":
            true = share * np.degrees(knee)
            own, other = (each[f"{name}_{side}"] for each in (ours, theirs))
            assert np.abs(own - other).mean() < apart
            assert np.abs(own - true).mean() < np.abs(other - true).mean()


def test_opensim_solves_frames_with_absent_markers(tmp_path):
    poses, _ = simulated(BODY25, frames=12)
    xyz = poses.xyz.copy()
    # The last marker of the file.
    xyz[3:6, :, BODY25.index("r_heel")] = np.nan
    (theirs,) = opensim_angles(clip_of(Poses3D(BODY25, xyz)), tmp_path)
    assert len(theirs["knee_angle_r"]) == 12 and np.isfinite(theirs["ankle_angle_r"]).all()
