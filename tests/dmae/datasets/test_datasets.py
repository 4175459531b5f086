"""Items of the torch data sets equal the data of the clips, in any order and with any number of workers."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

from dmae import datasets
from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25, SHELF14
from dmae.data.store import load_clip, save_clip, write_manifest
from dmae.datasets import ClipDataset, FrameDataset, WindowDataset
from tests.support.clips import full_clip
from tests.support.data_sets import image_set

LENGTHS = (12, 7, 3)


@pytest.fixture(scope="module")
def clips(tmp_path_factory) -> Path:
    """Clips of different lengths, with truth that is absent at times, poses and labels."""
    out = tmp_path_factory.mktemp("clips") / "set"
    for number, frames in enumerate(LENGTHS):
        clip = full_clip(frames)
        xyz = clip.truth.xyz.copy()
        xyz[1, 0, 3:9] = xyz[2, 1] = np.nan
        source = np.where(np.isnan(xyz).any(-1), Source.ABSENT, Source.COMPLETED)
        poses = Poses3D(BODY25, xyz[:, :1], source[:, :1], views=np.full(xyz[:, :1].shape[:3], 3))
        save_clip(replace(clip, truth=Poses3D(BODY25, xyz), poses=poses), out / f"{number}")
    write_manifest(out, [{"id": str(number), "status": "ok"} for number in range(len(LENGTHS))])
    return out


@pytest.fixture(scope="module")
def images(tmp_path_factory) -> Path:
    return image_set(tmp_path_factory.mktemp("images") / "set")


def test_a_part_of_a_clip_is_that_part_of_the_whole(clips):
    for file in datasets.clip_files(clips):
        whole, part = load_clip(file.folder), file.read(1, 3)
        expected = whole.select(slice(1, 3))
        assert (file.frames, file.cameras) == (len(whole), whole.rig.names)
        assert file.persons == {"truth": 2, "poses": 1}
        for name in ("detections", "truth", "poses", "occlusion", "detection_labels"):
            for key, array in vars(getattr(expected, name)).items():
                if isinstance(array, np.ndarray):
                    np.testing.assert_array_equal(getattr(getattr(part, name), key), array)
        np.testing.assert_array_equal(part.rig.K, whole.rig.K)
        np.testing.assert_array_equal(part.true_rig.K, whole.true_rig.K)
        assert part.provenance["first_frame"] == 1
        assert file.read(0, 1, view=2).rig.names == (whole.rig.names[2],)
        for start, stop in ((-5, None), (1, len(whole) + 1), (2, 1)):
            with pytest.raises(ValueError, match=f"expected an order, and frames 0 to {len(whole)}"):
                file.read(start, stop)


def test_windows_cover_each_person_of_each_clip(clips):
    windows = WindowDataset(clips, frames=4, every=3)
    assert len(windows) == 2 * 3 + 2 * 2
    places = [windows.place(index) for index in range(len(windows))]
    assert places == [(0, p, s) for p in (0, 1) for s in (0, 3, 6)] + [(1, p, s) for p in (0, 1) for s in (0, 3)]
    whole = [load_clip(folder) for folder in sorted(clips.glob("[0-9]"))]
    for index, (clip, person, start) in enumerate(places):
        window = windows[index]
        xyz = whole[clip].truth.xyz[start : start + 4, person]
        np.testing.assert_array_equal(window["xyz"], np.nan_to_num(xyz))
        np.testing.assert_array_equal(window["observed"], ~np.isnan(xyz).any(-1))
        seen = whole[clip].occlusion.visible_views[start : start + 4, person]
        np.testing.assert_array_equal(window["views"], np.where(window["observed"], seen, 0))
        assert (window["clip"], window["person"], window["start"]) == (clip, person, start)
        assert len(windows.clip(index)) == 4
    assert windows[-1]["start"] == 3
    with pytest.raises(IndexError):
        windows[len(windows)]
    with pytest.raises(TypeError, match="'str' object cannot be interpreted as an integer"):
        windows["0"]
    assert repr(windows) == f"WindowDataset(windows={len(windows)}, clips=3, frames=4, of='truth')"
    assert repr(ClipDataset(clips)) == "ClipDataset(clips=3)"


def test_windows_of_poses_on_another_skeleton(clips):
    windows = WindowDataset(clips, frames=5, every=5, of="poses", skeleton="shelf14")
    clip = load_clip(clips / "0")
    assert len(windows) == 3
    window, expected = windows[1], convert(clip.poses, SHELF14)
    np.testing.assert_array_equal(window["xyz"], expected.xyz[5:10, 0])
    assert (window["source"] == Source.COMPLETED).all() and (window["views"] == 3).all()


def test_images_are_the_images_with_what_the_ids_show(images):
    frames = FrameDataset(images, masks=True)
    assert len(frames) == 3 * 2 * 3
    assert repr(frames) == "FrameDataset(images=18, clips=3, skeleton='coco17')"
    shown = 0
    for index in np.random.default_rng(0).permutation(len(frames)).tolist():
        clip_number, view, frame = frames.place(index)
        clip = load_clip(images / f"{clip_number:06d}")
        image, target = frames[index]
        name = clip.rig.names[view]
        assert image.dtype == torch.float32 and image.max() <= 1  # as torchvision's detectors demand
        np.testing.assert_array_equal((255 * image).permute(1, 2, 0), clip.images.at("rgb", name, frame))
        ids = list(clip.images.read("ids", name))[frame]
        assert target["image_id"] == index
        for number, person in enumerate(target["persons"].tolist()):
            mask = ids == 1 + person
            rows, columns = np.nonzero(mask)
            np.testing.assert_array_equal(target["masks"][number], mask)
            edges = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
            np.testing.assert_array_equal(target["boxes"][number], edges)
            assert target["area"][number] == mask.sum()
            xy, _ = clip.rig.project(clip.truth.xyz)
            joints = target["keypoints"][number]
            nose = xy[frame, view, person, 0]
            assert joints.shape == (17, 3) and target["visibility"].shape[1] == 17
            np.testing.assert_allclose(joints[0, :2], nose if joints[0, 2] else (0, 0), atol=1e-3)
            shown += 1
    assert shown == 33
    assert len(FrameDataset(images, every=2)) == 3 * 2 * 2
    assert "masks" not in FrameDataset(images)[0][1]


def test_depth_is_in_metres_and_says_where_it_is_known(tmp_path):
    frames = FrameDataset(image_set(tmp_path / "set", clips=1, depth=True), depth=True)
    for index in range(len(frames)):
        _, view, frame = frames.place(index)
        image, target = frames[index]
        clip = load_clip(tmp_path / "set/000000")
        true = clip.images.at("depth", clip.rig.names[view], frame)
        assert target["depth"].dtype == torch.float32 and target["depth"].shape == image.shape[1:]
        np.testing.assert_array_equal(target["depth_known"], np.isfinite(true))
        np.testing.assert_array_equal(target["depth"], np.nan_to_num(true))
        assert target["depth"][65, 120] == 2  # the box


@pytest.mark.slow
def test_workers_give_what_one_process_gives(clips, images):
    windows, frames = WindowDataset(clips, frames=4, every=3), FrameDataset(images)
    assert frames[0][0].shape == (3, 150, 240)  # a video is open when workers are forked
    for made, collate, batch in ((windows, None, 4), (frames, frames.collate, 5), (ClipDataset(clips), list, 2)):
        one, two = (
            list(DataLoader(made, batch_size=batch, num_workers=workers, collate_fn=collate)) for workers in (0, 2)
        )
        assert len(one) == len(two) == -(-len(made) // batch)
        same(one, two)
    everything = torch.cat([batch["xyz"] for batch in DataLoader(windows, batch_size=4)])
    assert everything.shape == (10, 4, 25, 3)


def same(one, two) -> None:
    assert type(one) is type(two)
    if isinstance(one, dict):
        assert one.keys() == two.keys()
        one, two = list(one.values()), list(two.values())
    if isinstance(one, list | tuple):
        assert len(one) == len(two)
        for pair in zip(one, two, strict=True):
            same(*pair)
    elif isinstance(one, torch.Tensor):
        assert one.dtype == two.dtype
        torch.testing.assert_close(one, two, rtol=0, atol=0)


def test_clips_are_read_when_they_are_asked_for(clips, images, monkeypatch):
    """Making a data set reads sizes and names alone; pickled, as for workers, it stays small."""
    monkeypatch.setattr(datasets, "assemble_clip", None)
    for made in (ClipDataset(clips), WindowDataset(clips, frames=2), FrameDataset(images)):
        assert len(pickle.dumps(made)) < 5_000
    lengths = ClipDataset(clips, transform=len)
    assert [lengths[index] for index in range(3)] == list(LENGTHS)


def test_a_split_is_the_clips_of_its_names(clips, images):
    windows = WindowDataset(clips, frames=4, every=3, clips=["1"])
    assert [file.folder.name for file in windows.files] == ["1"]
    assert ClipDataset(clips, clips=["1", "0"]).folders == [clips / "0", clips / "1"]
    name = FrameDataset(images).files[-1].folder.name
    assert [file.folder.name for file in FrameDataset(images, clips=[name]).files] == [name]
    for kind, path in ((ClipDataset, clips), (WindowDataset, clips), (FrameDataset, images)):
        with pytest.raises(ValueError, match=r"clips=\['nine'\]: there are no such clips"):
            kind(path, clips=["nine"])
        with pytest.raises(TypeError, match=r"clips='train': expected a list of names"):
            kind(path, clips="train")


def test_bad_input_is_refused(clips, images, tmp_path):
    for kind in (ClipDataset, WindowDataset, FrameDataset):
        with pytest.raises(FileNotFoundError, match="expected a clip"):
            kind(tmp_path)
        with pytest.raises(FileNotFoundError, match=r"none: expected a clip .* found no such folder$"):
            kind(tmp_path / "none")
    with pytest.raises(ValueError, match=r"no truth of 30 frames in 3 clips; the longest has 12 frames"):
        WindowDataset(clips)
    with pytest.raises(ValueError, match=r"no poses of 3 frames"):
        WindowDataset(images, frames=3, of="poses")
    with pytest.raises(ValueError, match="found frames=0"):
        WindowDataset(clips, frames=0)
    with pytest.raises(ValueError, match=r"expected images of kind rgb, found none; synth render .* images=rgb"):
        FrameDataset(clips)
    with pytest.raises(ValueError, match=r"expected images of kind depth, found rgb, ids; synth render .* images=all"):
        FrameDataset(images, depth=True)
    with pytest.raises(KeyError, match="body26"):
        FrameDataset(images, skeleton="body26")
    clip = full_clip(3)
    save_clip(clip, tmp_path / "cut")
    data = (tmp_path / "cut/arrays.safetensors").read_bytes()
    (tmp_path / "cut/arrays.safetensors").write_bytes(data[: len(data) // 2])
    with pytest.raises(ValueError, match=r"cut/arrays\.safetensors: .*the clip is damaged"):
        WindowDataset(tmp_path / "cut", frames=2)
