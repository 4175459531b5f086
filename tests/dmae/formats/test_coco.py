"""COCO keypoints, as others write them, and by ourselves."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dmae
from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.skeleton import BODY25, COCO17, HALPE26
from dmae.formats.coco import HIDDEN_SCORE, joint_names, read_detections, write_coco
from dmae.formats.recordings import to_clip
from dmae.formats.writing import write_poses, write_recording
from tests.support.clips import looking_at_origin
from tests.support.recordings import recording, same_detections
from tests.support.tracked_recordings import write_coco_results

NOSE, LEFT_WRIST = COCO17.index("nose", "l_wrist")


def keypoints(third: float = 2, absent=(LEFT_WRIST,)) -> list[float]:
    """A person of COCO's 17, joint j at (10 j + 1, 5 j + 1), flat as COCO has it."""
    return [v for j in range(17) for v in ((0, 0, 0) if j in absent else (10 * j + 1, 5 * j + 1, third))]


def plain(cameras=("a", "b"), frames=(3, 4), **image) -> dict:
    """Annotations as the COCO tools read them, one person an image, cameras told by folders."""
    images = [
        {"id": 100 * c + f, "width": 960, "height": 600, "file_name": f"{camera}/frame_{f:06d}.jpg"} | image
        for c, camera in enumerate(cameras)
        for f in frames
    ]
    annotations = [
        {"id": i, "image_id": one["id"], "category_id": 1, "iscrowd": 0, "keypoints": keypoints()}
        for i, one in enumerate(images)
    ]
    category = {"id": 1, "name": "person", "keypoints": joint_names(COCO17), "skeleton": [[16, 14], [14, 12]]}
    return {"images": images, "annotations": annotations, "categories": [category]}


def write(folder: Path, content, name: str = "keypoints.json") -> Path:
    (folder / name).write_text(json.dumps(content))
    return folder


def test_plain_annotations_of_several_cameras(tmp_path):
    found = read_detections(write(tmp_path, plain()))
    assert found.skeleton == COCO17
    assert found.sizes == {"a": (960, 600), "b": (960, 600)}
    assert found.fps is None
    assert {name: sorted(view) for name, view in found.views.items()} == {"a": [3, 4], "b": [3, 4]}
    person = found.views["b"][4][0]
    assert np.isnan(person[LEFT_WRIST]).all()
    assert person[2].tolist() == [21, 11, 1]


def test_joints_go_by_the_official_names():
    assert joint_names(COCO17)[:2] == ["nose", "left_eye"]
    assert joint_names(COCO17)[-1] == "right_ankle"


def test_hidden_joints_weigh_less_and_unlabelled_ones_nothing(tmp_path):
    content = plain()
    content["annotations"][0]["keypoints"] = keypoints(1)
    found = read_detections(write(tmp_path, content))
    assert found.views["a"][3][0][NOSE, 2] == HIDDEN_SCORE
    assert found.views["a"][4][0][NOSE, 2] == 1
    assert np.isnan(found.views["a"][3][0][LEFT_WRIST]).all()


def test_a_detector_s_confidence_in_the_place_of_v_is_kept(tmp_path):
    content = plain()
    content["annotations"][0]["keypoints"] = keypoints(0.37)
    found = read_detections(write(tmp_path, content))
    assert found.views["a"][3][0][NOSE, 2] == 0.37


def test_a_file_of_results_for_each_camera(tmp_path):
    for camera in ("cam10", "cam9"):
        results = [
            {"image_id": f"{f:05d}.jpg", "category_id": 1, "keypoints": keypoints(0.5), "score": 1} for f in (7, 9)
        ]
        write(tmp_path, results, f"{camera}.json")
    (tmp_path / "calibration.json").write_text("{}")
    found = read_detections(tmp_path)
    assert list(found.views) == ["cam9", "cam10"]
    assert sorted(found.views["cam9"]) == [7, 9]
    assert found.skeleton == COCO17


