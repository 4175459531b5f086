"""DeepLabCut's files, written by pandas as DeepLabCut does."""

import shutil

import numpy as np
import pytest

import dmae
from dmae.formats.reading import recognise
from tests.support.animal_files import write_deeplabcut
from tests.support.animals import DOG, SKELETONS
from tests.support.recordings import same_detections

pytest.importorskip("tables", reason="pandas writes HDF5 by PyTables")

FILE = str(SKELETONS / "dog.yaml")


@pytest.mark.parametrize("animals", [1, 2])
@pytest.mark.parametrize("kind", ["h5", "fixed", "csv"])
def test_detections_of_one_animal_and_of_several(tmp_path, kind, animals):
    clip = write_deeplabcut(tmp_path, kind=kind, animals=animals)
    assert recognise(tmp_path) == "deeplabcut"
    read = dmae.read(tmp_path, fps=30, skeleton=FILE)
    assert read.detections.skeleton == DOG
    assert read.rig.names == clip.rig.names
    same_detections(read.detections, clip.detections)


def test_without_a_skeleton_it_is_made_of_the_names(tmp_path):
    write_deeplabcut(tmp_path)
    read = dmae.read(tmp_path, fps=30)
    skeleton = read.detections.skeleton
    assert skeleton.joints == DOG.joints
    assert skeleton.pairs == DOG.pairs
    assert not skeleton.bones
    assert skeleton.size_m is None
    assert "no skeleton was given" in read.provenance["notes"][0]


def test_hdf5_comes_before_csv_and_cameras_once(tmp_path):
    clip = write_deeplabcut(tmp_path)
    write_deeplabcut(tmp_path, clip, "csv")
    same_detections(dmae.read(tmp_path, fps=30, skeleton=FILE).detections, clip.detections)
    shutil.copy(tmp_path / "cam1DLC_resnet50_x.h5", tmp_path / "cam1DLC_resnet50_x_filtered.h5")
    with pytest.raises(ValueError, match="expected one file for camera 'cam1'"):
        dmae.read(tmp_path, fps=30)


def test_joints_of_another_skeleton_are_refused(tmp_path):
    write_deeplabcut(tmp_path)
    with pytest.raises(ValueError, match=r"expected the joints of hand21: it lacks wrist.*and has withers"):
        dmae.read(tmp_path, fps=30, skeleton=str(SKELETONS / "hand.yaml"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("bodyparts", "parts"), "expected detections of DeepLabCut, lines of scorer"),
        (lambda text: text.replace("likelihood", "z", 1), "expected columns x, y and likelihood"),
        (lambda text: text.replace("\n1,", "\n0,"), "frames of different numbers"),
        (lambda text: text.replace("\n1,", "\n1,5,"), "line 5: expected 58 cells, found 59"),
        (lambda text: text.replace("\n1,", "\none,"), "line 5: expected numbers"),
        (lambda text: text.replace("withers", "neck"), "each joint once"),
        (lambda text: "\n".join(text.splitlines()[:3]), "expected a row for each frame"),
    ],
)
def test_a_wrong_table_is_answered_with_its_file(tmp_path, change, message):
    write_deeplabcut(tmp_path, kind="csv")
    file = tmp_path / "cam0DLC_resnet50_x.csv"
    file.write_text(change(file.read_text()))
    with pytest.raises(ValueError, match=message) as caught:
        dmae.read(tmp_path, fps=30)
    assert file.name in str(caught.value)


def test_pickled_labels_run_nothing(tmp_path):
    import h5py

    write_deeplabcut(tmp_path)
    with h5py.File(tmp_path / "cam0DLC_resnet50_x.h5", "r+") as file:
        file["df_with_missing"].attrs["non_index_axes"] = np.bytes_(b"cos\nsystem\n(S'false'\ntR.")
    with pytest.raises(ValueError, match=r"requests os.system, which is not loaded"):
        dmae.read(tmp_path, fps=30)
