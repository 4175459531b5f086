import json
import os
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dmae
from dmae.data.clip import Clip
from dmae.data.conversion import convert
from dmae.data.labels import JointError
from dmae.data.skeleton import BODY25, BODY25B, PANOPTIC19, SHELF14
from dmae.data.store import save_clip, write_manifest
from dmae.formats import easymocap, panoptic
from dmae.formats.calibrations import write_calibration
from dmae.formats.coco import write_coco
from dmae.formats.config import Convention, LengthUnit, UpDirection
from dmae.formats.reading import Clips, DataConfig, recognise, select_views
from dmae.formats.writing import write_poses
from tests.support.clips import full_clip, walkers
from tests.support.recordings import recording, same_detections, write_frames, write_openpose_recording


@pytest.fixture
def data_set(tmp_path) -> Path:
    """Two clips that are ok, one that failed."""
    for name in ("a", "b"):
        save_clip(replace(full_clip(), id=name), tmp_path / name)
    write_manifest(
        tmp_path, [{"id": "a", "status": "ok"}, {"id": "b", "status": "ok"}, {"id": "c", "status": "failed"}]
    )
    return tmp_path


def test_a_data_set_is_its_clips_that_are_ok(data_set):
    config = DataConfig(path=str(data_set))
    assert [clip.id for clip in Clips(config)] == ["a", "b"]
    assert len(Clips(config)) == 2
    assert Clips(config).data_set


def test_clips_of_a_data_set_are_called_as_their_folders(data_set):
    """Two recordings, put together by hand, may both be called session."""
    for name in ("a", "b"):
        shutil.rmtree(data_set / name)
        save_clip(replace(full_clip(), id="session"), data_set / name)
    assert [clip.id for clip in Clips(DataConfig(path=str(data_set)))] == ["a", "b"]
    assert read("clip", data_set / "a").id == "session"


def test_a_slice_of_a_data_set_is_a_data_set(data_set):
    save_clip(replace(full_clip(), id="d"), data_set / "d")
    write_manifest(data_set, [{"id": each, "status": "ok"} for each in "abd"])
    clips = Clips(DataConfig(path=str(data_set)))
    for part in (slice(1), slice(1, None), slice(None, None, -1), slice(0, 3, 2), slice(5, 9)):
        found = clips[part]
        assert [clip.id for clip in found] == ["a", "b", "d"][part]
        assert [clips.names[number] for number in found.numbers] == ["a", "b", "d"][part]
        assert len(found) == len(found.folders) and found.total == 3
    assert [clip.id for clip in clips[::2][1:]] == ["d"]


def test_a_clip_is_itself(data_set):
    config = DataConfig(path=str(data_set / "b"))
    assert [clip.id for clip in Clips(config)] == ["b"]
    assert not Clips(config).data_set


def test_clips_are_read_when_asked_for(data_set):
    clips = Clips(DataConfig(path=str(data_set)))
    (data_set / "b" / "clip.json").unlink()
    assert clips[0].id == "a" and repr(clips).endswith("', clips=2)")
    with pytest.raises(FileNotFoundError, match="b: expected a clip folder"):
        clips[1]


def test_cameras_restrict_the_views(data_set):
    clip = Clips(DataConfig(path=str(data_set), cameras=["cam2", "cam0"]))[0]
    assert clip.rig.names == ("cam2", "cam0")
    np.testing.assert_array_equal(clip.detections.xy, full_clip().detections.xy[:, [2, 0]])


def test_frames_restrict_the_clip_and_keep_their_numbers(data_set):
    whole = full_clip()
    clip = Clips(DataConfig(path=str(data_set), frames=[1, len(whole)]))[0]
    assert len(clip) == len(whole) - 1
    np.testing.assert_array_equal(clip.detections.xy, whole.detections.xy[1:])
    assert clip.provenance["first_frame"] == whole.provenance.get("first_frame", 0) + 1


@pytest.mark.parametrize("frames", [[0, 10**6], [-1, 2], [2, 2], [1]])
def test_frames_that_are_not_there_are_refused(data_set, frames):
    with pytest.raises(ValueError, match=r"data\.frames=\[.*expected \[first, end\] within the \d+ frames of clip 'a'"):
        Clips(DataConfig(path=str(data_set), frames=frames))[0]


@pytest.mark.parametrize("cameras", [[0, 4], [-1], [], [1, 1]])
def test_cameras_that_are_not_there_are_refused_with_those_that_are(data_set, cameras):
    with pytest.raises(ValueError, match=r"data\.cameras=\[.*'a', each once; it has cam0, cam1"):
        Clips(DataConfig(path=str(data_set), cameras=cameras))[0]


