"""The doctor by bodies that are no people: hands and dogs."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dmae.calibration.doctor import diagnose
from dmae.data.clip import Clip
from tests.support.animals import dog_clip, hands_clip

CLIPS = {"dogs": (lambda: dog_clip(70, dogs=2), 4.0), "hands": (lambda: hands_clip(70), 8.0)}


def turned(clip: Clip, view: int, degrees: float) -> Clip:
    world = clip.rig.cam_from_world.copy()
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    world[view] = turn @ world[view]
    return replace(clip, rig=replace(clip.rig, cam_from_world=world))


@pytest.mark.parametrize("kind", CLIPS)
def test_sound_cameras_have_no_findings_and_a_turned_one_is_named(kind):
    make, degrees = CLIPS[kind]
    clip = make()
    assert not diagnose(clip).findings
    (finding,) = diagnose(turned(clip, 1, degrees)).findings
    # Bodies as small as hands do not always tell a turned camera from one that also stands elsewhere.
    assert finding.fault.name in ("turned", "differs")
    assert finding.cameras == ("cam1",)
