from itertools import product

import numpy as np
import pytest

from dmae.formats.calibrations.conventions import METRES, Convention, LengthUnit, UpDirection
from tests.support.clips import looking_at_origin, walkers

ALL = [Convention(*values) for values in product(LengthUnit, UpDirection, (False, True))]


@pytest.mark.parametrize("convention", ALL, ids=str)
def test_there_and_back(convention):
    rig, xyz = looking_at_origin(), walkers().xyz
    written = convention.written_rig(rig)
    np.testing.assert_allclose(convention.rig(written).cam_from_world, rig.cam_from_world, atol=1e-12)
    np.testing.assert_allclose(convention.points(convention.written_points(xyz)), xyz, atol=1e-6)


@pytest.mark.parametrize("convention", [c for c in ALL if not c.inverse], ids=str)
def test_a_whole_file_in_another_convention_sees_the_same(convention):
    """Cameras and points written alike project alike, whatever the world is called."""
    rig, xyz = looking_at_origin(), walkers().xyz
    xy, depth = rig.project(xyz)
    in_file, far = convention.written_rig(rig).project(convention.written_points(xyz))
    np.testing.assert_allclose(in_file, xy, atol=1e-6)
    np.testing.assert_allclose(far * METRES[convention.unit], depth, atol=1e-6)


@pytest.mark.parametrize(
    ("up", "top"),
    [
        (UpDirection.x, (1, 0, 0)),
        (UpDirection.y, (0, 1, 0)),
        (UpDirection.z, (0, 0, 1)),
        (UpDirection.minus_y, (0, -1, 0)),
        (UpDirection.minus_z, (0, 0, -1)),
    ],
)
def test_up_becomes_z(up, top):
    np.testing.assert_array_equal(Convention(up=up).points(np.array(top)), (0, 0, 1))


def test_inverse_extrinsics_are_turned_round():
    rig = looking_at_origin()
    written = Convention(inverse=True).written_rig(rig)
    np.testing.assert_allclose(written.cam_from_world[:, :3, 3], rig.centers, atol=1e-12)
