"""OpenPose's JSON, written by other programs and by this one."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dmae
from dmae.data.clip import Detections2D, Poses3D, Source
from dmae.data.skeleton import BODY21, BODY25, BODY25B, COCO17, COCO18, HALPE26
from dmae.formats.calibrations import write_calibration
from dmae.formats.openpose import COMPLETED_SCORE, read_detections, reproject, write_detections
from dmae.formats.recordings import NumberedDetections, to_clip
from dmae.formats.writing import write_recording
from tests.support.animals import dog_clip
from tests.support.clips import looking_at_origin, walkers
from tests.support.recordings import recording, same_detections, write_frames
from tests.support.tracked_recordings import mmpose_frames


def read(folder, clip, **options):
    return to_clip(read_detections(folder, **options), clip.rig, 25.0, folder)


@pytest.mark.parametrize(
    "name",
    [
        "{camera}/{camera}_{frame:012d}_keypoints.json",
        "{camera}_json/{camera}.{frame:04d}.json",
        "pose/{camera}_json/take7_{camera}_{frame:06d}.json",
        "openpose/{camera}/{frame}_keypoints.json",
    ],
)
def test_names_as_they_are_found(tmp_path, name):
    clip = recording(BODY25)
    write_frames(clip, tmp_path, name, first=95)
    found = read(tmp_path, clip)
    same_detections(found.detections, clip.detections)
    assert found.rig.names == clip.rig.names
    assert found.provenance["first_frame"] == 95
    assert found.provenance["notes"] == []


@pytest.mark.parametrize("skeleton", [BODY25, BODY25B, COCO18, COCO17, BODY21, HALPE26], ids=lambda s: s.name)
def test_skeletons_are_recognised(tmp_path, skeleton):
    write_frames(recording(skeleton, 2), tmp_path)
    found = read_detections(tmp_path)
    assert found.skeleton == skeleton
    assert bool(found.notes) == (skeleton == BODY25B)
    # The user has the last word.
    if len(skeleton) == 25:
        assert read_detections(tmp_path, skeleton=BODY25).skeleton == BODY25


def test_what_is_missing_is_absent_not_at_the_corner(tmp_path):
    clip = recording(BODY25, 1)
    write_frames(clip, tmp_path)
    # Ultralytics keeps the confidence of a joint that it doubts.
    for file in tmp_path.glob("*/*.json"):
        file.write_text(file.read_text().replace(" 0.0, 0.0, 0.0,", " 0.0, 0.0, 0.3,"))
    found = read_detections(tmp_path).views
    values = np.concatenate([view[0] for view in found.values()])
    assert np.isnan(values).any()
    assert np.nanmin(values[..., :2]) > 1


def test_a_file_cut_short_is_an_absent_frame_and_said(tmp_path):
    clip = recording(BODY25)
    write_frames(clip, tmp_path)
    file = tmp_path / "cam1" / "cam1_000000000004_keypoints.json"
    file.write_text(file.read_text()[:500])
    found = read(tmp_path, clip)
    xy, score = clip.detections.xy.copy(), clip.detections.score.copy()
    xy[4, 1], score[4, 1] = np.nan, np.nan
    same_detections(found.detections, Detections2D(BODY25, xy, score))
    (note,) = found.provenance["notes"]
    assert note.startswith("cam1: 1 of frames 0 to 11 are absent; 1 files could not be read, first")
    assert str(file) in note
    assert "line 1 column" in note


def test_gaps_and_cameras_of_other_lengths_are_aligned_by_number_and_counted(tmp_path):
    clip = recording(BODY25)
    write_frames(clip, tmp_path)
    for camera, frame in (("cam0", 5), ("cam2", 0), ("cam2", 1), ("cam3", 11)):
        (tmp_path / camera / f"{camera}_{frame:012d}_keypoints.json").unlink()
    xy, score = clip.detections.xy.copy(), clip.detections.score.copy()
    for frame, view in ((5, 0), (0, 2), (1, 2), (11, 3)):
        xy[frame, view], score[frame, view] = np.nan, np.nan
    found = read(tmp_path, clip)
    same_detections(found.detections, Detections2D(BODY25, xy, score))
    assert [note.split(" of ")[0] for note in found.provenance["notes"]] == [
        "cam0: 1", "cam2: 2", "cam3: 1",
    ]  # fmt: skip


@pytest.mark.parametrize("people", [[], [{}], [{"pose_keypoints_2d": []}], [{"pose_keypoints_2d": [0] * 75}]])
def test_frames_without_people_are_read(tmp_path, people):
    clip = recording(BODY25, 2)
    write_frames(clip, tmp_path)
    (tmp_path / "cam0" / "cam0_000000000001_keypoints.json").write_text(json.dumps({"people": people}))
    found = read(tmp_path, clip)
    assert np.isnan(found.detections.xy[1, 0]).all()
    assert np.isfinite(found.detections.xy[1, 1]).any()
    assert found.provenance["notes"] == []


def test_a_recording_without_people_is_read(tmp_path):
    clip = recording(BODY25, 2)
    nobody = replace(
        clip, detections=Detections2D(BODY25, np.full((2, 4, 1, 25, 2), np.nan), np.full((2, 4, 1, 25), np.nan))
    )
    write_frames(nobody, tmp_path)
    assert not read(tmp_path, clip).detections.observed.any()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"version": 1.3}, "expected an object with a list of people"),
        ("nobody", "expected an object with a list of people"),
        ([5], r"people\[0\].pose_keypoints_2d: expected x, y, confidence"),
        ({"people": [{"pose_keypoints_2d": [1.0, 2.0]}]}, r"people\[0\].pose_keypoints_2d: expected x, y, confidence"),
        ({"people": [{"hands": []}]}, r"people\[0\].pose_keypoints_2d: expected x, y, confidence"),
        ({"people": [{"pose_keypoints_2d": ["a"] * 75}]}, "expected x, y, confidence"),
        ({"people": [{"pose_keypoints_2d": [1.0] * 54}]}, "expected people of 25 joints as in .*cam0.*found 18"),
    ],
)
def test_json_that_is_not_openpose_s_is_refused_by_name(tmp_path, content, message):
    write_frames(recording(BODY25, 3), tmp_path)
    (tmp_path / "cam1" / "cam1_000000000001_keypoints.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match=message) as caught:
        read_detections(tmp_path)
    assert "cam1_000000000001_keypoints.json" in str(caught.value)


def test_other_bad_folders_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"data\.detections=\.\.\."):
        read_detections(tmp_path)
    write_frames(recording(BODY25, 2), tmp_path)
    (tmp_path / "cam0" / "x_1.json").write_text("{}")
    with pytest.raises(ValueError, match=r"expected frame 1 once, found it in cam0_0+1_keypoints\.json too"):
        read_detections(tmp_path)
    (tmp_path / "cam0" / "x_1.json").unlink()
    with pytest.raises(ValueError, match="expected people of 17 joints as of coco17, found 25"):
        read_detections(tmp_path, skeleton=COCO17)
    (tmp_path / "cam0").rename(tmp_path / "cam1_json")
    with pytest.raises(ValueError, match="found two of the same"):
        read_detections(tmp_path)
    for file in tmp_path.glob("*/*.json"):
        file.write_text("no json")
    (tmp_path / "cam1_json").rename(tmp_path / "cam0")
    with pytest.raises(ValueError, match=r"not one file could be read; .*cam0_0+_keypoints\.json: expected JSON"):
        read_detections(tmp_path)


def test_an_unknown_number_of_joints_is_answered_with_those_known(tmp_path):
    write_detections(Detections2D(BODY25, np.ones((1, 1, 1, 25, 2)) * 9, np.ones((1, 1, 1, 25))), ("a",), tmp_path)
    (file,) = tmp_path.glob("*/*.json")
    file.write_text(json.dumps({"people": [{"pose_keypoints_2d": [9.0] * 3 * 15}]}))
    with pytest.raises(
        ValueError,
        match=r"people of 15 joints, .*; there are .*17 \(coco17\), .*data\.skeleton=",
    ):
        read_detections(tmp_path)


def test_fractions_of_the_image_are_not_taken_for_pixels(tmp_path):
    clip = recording(BODY25, 2)
    found = clip.detections
    write_frames(replace(clip, detections=Detections2D(BODY25, found.xy / 960, found.score)), tmp_path)
    with pytest.raises(ValueError, match="keypoint_scale 0"):
        read_detections(tmp_path)


@given(st.integers(0, 3), st.integers(1, 3), st.integers(0, 2), st.integers(0, 999_999), st.integers(0, 2**32 - 1))
def test_read_after_write_is_equal(tmp_path_factory, frames, views, people, first, seed):
    rng = np.random.default_rng(seed)
    shape = (frames, views, people, 25)
    score = np.where(rng.random(shape) < 0.3, np.nan, rng.uniform(0.01, 1, shape))
    xy = np.where(np.isnan(score)[..., None], np.nan, rng.uniform(-50, 4000, (*shape, 2)))
    cameras = tuple(f"cam_{view}" for view in range(views))
    folder = tmp_path_factory.mktemp("openpose")
    written = Detections2D(BODY25, xy, score)
    write_detections(written, cameras, folder, first)
    if frames:
        found = read_detections(folder, skeleton=BODY25)
        assert set(found.views) == set(cameras)
        rig = recording(BODY25, 1, views).rig
        clip = to_clip(NumberedDetections(BODY25, found.views), rig, 25.0, folder)
        assert clip.provenance["first_frame"] == first
        same_detections(clip.detections, written)


def test_exported_poses_say_what_was_completed(tmp_path):
    poses = walkers(2)
    source = poses.source.copy()
    source[:, 0, 4] = Source.COMPLETED
    poses, rig = Poses3D(BODY25, poses.xyz, source), looking_at_origin()
    write_detections(reproject(poses, rig), rig.names, tmp_path, sources=poses.source)
    person = json.loads((tmp_path / "cam2" / "cam2_000000000001_keypoints.json").read_text())["people"][0]
    assert person["person_id"] == [0]
    assert person["joint_source"][4] == Source.COMPLETED
    joints = np.reshape(person["pose_keypoints_2d"], (25, 3))
    np.testing.assert_allclose(joints[:, :2], rig.project(poses.xyz)[0][1, 2, 0], atol=1e-3)
    assert joints[4, 2] == COMPLETED_SCORE
    assert (np.delete(joints[:, 2], 4) == 1).all()


@pytest.mark.parametrize("format", ["openpose", "easymocap"])
def test_a_skeleton_of_your_own_is_written_beside_and_named(tmp_path, format):
    clip = dog_clip(20)
    lacking = write_recording(clip, tmp_path / "walk", format)
    file = tmp_path / "walk/dog19.yaml"
    assert lacking == f"data.fps=30 data.skeleton={file}"
    read = dmae.read(tmp_path / "walk", fps=30, skeleton=str(file))
    assert read.detections.skeleton == clip.detections.skeleton


@pytest.mark.parametrize("format", [None, "mmpose"])
@pytest.mark.parametrize("folder", ["", "keypoints", "predictions"])
@pytest.mark.parametrize(
    "form",
    [
        lambda people: people,
        lambda people: {"instances": people},
        lambda people: {"meta_info": {}, "instance_info": people},
    ],
)
def test_frames_of_mmpose_in_a_file_each_are_read(tmp_path, form, folder, format):
    clip = recording(COCO17, 3, 2)
    (tmp_path / "calibration").mkdir()
    write_calibration(clip.rig, tmp_path / "calibration" / "Calib.toml", "pose2sim")
    for view, name in enumerate(clip.rig.names):
        (tmp_path / folder / name).mkdir(parents=True)
        for frame, of_frame in enumerate(mmpose_frames(clip, view)):
            (tmp_path / folder / name / f"{frame:06d}.json").write_text(json.dumps(form(of_frame["instances"])))
    same_detections(dmae.read(tmp_path, fps=25, format=format).detections, clip.detections)