def test_crowds_and_boxes_are_no_persons(tmp_path):
    content = plain()
    content["annotations"][0]["iscrowd"] = 1
    content["annotations"][1].pop("keypoints")
    content["annotations"][2]["keypoints"] = keypoints(absent=range(17))
    found = read_detections(write(tmp_path, content))
    assert [len(people) for view in found.views.values() for people in view.values()] == [0, 0, 0, 1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.pop("annotations"), "expected lists of images and annotations"),
        (lambda c: c["images"][1].pop("file_name"), r"images\[1\]: expected an object with id and file_name"),
        (lambda c: c["images"][1].update(file_name="a/frame.jpg"), "ends in the frame number"),
        (lambda c: c["images"][1].update(file_name="4.jpg"), r"images\[1\]: nothing states the camera of 4\.jpg"),
        (lambda c: c["images"][1].update(id=3), r"images\[1\]: image 3, frame 4 of a, occurs twice"),
        (lambda c: c["images"][1].update(frame=3, file_name="a/3.jpg"), "frame 3 of a, occurs twice"),
        (lambda c: c["images"][1].update(width=1920), r"images\[1\]: expected images of .* as before of camera 'a'"),
        (lambda c: c["annotations"][2].update(image_id=999), r"annotations\[2\]: expected an object with the image_id"),
        (lambda c: c["annotations"][2].update(keypoints=[1, 2]), r"\[2\]\.keypoints: expected a list of numbers"),
        (lambda c: c["annotations"][2].update(keypoints=["x"] * 51), "expected a list of numbers"),
        (lambda c: c["annotations"][2].update(keypoints=[1] * 54), "expected people of 17 joints as in .*, found 18"),
        (lambda c: c["annotations"][2].update(keypoint_scores=[1]), "keypoint_scores: expected 17, found 1"),
        (lambda c: c["categories"][0].update(keypoints=["tail"] * 17), r"no skeleton has the keypoints \['tail'"),
        (lambda c: c.update(categories=c["categories"] * 2), "expected one category with keypoints, found 2"),
    ],
)  # fmt: skip
def test_malformed_files_are_refused_with_the_place(tmp_path, change, message):
    content = plain()
    change(content)
    with pytest.raises(ValueError, match=message) as caught:
        read_detections(write(tmp_path, content))
    assert str(tmp_path) in str(caught.value)


def test_other_bad_input_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"data\.detections=\.\.\."):
        read_detections(tmp_path)
    write(tmp_path, plain())
    with pytest.raises(ValueError, match="expected people of 26 joints as of halpe26, found 17"):
        read_detections(tmp_path, skeleton=HALPE26)
    (tmp_path / "keypoints.json").write_text(json.dumps(plain())[:-20])
    with pytest.raises(ValueError, match=r"keypoints\.json: expected JSON.*line 1 column"):
        read_detections(tmp_path)
    with pytest.raises(ValueError, match="a file for each camera"):
        read_detections(write(tmp_path, []))


@given(st.integers(1, 3), st.integers(0, 2), st.integers(0, 10**6), st.integers(0, 2**32 - 1))
def test_read_after_write_is_equal(tmp_path_factory, frames, people, first, seed):
    rng, rig = np.random.default_rng(seed), looking_at_origin(2)
    shape = (frames, 2, people, 25)
    score = np.where(rng.random(shape) < 0.3, np.nan, rng.uniform(0.01, 1, shape))
    xy = np.where(np.isnan(score)[..., None], np.nan, rng.uniform(-50, 4000, (*shape, 2)))
    path, detections = tmp_path_factory.mktemp("coco"), Detections2D(BODY25, xy, score)
    write_coco(Clip("c", 29.97, rig, detections, provenance={"first_frame": first}), path)
    found = read_detections(path / "keypoints.json")
    assert found.fps == 29.97
    assert found.skeleton == BODY25
    clip = to_clip(found, rig, found.fps, path)
    assert clip.provenance["first_frame"] == first
    same_detections(clip.detections, detections)


