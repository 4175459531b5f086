"""Data sets of movement: read in 2D, written and read in 3D, and read by movement itself where it is installed."""

import numpy as np
import pytest
import xarray

import dmae
from dmae.data.clip import Poses3D, Source
from dmae.data.skeleton import BODY25
from dmae.formats.poses import read_poses
from dmae.formats.reading import recognise
from tests.support.animal_files import write_movement
from tests.support.animals import DOG, SKELETONS, dog_clip
from tests.support.clips import full_clip
from tests.support.recordings import same_detections


def poses_of(clip) -> Poses3D:
    """Poses of all sources, with some joints absent, and covariances."""
    xyz = clip.truth.xyz.copy()
    source = np.random.default_rng(0).choice(4, xyz.shape[:-1]).astype(np.uint8)
    xyz[source == Source.ABSENT] = np.nan
    return Poses3D(clip.truth.skeleton, xyz, source, np.where(source[..., None, None] == 1, 1e-4 * np.eye(3), np.nan))


@pytest.mark.parametrize(
    "how", [{"animals": 1}, {"animals": 2}, {"animals": 2, "keypoints": "keypoint", "individuals": "individual"}]
)
def test_detections_of_each_camera(tmp_path, how):
    clip = write_movement(tmp_path, **how)
    assert recognise(tmp_path) == "movement"
    read = dmae.read(tmp_path, skeleton=str(SKELETONS / "dog.yaml"))
    assert read.fps == clip.fps
    assert read.detections.skeleton == DOG
    same_detections(read.detections, clip.detections)


@pytest.mark.parametrize("clip", [dog_clip(6, dogs=2), full_clip(5, 2)], ids=["dogs", "people"])
def test_poses_there_and_back(tmp_path, clip):
    poses = poses_of(clip)
    dmae.export(clip, tmp_path / "poses", format="movement", poses=poses)
    read = read_poses(tmp_path / "poses.nc")
    assert read.fps == pytest.approx(clip.fps)
    first = poses.skeleton.parts[0]
    assert read.poses.skeleton == first
    np.testing.assert_array_equal(read.poses.xyz, poses.xyz[:, :, : len(first)])
    np.testing.assert_array_equal(read.poses.source, poses.source[:, :, : len(first)])


def test_what_is_written(tmp_path):
    clip = dog_clip(6)
    poses = poses_of(clip)
    dmae.export(clip, tmp_path / "poses.nc", format="movement", poses=poses)
    with xarray.open_dataset(tmp_path / "poses.nc", engine="h5netcdf") as found:
        assert found.position.dims == ("time", "space", "keypoints", "individuals")
        assert found.attrs["fps"] == clip.fps
        assert found.attrs["ds_type"] == "poses"
        np.testing.assert_allclose(found.time, np.arange(6) / clip.fps)
        nose = found.position.sel(keypoints="nose", individuals="P1", space="z")
        np.testing.assert_array_equal(nose, poses.xyz[:, 0, DOG.index("nose")[0], 2].astype(float))
        confidence = found.confidence.transpose("time", "individuals", "keypoints").values
        np.testing.assert_array_equal(confidence == 1, poses.measured)
        np.testing.assert_array_equal(confidence == 0, poses.source == Source.COMPLETED)
        known = np.isin(poses.source, Source.MEASURED)
        error = found.standard_error.transpose("time", "individuals", "keypoints").values
        np.testing.assert_allclose(error[known], 0.01, rtol=1e-5)
        assert np.isnan(error[~known]).all()


def test_movement_reads_what_is_written(tmp_path):
    filtering = pytest.importorskip("movement.filtering", reason="movement and what it needs are large: in no extra")
    from movement.kinematics import compute_velocity

    clip = dog_clip(6, dogs=2)
    poses = poses_of(clip)
    dmae.export(clip, tmp_path / "poses.nc", format="movement", poses=poses)
    with xarray.open_dataset(tmp_path / "poses.nc") as found:
        kept = filtering.filter_by_confidence(found.position, found.confidence, threshold=0.5)
        np.testing.assert_array_equal(~np.isnan(kept.values[:, 0]), poses.measured.swapaxes(1, 2))
        assert compute_velocity(found.position).shape == found.position.shape


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data.drop_vars("position"), "it lacks position"),
        (lambda data: data.assign_coords(space=["x", "z"]), "in 2D of one camera, with space x, y; found x, z"),
        (lambda data: data.rename(individuals="animals"), "expected position with the axes"),
        (lambda data: data.assign_attrs(fps=-1.0), "fps: expected frames per second"),
        (lambda data: data.assign_attrs(skeleton="{}"), "expected a skeleton with name and joints"),
    ],
)
def test_a_wrong_file_is_answered_with_its_name(tmp_path, change, message):
    write_movement(tmp_path)
    with xarray.open_dataset(tmp_path / "cam0.nc", engine="h5netcdf") as data:
        changed = change(data.load())
    changed.to_netcdf(tmp_path / "cam0.nc", engine="h5netcdf")
    with pytest.raises(ValueError, match=message) as caught:
        dmae.read(tmp_path)
    assert "cam0.nc" in str(caught.value)


def test_poses_of_one_camera_are_none_in_3d(tmp_path):
    write_movement(tmp_path)
    with pytest.raises(ValueError, match="in 3D, with space x, y, z; found x, y"):
        read_poses(tmp_path / "cam0.nc")


def test_net_cdf_3_is_named(tmp_path):
    (tmp_path / "poses.nc").write_bytes(b"CDF\x01" + bytes(40))
    with pytest.raises(ValueError, match="it is netCDF 3, save it as netCDF 4"):
        read_poses(tmp_path / "poses.nc")


def test_keypoints_of_a_known_skeleton_are_put_in_its_order(tmp_path):
    clip = full_clip(3, 2)
    dmae.export(clip, tmp_path / "poses.nc", format="movement", skeleton="body25")
    with xarray.open_dataset(tmp_path / "poses.nc", engine="h5netcdf") as data:
        turned = data.load().isel(keypoints=slice(None, None, -1))
    turned.attrs.pop("skeleton")
    turned.to_netcdf(tmp_path / "turned.nc", engine="h5netcdf")
    one, other = (read_poses(tmp_path / name).poses for name in ("poses.nc", "turned.nc"))
    assert other.skeleton == BODY25
    np.testing.assert_array_equal(one.xyz, other.xyz)


def test_texts_that_follow_themselves_end(tmp_path):
    """The HDF5 library runs for ever on a heap with an object of no size."""
    path = tmp_path / "poses.nc"
    dmae.export(dog_clip(3), path, format="movement")
    data = bytearray(path.read_bytes())
    heap = data.index(b"GCOL\x01") + 16
    data[heap : heap + 16] = bytes(16)
    path.write_bytes(data)
    with pytest.raises(ValueError, match="its texts are damaged"):
        read_poses(path)