@pytest.mark.parametrize("file", ["a/clip.json", "a/arrays.safetensors", "manifest.jsonl"])
def test_a_file_of_a_clip_or_a_data_set_is_answered_with_its_folder(data_set, file):
    folder = (data_set / file).parent
    with pytest.raises(ValueError, match=f"found a file of one; give its folder, {folder}$"):
        Clips(DataConfig(path=str(data_set / file)))


def test_nothing_there_is_said(tmp_path):
    with pytest.raises(FileNotFoundError, match="expected a clip"):
        Clips(DataConfig(path=str(tmp_path / "nothing")))


def test_of_several_clips_the_one_written_last_is_named(data_set):
    """As the completed one in a folder that `dmae run` wrote."""
    (data_set / "manifest.jsonl").unlink()
    os.utime(data_set / "a/clip.json", (0, 0))
    with pytest.raises(ValueError, match=f"found a folder of clips, .*; name one, as {data_set}/b") as error:
        Clips(DataConfig(path=str(data_set)))
    (data_set / "manifest.jsonl").write_text(re.search(r"with a line (\{.*\}) for each", str(error.value))[1])
    assert Clips(DataConfig(path=str(data_set))).names == ["b"]


def test_shelf(data_folder):
    config = DataConfig("shelf", str(data_folder / "shelf"), [0, 1, 3])
    (clip,) = Clips(config)
    assert len(clip) == 301
    assert clip.rig.names == ("0", "1", "3")
    assert clip.truth.skeleton == SHELF14
    assert not Clips(config).data_set


@pytest.fixture
def walk() -> Clip:
    return recording(BODY25)


def read(name: str, path: Path, **options) -> Clip:
    (clip,) = Clips(DataConfig(name, str(path), **options))
    return clip


def same(found: Clip, wanted: Clip) -> None:
    same_detections(found.detections, wanted.detections)
    np.testing.assert_allclose(found.rig.projections, wanted.rig.projections, atol=1e-6)
    assert found.rig.names == wanted.rig.names


def test_openpose_needs_cameras_and_detections_and_says_so(walk, tmp_path):
    # Calibrations are searched in folders up to the one above the session, where other tests may have theirs.
    session = tmp_path / "study" / "session"
    write_calibration(walk.rig, session / "rig" / "cameras.toml", "pose2sim")
    write_frames(walk, session / "take" / "somewhere")
    with pytest.raises(FileNotFoundError, match=r"data\.detections=\.\.\."):
        read("openpose", session / "take", fps=25.0)
    detections = str(session / "take" / "somewhere")
    with pytest.raises(FileNotFoundError, match=r"data\.calibration=\.\.\."):
        read("openpose", session / "take", fps=25.0, detections=detections)
    calibration = session / "rig" / "cameras.toml"
    same(read("openpose", session / "take", fps=25.0, detections=detections, calibration=str(calibration)), walk)
    shared = session / "calibration" / "cameras.toml"
    shared.parent.mkdir()
    calibration.rename(shared)
    found = read("openpose", session / "take", fps=25.0, detections=detections)
    assert found.provenance["notes"][0] == f"cameras are from {shared}; data.calibration names another file"


def test_another_format_than_the_one_given_is_named(walk, tmp_path):
    write_coco(walk, tmp_path)
    for name in ("shelf", "pose2sim"):
        with pytest.raises(FileNotFoundError, match=r"\. The files look like data=coco$"):
            read(name, tmp_path)
    (tmp_path / "keypoints.json").rename(tmp_path / "other.json")
    with pytest.raises(FileNotFoundError, match=r"calibration.json: no such file$"):
        read("shelf", tmp_path)


def test_openpose_with_published_cameras_needs_the_size_of_the_images(walk, tmp_path):
    path = write_openpose_recording(walk, tmp_path) / "calibration.toml"
    path.write_text(re.sub(r"(?m)^size = .*\n", "", path.read_text()))
    with pytest.raises(ValueError, match=r"size=\[width,height\]"):
        read("openpose", tmp_path, fps=25.0)
    same(read("openpose", tmp_path, fps=25.0, size=[960, 600]), walk)


def test_an_unknown_skeleton_is_answered_with_those_there_are(walk, tmp_path):
    write_openpose_recording(walk, tmp_path)
    with pytest.raises(ValueError, match=r"data\.skeleton=lizard: no skeleton 'lizard'; there are .*body25"):
        read("openpose", tmp_path, fps=25.0, skeleton="lizard")


