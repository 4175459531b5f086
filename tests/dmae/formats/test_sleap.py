"""Analysis files of SLEAP, in the layouts of its versions."""

import h5py
import numpy as np
import pytest

import dmae
from dmae.formats.reading import recognise
from tests.support.animal_files import write_sleap
from tests.support.animals import DOG, SKELETONS
from tests.support.recordings import same_detections


@pytest.mark.parametrize("animals", [1, 2])
@pytest.mark.parametrize("said", [False, True])
def test_detections_of_one_animal_and_of_several(tmp_path, said, animals):
    clip = write_sleap(tmp_path, said=said, animals=animals)
    assert recognise(tmp_path) == "sleap"
    read = dmae.read(tmp_path, fps=30, skeleton=str(SKELETONS / "dog.yaml"))
    assert read.detections.skeleton == DOG
    same_detections(read.detections, clip.detections)


def test_without_a_skeleton_bones_are_the_edges(tmp_path):
    write_sleap(tmp_path)
    skeleton = dmae.read(tmp_path, fps=30).detections.skeleton
    assert skeleton.bones == DOG.bones
    assert skeleton.pairs == DOG.pairs


def test_edges_that_make_no_tree_are_left_out_with_a_note(tmp_path):
    write_sleap(tmp_path)
    for path in tmp_path.glob("*.h5"):
        with h5py.File(path, "r+") as file:
            edges = np.concatenate([file["edge_inds"][()], [[2, 0], [3, 2]]])
            del file["edge_inds"]
            file["edge_inds"] = edges
    read = dmae.read(tmp_path, fps=30)
    assert read.detections.skeleton.bones == DOG.bones
    notes = " ".join(read.provenance["notes"])
    assert "the edge from nose to withers is left out" in notes
    assert "the edge from l_ear to nose is left out" in notes


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda file: file.__delitem__("node_names"), "it lacks node_names"),
        (lambda file: file.__delitem__("tracks"), "it lacks tracks"),
        (lambda file: _replace(file, "tracks", np.zeros((1, 2, 5, 4))), "expected tracks of 19 nodes"),
        (lambda file: _replace(file, "edge_inds", [[0, 19]]), "expected edge_inds, pairs of numbers"),
        (lambda file: _replace(file, "point_scores", np.zeros((1, 19, 9))), "expected point_scores of shape"),
        (lambda file: _replace(file, "tracks", h5py.ExternalLink("other.h5", "tracks")), "it lacks tracks"),
        (lambda file: _large(file), "would take"),
        (lambda file: file["tracks"].attrs.__setitem__("dims", "[1"), "expected tracks of the axes"),
    ],
)
def test_a_wrong_file_is_answered_with_its_name(tmp_path, change, message):
    write_sleap(tmp_path)
    with h5py.File(tmp_path / "cam0.analysis.h5", "r+") as file:
        change(file)
    with pytest.raises(ValueError, match=message) as caught:
        dmae.read(tmp_path, fps=30)
    assert "cam0.analysis.h5" in str(caught.value)


def _replace(file: h5py.File, name: str, value) -> None:
    del file[name]
    file[name] = value


def _large(file: h5py.File) -> None:
    """An array that states terabytes and holds nothing."""
    del file["tracks"]
    file.create_dataset("tracks", (100_000, 2, 19, 1_000_000), "f8", chunks=(1, 2, 19, 100))


def test_no_hdf5_file(tmp_path):
    write_sleap(tmp_path)
    (tmp_path / "cam0.analysis.h5").write_text("frame,track\n")
    with pytest.raises(ValueError, match="found no HDF5 file"):
        dmae.read(tmp_path, fps=30)


def test_files_that_sleap_io_writes(tmp_path):
    sleap_io = pytest.importorskip("sleap_io", reason="it installs a package `tests`, and so is in no extra")
    clip = write_sleap(tmp_path)
    bones = [(DOG.joints[parent], DOG.joints[child]) for parent, child in DOG.bones]
    skeleton = sleap_io.Skeleton(list(DOG.joints), edges=bones)
    for view, name in enumerate(clip.rig.names):
        video, track = sleap_io.Video(filename=f"{name}.mp4", backend=None), sleap_io.Track("dog")
        frames = []
        for number, (xy, score) in enumerate(zip(clip.detections.xy[:, view, 0], clip.detections.score[:, view, 0],
                                                 strict=True)):  # fmt: skip
            found = sleap_io.PredictedInstance.from_numpy(xy, skeleton=skeleton, point_scores=score, track=track)
            frames.append(sleap_io.LabeledFrame(video=video, frame_idx=number, instances=[found]))
        labels = sleap_io.Labels(frames, videos=[video], skeletons=[skeleton], tracks=[track])
        for preset in ("matlab", "standard"):
            sleap_io.save_analysis_h5(labels, tmp_path / f"{name}.analysis.h5", preset=preset)
    same_detections(dmae.read(tmp_path, fps=30).detections, clip.detections)