def test_what_is_written_is_what_coco_s_tools_ask_for(tmp_path):
    clip = recording(COCO17, 2, 2)
    xy = clip.detections.xy
    write_coco(clip, tmp_path)
    content = json.loads((tmp_path / "keypoints.json").read_text())
    assert len(content["images"]) == 4
    assert content["images"][3] == {
        "id": 4, "width": 960, "height": 600, "file_name": "cam1/000001.jpg", "camera": "cam1", "frame": 1,
    }  # fmt: skip
    (category,) = content["categories"]
    assert category["keypoints"][15:] == ["left_ankle", "right_ankle"]
    bones = {tuple(category["keypoints"][joint - 1] for joint in bone) for bone in category["skeleton"]}
    assert ("left_knee", "left_ankle") in bones
    assert len(bones) == len(COCO17.bones)
    assert len({annotation["id"] for annotation in content["annotations"]}) == 8
    for annotation in content["annotations"]:
        frame, view = divmod(annotation["image_id"] - 1, 2)
        joints = np.reshape(annotation["keypoints"], (17, 3))
        labelled = joints[:, 2] > 0
        assert annotation["num_keypoints"] == labelled.sum()
        assert (joints[~labelled] == 0).all()
        np.testing.assert_allclose(
            joints[labelled, :2], xy[frame, view, (annotation["id"] - 1) % 2][labelled], atol=1e-3
        )
        x, y, width, height = annotation["bbox"]
        np.testing.assert_allclose([x, y], joints[labelled, :2].min(0), atol=1e-9)
        np.testing.assert_allclose([x + width, y + height], joints[labelled, :2].max(0), atol=1e-9)
        assert annotation["area"] == pytest.approx(width * height, abs=1e-3)


def test_joints_that_keep_mm_leaves_out_are_not_projected(tmp_path):
    """Of two joints, one is likely off by 5 cm."""
    xyz, cov = np.full((1, 1, 25, 3), np.nan), np.full((1, 1, 25, 3, 3), np.nan)
    xyz[..., :2, :], cov[..., 0, :, :], cov[..., 1, :, :] = 0.5, 1e-6 * np.eye(3), 1e-3 * np.eye(3)
    empty = Detections2D(BODY25, np.empty((1, 4, 0, 25, 2)), np.empty((1, 4, 0, 25)))
    clip = Clip("c", 25.0, looking_at_origin(4), empty, poses=Poses3D(BODY25, xyz, cov=cov))
    counts = []
    for keep_mm in (None, 20.0):
        write_poses(clip, tmp_path / "c.json", "coco", keep_mm=keep_mm)
        entries = json.loads((tmp_path / "c.json").read_text())["annotations"]
        counts.append([entry["num_keypoints"] for entry in entries])
    assert counts == [[2] * 4, [1] * 4]


def test_results_in_a_folder_beside_a_calibration_are_recognised(tmp_path):
    clip = write_coco_results(tmp_path)
    (tmp_path / "keypoints" / "cameras.json").write_text('{"made_by": "us"}')
    same_detections(dmae.read(tmp_path, fps=25).detections, clip.detections)


def test_a_single_file_beside_one_of_cameras_stays_single(tmp_path):
    """Its images are in a folder for each camera, and the file is called after none."""
    clip = recording(COCO17, 3, 2)
    write_recording(clip, tmp_path / "walk", "coco")
    content = json.loads((tmp_path / "walk/keypoints.json").read_text())
    for image in content["images"]:
        image["file_name"] = f"{image.pop('camera')}/{image.pop('frame')}.jpg"
    (tmp_path / "walk/keypoints.json").write_text(json.dumps(content))
    (tmp_path / "walk/cameras.json").write_text('{"made_by": "us"}')
    same_detections(dmae.read(tmp_path / "walk", fps=25).detections, clip.detections)


@pytest.mark.parametrize(
    "call",
    [
        lambda skeleton: list(skeleton.joints),
        joint_names,
        lambda skeleton: [name.replace("_", " ").title() for name in joint_names(skeleton)],
    ],
)
def test_joints_of_a_category_are_read_in_every_notation(tmp_path, call):
    clip = recording(HALPE26, 3, 2)
    write_recording(clip, tmp_path / "walk", "coco")
    content = json.loads((tmp_path / "walk/keypoints.json").read_text())
    content["categories"][0]["keypoints"] = call(HALPE26)
    (tmp_path / "walk/keypoints.json").write_text(json.dumps(content))
    assert dmae.read(tmp_path / "walk", fps=25).detections.skeleton == HALPE26