@pytest.mark.parametrize(
    ("unit", "up", "inverse"),
    [(LengthUnit.mm, UpDirection.z, False), (LengthUnit.m, UpDirection.y, False), (LengthUnit.m, UpDirection.z, True)],
)
def test_calibrations_in_other_conventions(walk, tmp_path, unit, up, inverse):
    """A wrong unit, axis or direction of the poses is mended by an option, and only by that."""
    write_frames(walk, tmp_path)
    said = {"unit": unit, "up": up, "inverse": inverse}
    write_calibration(Convention(unit, up, inverse).written_rig(walk.rig), tmp_path / "calib.toml", "pose2sim")
    same(read("openpose", tmp_path, fps=25.0, **said), walk)
    assert not np.allclose(read("openpose", tmp_path, fps=25.0).rig.projections, walk.rig.projections, atol=1e-3)


def test_easymocap(walk, tmp_path):
    with pytest.raises(FileNotFoundError, match=r"data\.detections=\.\.\."):
        read("easymocap", tmp_path, fps=25.0)
    easymocap.write_easymocap(walk, tmp_path)
    same(read("easymocap", tmp_path, fps=50.0), walk)
    assert read("easymocap", tmp_path, fps=50.0).fps == 50
    with pytest.raises(ValueError, match=r"no file states the frame rate; give data\.fps=\.\.\."):
        read("easymocap", tmp_path)
    with pytest.raises(ValueError, match="joints as of coco17"):
        read("easymocap", tmp_path, fps=25.0, skeleton="coco17")
    other = recording(BODY25B)
    easymocap.write_easymocap(other, tmp_path)
    same(read("easymocap", tmp_path, fps=25.0), other)


def test_a_calibration_of_easymocap_is_no_recording_of_it(walk, tmp_path):
    easymocap.write_cameras(walk.rig, tmp_path)
    (tmp_path / "predictions").mkdir()
    (tmp_path / "predictions" / "left.json").write_text("{}")
    assert recognise(tmp_path) == "mmpose"


def test_panoptic_has_cameras_truth_and_rate_but_no_detections_of_its_own(walk, tmp_path):
    truth = convert(walkers(), PANOPTIC19)
    panoptic.write_poses(truth, 29.97, tmp_path, first=100)
    write_calibration(walk.rig, tmp_path / "calibration_walk.json", "panoptic")
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match=r"data\.detections=\.\.\."):
        read("panoptic", tmp_path, detections=str(tmp_path / "empty"))
    alone = read("panoptic", tmp_path)
    assert not alone.detections.observed.any()
    np.testing.assert_allclose(alone.truth.xyz, truth.xyz, atol=1e-5)
    write_frames(walk, tmp_path / "elsewhere", first=100)
    clip = read("panoptic", tmp_path, detections=str(tmp_path / "elsewhere"))
    same(clip, walk)
    assert clip.fps == 29.97
    np.testing.assert_allclose(clip.truth.xyz, truth.xyz, atol=1e-5)
    # Beside each other, poses are not taken for another camera's detections.
    write_frames(walk, tmp_path, first=100)
    same(read("panoptic", tmp_path), walk)
    # One who says that the world is another says it of cameras and truth alike.
    turned = read("panoptic", tmp_path, up=UpDirection.z)
    moved = Convention(up=UpDirection.z).points(panoptic.CONVENTION.written_points(truth.xyz) / 100)
    np.testing.assert_allclose(turned.truth.xyz, moved, atol=1e-5)
    np.testing.assert_allclose(turned.rig.project(moved)[0], walk.rig.project(truth.xyz)[0], atol=1e-2)


