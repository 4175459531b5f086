"""Poses as a NumPy archive: read again, and refused where its arrays do not fit together."""

import numpy as np
import pytest

from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25, SHELF14
from dmae.formats.own import export_npz, read_npz
from tests.support.clips import walkers


def holed() -> Poses3D:
    """Every source there is."""
    poses = walkers()
    xyz, source = poses.xyz.copy(), poses.source.copy()
    xyz[2, 1, 3:6], source[2, 1, 3:6] = np.nan, Source.ABSENT
    source[3], source[4] = Source.COMPLETED, Source.DENOISED
    cov = np.where(np.isnan(xyz)[..., None], np.nan, 1e-4 * np.eye(3))
    return Poses3D(BODY25, xyz, source, cov, views=np.full(source.shape, 3))


def test_loads_without_pickle_and_says_what_it_holds(tmp_path):
    export_npz(convert(holed(), SHELF14), 25.0, tmp_path / "deep" / "pred.npz")
    with np.load(tmp_path / "deep" / "pred.npz", allow_pickle=False) as found:
        assert found["joints"].shape == (12, 2, 14, 3)
        assert found["joints"].dtype == np.float32
        assert np.array_equal(np.isnan(found["joints"]).any(-1), found["source"] == 0)
        assert found["joint_names"].tolist() == list(SHELF14.joints)
        assert str(found["skeleton"]) == "shelf14"
        assert found["fps"] == 25
        assert found["source_names"].tolist() == ["absent", "measured", "denoised", "completed"]
        assert found["source_names"][found["source"][3, 0, 0]] == "completed"
        assert found["cov"].shape == (12, 2, 14, 3, 3)
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["pred.npz"]


def test_read_after_export_is_equal(tmp_path):
    export_npz(holed(), 29.97, tmp_path / "pred.npz")
    poses, fps = read_npz(tmp_path / "pred.npz")
    assert fps == 29.97
    assert poses.skeleton == BODY25
    for name in ("xyz", "source", "cov", "views"):
        np.testing.assert_array_equal(getattr(poses, name), getattr(holed(), name))


def test_an_archive_without_covariances_is_read(tmp_path):
    path = tmp_path / "old.npz"
    export_npz(holed(), 25.0, path)
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files if name not in ("cov", "source_names")}
    np.savez(path, **arrays)
    assert np.isnan(read_npz(path)[0].cov).all()


def test_joints_and_their_names_are_enough(tmp_path):
    path, order, first = tmp_path / "mine.npz", np.random.default_rng(1).permutation(25), holed()
    np.savez(path, joints=first.xyz[:, :, order], joint_names=np.array(BODY25.joints)[order])
    poses, fps = read_npz(path)
    assert (fps, poses.skeleton) == (None, BODY25)
    np.testing.assert_array_equal(poses.xyz, first.xyz)
    np.testing.assert_array_equal(poses.measured, ~np.isnan(first.xyz[..., 0]))
    np.savez(path, joints=first.xyz[0], joint_names=np.array(BODY25.joints))
    with pytest.raises(ValueError, match=r"mine\.npz: expected shape \(F, P, 25, 3\).*found joints \(2, 25, 3\)"):
        read_npz(path)


def test_what_is_no_archive_of_poses_is_refused_by_name(tmp_path):
    path = tmp_path / "bad.npz"
    with pytest.raises(FileNotFoundError, match=r"bad\.npz: no such file"):
        read_npz(path)
    path.write_bytes(b"nonsense")
    with pytest.raises(ValueError, match=r"bad\.npz: expected an \.npz archive"):
        read_npz(path)
    np.savez(path, joints=np.zeros(3))
    with pytest.raises(ValueError, match=r"bad\.npz.*lacks \['joint_names'\]"):
        read_npz(path)
    np.save(tmp_path / "bad.npy", np.zeros(3))
    with pytest.raises(ValueError, match=r"bad\.npy: expected an \.npz archive"):
        read_npz(tmp_path / "bad.npy")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"skeleton": np.array("body52")}, "no skeleton 'body52'"),
        ({"joint_names": np.array(SHELF14.joints)}, "expected the joints of body25"),
        ({"joints": np.zeros((12, 2, 14, 3))}, "expected shape"),
        ({"source": np.zeros((12, 2, 14))}, "expected shape"),
        ({"source": np.zeros((12, 2, 25))}, "ABSENT exactly where"),
        ({"joint_names": np.array(list(BODY25.joints), object)}, "pickled Python objects, which are not read"),
    ],
)
def test_contents_that_do_not_fit_together_are_refused(tmp_path, changes, message):
    path = tmp_path / "bad.npz"
    export_npz(holed(), 25.0, path)
    with np.load(path) as archive:
        arrays = dict(archive)
    np.savez(path, **arrays | changes)
    with pytest.raises(ValueError, match=message) as caught:
        read_npz(path)
    assert "bad.npz" in str(caught.value)
