"""The paper's dictionaries: made here as its code makes them, and made to do harm."""

import os
import pickle

import numpy as np
import pytest

from dmae.data.skeleton import BODY21, BODY25, SHELF14
from dmae.files.arrays import read_npy
from dmae.formats.reading import Clips, DataConfig
from dmae.formats.released import read_cameras
from tests.support.recordings import recording, same_detections
from tests.support.tracked_recordings import write_released


def save(path, content) -> None:
    np.save(path, content, allow_pickle=True)


@pytest.fixture
def folder(tmp_path):
    write_released(tmp_path, recording(BODY25))
    return tmp_path


def read(folder, **options):
    return Clips(DataConfig("released", str(folder), fps=25.0, **options))[0]


def test_a_recording_of_them(folder):
    clip, wanted = read(folder), recording(BODY25)
    np.testing.assert_allclose(clip.rig.projections, wanted.rig.projections, atol=1e-9)
    np.testing.assert_array_equal(clip.rig.size, wanted.rig.size)
    same_detections(clip.detections, wanted.detections, atol=1e-3)
    assert clip.provenance["first_frame"] == 300
    assert clip.truth is None


def test_people_cut_to_the_paper_s_joints(tmp_path):
    write_released(tmp_path, joints="filtered_skel")
    assert read(tmp_path).detections.skeleton == BODY21


def test_truth_stands_in_the_frames_of_the_detections(folder):
    joints = np.arange(45.0).reshape(15, 3)
    truth = np.empty((12, 4), object)
    for place in np.ndindex(truth.shape):
        truth[place] = []
    truth[7, 2] = joints
    save(folder / "shelf_3d_eval_4dassoc.npy", truth)
    found = read(folder).truth
    assert found.skeleton == SHELF14
    np.testing.assert_array_equal(found.xyz[7, 2], joints[:14])
    assert np.isnan(np.delete(found.xyz.reshape(48, -1), 7 * 4 + 2, 0)).all()
    save(folder / "shelf_3d_eval_4dassoc.npy", truth[:5])
    with pytest.raises(ValueError, match="expected 12 frames as in the detections, found 5"):
        read(folder)


class Harmful:
    def __init__(self, what, *arguments):
        self.what, self.arguments = what, arguments

    def __reduce__(self):
        return self.what, self.arguments


@pytest.mark.parametrize("hide", [lambda bad: bad, lambda bad: [{"K": bad}], lambda bad: {"img_0": {"0000": [bad]}}])
def test_a_harmful_file_does_nothing_and_is_refused_by_what_it_asks_for(tmp_path, hide):
    harm = tmp_path / "harm"
    for what, name in ((os.mkdir, "mkdir"), (os.system, "system"), (eval, "eval")):
        bad = Harmful(what, f"__import__('os').mkdir({str(harm)!r})" if what is eval else str(harm))
        if what is os.system:
            bad = Harmful(what, f"mkdir {harm}")
        save(tmp_path / "bad.npy", np.array([hide(bad)], object))
        with pytest.raises(ValueError, match=rf"bad\.npy: .*it requests .*\.{name}, which is not loaded"):
            read_npy(tmp_path / "bad.npy")
        assert not harm.exists()
    # The same file in NumPy's own hands.
    np.load(tmp_path / "bad.npy", allow_pickle=True)
    assert harm.exists()


def test_pickles_of_older_numpy_and_python_are_read(tmp_path):
    content = {"a": np.arange(3), "b": [np.float64(1.5), "text", b"bytes"]}
    for protocol in range(5):
        with (tmp_path / "old.npy").open("wb") as file:
            np.lib.format.write_array_header_1_0(file, {"descr": "|O", "fortran_order": False, "shape": ()})
            data = pickle.dumps(np.array(content, object), protocol)
            file.write(data.replace(b"numpy._core.multiarray", b"numpy.core.multiarray") if protocol < 2 else data)
        found = read_npy(tmp_path / "old.npy")
        np.testing.assert_array_equal(found["a"], [0, 1, 2])
        assert found["b"] == [1.5, "text", b"bytes"]
    np.save(tmp_path / "plain.npy", np.arange(4))
    np.testing.assert_array_equal(read_npy(tmp_path / "plain.npy"), np.arange(4))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"a": 1}, "expected a list of cameras"),
        ([{"K": [1]}], r"camera '0'.*K"),
        ([{"K": np.eye(3), "R": np.eye(3), "T": [0, 0, 0]}], r"res"),
    ],
)
def test_cameras_that_are_none_are_refused(tmp_path, content, message):
    save(tmp_path / "camera_params.npy", np.array(content, object) if isinstance(content, list) else content)
    with pytest.raises(ValueError, match=message) as caught:
        read_cameras(tmp_path / "camera_params.npy")
    assert "camera_params.npy" in str(caught.value)


def test_other_bad_input_is_refused(folder):
    with pytest.raises(ValueError, match=r"leave out data\.skeleton"):
        read(folder, calibration="x", skeleton="coco17")
    path = folder / "shelf_eval_2d_detection_dict.npy"
    save(path, {"img_0": {"0000": [{"meta": np.zeros((3, 3))}]}})
    with pytest.raises(ValueError, match=r"img_0, 0000: expected `meta` or `filtered_skel`"):
        read(folder)
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(ValueError, match=r"dict\.npy: expected an array or a dictionary of arrays"):
        read(folder)
    path.write_text("no array")
    with pytest.raises(ValueError, match=r"dict\.npy: expected an array or a dictionary of arrays"):
        read(folder)
    path.unlink()
    with pytest.raises(FileNotFoundError, match="2d_detection_dict"):
        read(folder)