def test_coco(walk, tmp_path):
    write_coco(walk, tmp_path)
    same(read("coco", tmp_path), walk)
    # The file may be named itself; its calibration is beside it.
    clip = read("coco", tmp_path / "keypoints.json")
    same(clip, walk)
    assert clip.id == "keypoints"
    assert not any("cameras are from" in note for note in clip.provenance["notes"])
    content = json.loads((tmp_path / "keypoints.json").read_text())
    del content["info"]
    (tmp_path / "keypoints.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match=r"data\.fps=\.\.\."):
        read("coco", tmp_path)


@pytest.mark.parametrize("name", ["clip", "shelf"])
def test_what_says_all_of_itself_takes_no_options(tmp_path, name):
    save_clip(full_clip(), tmp_path)
    with pytest.raises(ValueError, match=rf"data={name} says that itself; leave out data\.fps, data\.unit"):
        read(name, tmp_path, fps=25.0, unit=LengthUnit.mm)


def test_another_calibration_replaces_the_cameras_of_a_clip(tmp_path):
    recorded = full_clip()
    clip = replace(recorded, poses=recorded.truth).select(views=slice(0, 3))
    save_clip(clip, tmp_path / "clip")
    moved = recorded.rig.cam_from_world.copy()
    moved[1, :3, 3] += 0.1
    rig, file = replace(recorded.rig, cam_from_world=moved), tmp_path / "rig.toml"
    # In mm, y up, in another order, and with a camera that the clip lacks.
    write_calibration(Convention(LengthUnit.mm, UpDirection.y).written_rig(rig[[3, 1, 2, 0]]), file, "pose2sim")
    options = {"calibration": str(file), "unit": LengthUnit.mm, "up": UpDirection.y}
    found = read("clip", tmp_path / "clip", **options)
    assert found.rig.names == clip.rig.names
    np.testing.assert_allclose(found.rig.cam_from_world, moved[:3], atol=1e-6)
    np.testing.assert_array_equal(found.detections.xy, clip.detections.xy)
    assert found.poses is None  # they were captured with the old cameras
    np.testing.assert_array_equal(found.true_rig.cam_from_world, clip.actual_rig.cam_from_world)
    assert found.provenance["notes"][-1] == f"cameras are from data.calibration={file}"

    with pytest.raises(ValueError, match=r"leave out data\.up, or give another calibration.*data\.calibration="):
        read("clip", tmp_path / "clip", up=UpDirection.y)
    write_calibration(rig[:2], file, "pose2sim")
    with pytest.raises(ValueError, match=r"rig\.toml: expected the cameras .*, cam0, cam1, cam2; found cam0, cam1$"):
        read("clip", tmp_path / "clip", calibration=str(file))
    write_calibration(replace(rig, size=2 * rig.size), file, "pose2sim")
    with pytest.raises(ValueError, match=r"camera 'cam0': expected a calibration of images of \d+ x \d+ px"):
        read("clip", tmp_path / "clip", calibration=str(file))


def test_cameras_that_started_late_are_moved_and_blind_where_they_were_not_on(tmp_path):
    clip = full_clip()
    save_clip(clip, tmp_path)
    found = read("clip", tmp_path, offsets=[0, 2, -3, 40])
    was, now = clip.detections.xy, found.detections.xy
    np.testing.assert_array_equal(now[:, 0], was[:, 0])
    np.testing.assert_array_equal(now[2:, 1], was[:-2, 1])
    np.testing.assert_array_equal(now[:-3, 2], was[3:, 2])
    assert np.isnan(now[:2, 1]).all()
    assert np.isnan(now[-3:, 2]).all()
    assert np.isnan(now[:, 3]).all()
    np.testing.assert_array_equal(found.detection_labels.person[2:, 1], clip.detection_labels.person[:-2, 1])
    assert (found.detection_labels.person[:2, 1] == -1).all()
    np.testing.assert_array_equal(found.detection_labels.error[2:, 1], clip.detection_labels.error[:-2, 1])
    assert (found.detection_labels.error[:2, 1] == JointError.ABSENT).all()
    assert found.provenance["offsets"] == [0, 2, -3, 40]
    assert "notes" not in found.provenance
    assert len(found) == len(clip)
    assert dmae.read(tmp_path, offsets={"cam1": 2, "cam2": -3, "cam3": 40}) == found
    with pytest.raises(
        ValueError, match=r"offsets=\['lef:2'\]: expected a number for each camera, or entries as cam0:3"
    ):
        dmae.read(tmp_path, offsets={"lef": 2})
    with pytest.raises(
        ValueError, match=r"data\.offsets=\[1\]: expected a number of frames for each camera.*cam0, cam1"
    ):
        read("clip", tmp_path, offsets=[1])
    # Poses were captured before, from views at other times.
    save_clip(replace(clip, poses=clip.truth), tmp_path / "captured")
    late = read("clip", tmp_path / "captured", offsets=[0, 1, 0, 0])
    assert late.poses is None
    assert late.provenance["notes"] == ["poses are left out: they were captured with other offsets between cameras"]
    assert read("clip", tmp_path / "captured", offsets=[0, 0, 0, 0]).poses == clip.truth


def test_cameras_are_chosen_by_name_or_number(tmp_path):
    clip = recording(BODY25, 2)
    write_openpose_recording(clip, tmp_path)

    def names(cameras):
        return Clips(DataConfig("openpose", str(tmp_path), fps=25.0, cameras=cameras))[0].rig.names

    assert names(["cam2", "cam0"]) == ("cam2", "cam0")
    for wrong in (["left"], ["cam1", "cam1"], [2, 0], ["cam1", 3], []):
        with pytest.raises(ValueError, match=r"expected names of cameras .*, each once; it has cam0, cam1"):
            names(wrong)


@pytest.mark.parametrize("names", [("1", "2", "3", "4"), ("01", "02", "03", "04")])
def test_a_number_is_the_camera_of_that_name_and_never_a_count(names):
    clip = recording(BODY25, 2)
    clip = replace(clip, rig=replace(clip.rig, names=names))
    chosen = select_views(clip, [1, names[3]])
    assert chosen.rig.names == (names[0], names[3])
    assert chosen.provenance["notes"][-1] == f"data.cameras: 2 of 4 cameras: {names[0]}, {names[3]}"
    with pytest.raises(ValueError, match="names of cameras"):
        select_views(clip, [0])


def test_truth_of_a_file_is_placed_by_the_numbers_of_its_frames(tmp_path):
    """A table that annotates some frames, the first of which is not the first of the recording."""
    clip = full_clip(6)
    clip = replace(clip, provenance=clip.provenance | {"first_frame": 300})
    assert clip.truth is not None
    save_clip(replace(clip, truth=None, poses=clip.truth, occlusion=None, detection_labels=None), tmp_path / "walk")
    write_poses(replace(clip, poses=clip.truth), tmp_path / "truth.csv")
    lines = (tmp_path / "truth.csv").read_text().splitlines()
    (tmp_path / "truth.csv").write_text("\n".join([lines[0], *(line for line in lines[1:] if int(line[:3]) > 302)]))
    for frames in (None, [2, 6]):
        config = DataConfig("clip", str(tmp_path / "walk"), truth=str(tmp_path / "truth.csv"), frames=frames)
        read = Clips(config)[0]
        first = 0 if frames is None else frames[0]
        assert read.truth is not None and np.isnan(read.truth.xyz[: 3 - first]).all()
        wanted = convert(clip.truth, read.truth.skeleton).xyz[3:]
        np.testing.assert_allclose(read.truth.xyz[3 - first :], wanted, atol=1e-4)
        assert f"truth is from data.truth={tmp_path / 'truth.csv'}" in read.provenance["notes"]


@pytest.mark.parametrize(
    ("first", "frames", "format", "message"),
    [
        (300, 5, "npz", "expected the 6 frames of the clip, found 5"),
        (900, 6, "csv", "expected some of the frames 300 to 305 of the clip, found 900 to 905"),
    ],
)
def test_truth_of_other_frames_is_refused(tmp_path, first, frames, format, message):
    clip = full_clip(6)
    save_clip(replace(clip, provenance=clip.provenance | {"first_frame": 300}), tmp_path / "walk")
    other = full_clip(frames)
    write_poses(
        replace(other, poses=other.truth, provenance=other.provenance | {"first_frame": first}),
        tmp_path / f"truth.{format}",
    )
    with pytest.raises(ValueError, match=message):
        Clips(DataConfig("clip", str(tmp_path / "walk"), truth=str(tmp_path / f"truth.{format}")))[0]


def test_truth_is_found_in_a_folder_by_the_name_of_a_clip(tmp_path):
    """Of a data set, and of a single clip in a folder of another name; the files of several people count as one."""
    clip = full_clip(6)
    (tmp_path / "set").mkdir()
    write_manifest(tmp_path / "set", [{"id": name, "status": "ok"} for name in ("walk", "run")])
    for folder in (tmp_path / "set" / "walk", tmp_path / "set" / "run"):
        save_clip(clip, folder)
    save_clip(clip, tmp_path / "elsewhere")
    (tmp_path / "truths").mkdir()
    for name in ("walk", "run", clip.id):
        write_poses(replace(clip, poses=clip.truth), tmp_path / "truths" / f"{name}.trc")
    assert not (tmp_path / "truths" / "walk.trc").exists()

    def truths(path: str, truth: str) -> list:
        return [each.truth for each in Clips(DataConfig("clip", str(tmp_path / path), truth=str(tmp_path / truth)))]

    assert len(truths("set", "truths")) == 2
    assert truths("elsewhere", "truths") == truths("elsewhere", "truths/walk.trc")
    with pytest.raises(ValueError, match=r"expected a folder with poses of each clip, as run\.npz, found one file"):
        truths("set", "truths/walk.trc")
    for file in (tmp_path / "truths").glob("run*"):
        file.unlink()
    with pytest.raises(ValueError, match=r"expected poses of clip run, found"):
        truths("set", "truths")
