"""Placed cameras: in a ring, on a dome, at random with coverage."""

import numpy as np
import pytest

from synth.errors import FailedSimulation
from synth.rigs.config import CameraPlacement, DomeConfig, JitterConfig, Lens, RandomConfig, RigConfig, RingConfig
from synth.rigs.coverage import Stage, find_faults
from synth.rigs.rig import make_rig
from synth.rooms.room import arena_file
from tests.support.rigs import points_in_area

CROWDED = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="9 9 .1"/>
  <geom name="block" type="box" pos="3.9 0 1.5" size=".4 5 1.6"/>
  <geom name="wall" type="box" pos="0 3.8 1.5" size="5 .05 1.6"/>
</worldbody></mujoco>"""


def test_a_ring_is_upright_looks_at_the_middle_and_depends_on_its_seed_only():
    config = RigConfig(ring=RingConfig(views=6, radius=[3, 5], height=[1, 3], target_height=1.1))
    rig, again, other = (make_rig(config, rng=np.random.default_rng(seed)) for seed in (4, 4, 5))
    np.testing.assert_array_equal(rig.cam_from_world, again.cam_from_world)
    assert not np.allclose(rig.cam_from_world, other.cam_from_world)
    assert ((rig.centers[:, 2] >= 1) & (rig.centers[:, 2] <= 3)).all()
    radius = np.hypot(*rig.centers[:, :2].T)
    assert ((radius >= 3) & (radius <= 5)).all()
    xy, _ = rig.project(np.array([[[0, 0, 1.1], [0, 0, 1.5]]]))
    np.testing.assert_allclose(xy[0, :, 0], (rig.size - 1) / 2, atol=1e-6)
    np.testing.assert_allclose(xy[0, :, 1, 0], xy[0, :, 0, 0], atol=1e-6)
    assert (xy[0, :, 1, 1] < xy[0, :, 0, 1]).all()


def test_a_dome_covers_its_band_of_the_sphere_evenly():
    config = DomeConfig(views=400, radius=3, elevation=[0.1, 1.2], target_height=1)
    rig = make_rig(RigConfig(placement=CameraPlacement.dome, dome=config), rng=np.random.default_rng(0))
    out = rig.centers - [0, 0, 1]
    np.testing.assert_allclose(np.linalg.norm(out, axis=1), 3)
    elevation = np.arcsin(out[:, 2] / 3)
    assert 0.1 < elevation.min() < 0.12
    assert 1.15 < elevation.max() < 1.2
    apart = np.linalg.norm(out[:, None] - out, axis=-1) + 9 * np.eye(len(out))
    assert apart.min(1).max() < 2 * apart.min(1).min()


@pytest.mark.parametrize("lens", [None, *Lens])
@pytest.mark.parametrize("seed", range(4))
def test_enough_random_cameras_see_every_point_of_the_people_s_area(lens, seed):
    lenses = list(Lens) if lens is None else [lens]
    config = RigConfig(placement=CameraPlacement.random, random=RandomConfig(views=6, views_at_least=4, lenses=lenses))
    stage = Stage(1.9, arena_file("office"))
    rig = make_rig(config, rng=np.random.default_rng(seed), stage=stage)
    assert rig.inside(rig.project(points_in_area(1.9))[0]).sum(1).min() >= 4
    again = make_rig(config, rng=np.random.default_rng(seed), stage=stage)
    np.testing.assert_array_equal(rig.cam_from_world, again.cam_from_world)
    if lens is not None:
        assert (rig.fisheye == (lens is Lens.fisheye)).all()
        assert (rig.distorted == (lens is not Lens.pinhole)).all()


def test_jitter_that_breaks_the_coverage_is_refused():
    config = RigConfig(placement=CameraPlacement.random, jitter=JitterConfig(rotation=0.15))
    with pytest.raises(FailedSimulation, match=r"rig\.jitter turned cameras away"):
        make_rig(config, rng=np.random.default_rng(0))


def test_random_cameras_have_all_kinds_of_lenses():
    config = RigConfig(placement=CameraPlacement.random, random=RandomConfig(views=30))
    rig = make_rig(config, rng=np.random.default_rng(0))
    assert 4 < rig.fisheye.sum() < 16
    assert 4 < (~rig.distorted).sum() < 16
    assert np.ptp(rig.centers[:, 2]) > 1
    assert np.ptp(rig.K[:, 0, 0]) > 200


def test_an_impossible_coverage_is_refused_with_remedies():
    config = RandomConfig(views=3, views_at_least=3, focal=[1500, 2000])
    with pytest.raises(ValueError, match=r"rig\.random.*3 see every point.*Lower rig\.random\.views_at_least"):
        make_rig(RigConfig(placement=CameraPlacement.random, random=config), rng=np.random.default_rng(0))


@pytest.mark.parametrize("placement", list(CameraPlacement))
def test_cameras_keep_out_of_objects_and_in_front_of_walls(placement, tmp_path):
    path = tmp_path / "crowded.xml"
    path.write_text(CROWDED)
    config, stage = RigConfig(placement=placement), Stage(1.9, path)
    open_ground = make_rig(config, rng=np.random.default_rng(0))
    assert find_faults(open_ground, stage), "the block hides no camera"
    rig = make_rig(config, rng=np.random.default_rng(0), stage=stage)
    assert not find_faults(rig, stage)
    outside = np.abs(rig.centers - (3.9, 0, 1.5)) > (0.4, 5, 1.6)
    assert outside.any(-1).all()
    assert (rig.centers[:, 1] < 3.85).all() or (rig.centers[rig.centers[:, 1] > 3.85, 2] > 3.1).all()


def test_a_room_without_space_for_cameras_is_refused(tmp_path):
    path = tmp_path / "full.xml"
    path.write_text('<mujoco><worldbody><geom name="rock" type="sphere" size="9"/></worldbody></mujoco>')
    with pytest.raises(ValueError, match=r"rig\.random: no place.*'random0'.*inside 'rock'"):
        make_rig(RigConfig(placement=CameraPlacement.random), rng=np.random.default_rng(0), stage=Stage(1.9, path))


@pytest.mark.parametrize(
    ("kind", "change"),
    [
        (RingConfig, {"views": 0}),
        (RingConfig, {"radius": [4.0]}),
        (RingConfig, {"height": [2.0, 1.0]}),
        (RingConfig, {"focal": -1080.0}),
        (RingConfig, {"size": [0, 776]}),
        (DomeConfig, {"views": -1}),
        (DomeConfig, {"radius": 0.0}),
        (DomeConfig, {"elevation": [0.1, 2.0]}),
        (DomeConfig, {"focal": float("nan")}),
        (DomeConfig, {"size": [1280]}),
        (RandomConfig, {"views": 0}),
        (RandomConfig, {"focal": [-400.0, 800.0]}),
        (RandomConfig, {"lenses": []}),
        (RandomConfig, {"views_at_least": 7}),
        (RandomConfig, {"size": [1032, -1]}),
    ],
)
def test_invalid_numbers_of_cameras_are_refused(kind, change):
    with pytest.raises(ValueError, match=r"rig\.(ring|dome|random)\." + next(iter(change))):
        kind(**change)
