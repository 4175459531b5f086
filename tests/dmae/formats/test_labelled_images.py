"""Images with the persons in them: what images of ids show, joints and causes on another skeleton."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pycocotools import mask as coco_mask

from dmae.data.clip import Poses3D
from dmae.data.images import write_image
from dmae.data.labels import OcclusionLabels, Visibility
from dmae.data.skeleton import BODY25, COCO17
from dmae.formats.labelled_images import (
    LabelledImage,
    encode_mask,
    joint_labels,
    joints_box,
    mask_box,
    read_labelled_images,
)
from tests.support.clips import image_clip, t_pose
from tests.support.masks import decode_mask
from tests.support.recordings import recording


def test_masks_boxes_and_areas_are_what_the_ids_show(tmp_path):
    clip = image_clip(tmp_path)
    images = list(read_labelled_images(clip, joint_labels(clip, clip.truth, COCO17)))
    assert [(p.camera, p.frame, p.number) for p in images] == [(n, f, 5 + f) for n in clip.rig.names for f in range(3)]
    compared = 0
    for image in images:
        ids = list(clip.images.read("ids", image.camera))[image.frame]
        colour = list(clip.images.read("rgb", image.camera))[image.frame]
        np.testing.assert_array_equal(image.rgb, colour)
        np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(image.encoded("png"), np.uint8), 1)[..., ::-1], colour)
        for person in image.persons:
            mask = ids == 1 + person.person
            np.testing.assert_array_equal(decode_mask(person.mask), mask)
            assert person.area == person.visible_pixels == mask.sum()
            assert person.shown == mask.any()
            assert person.amodal_pixels == clip.occlusion.amodal_pixels[image.frame, image.view, person.person]
            if mask.any():
                rows, columns = np.nonzero(mask)
                x, y, width, height = person.box
                assert (x, y, x + width - 1, y + height - 1) == (columns.min(), rows.min(), columns.max(), rows.max())
            compared += 1
    assert compared == 12


def test_a_person_whom_nothing_shows_has_the_box_of_the_joints(tmp_path):
    clip = image_clip(tmp_path)
    images = list(read_labelled_images(clip, joint_labels(clip, clip.truth, BODY25)))
    (hidden,) = (p for image in images for p in image.persons if not p.shown)
    assert hidden.area == 0 and hidden.box[2] > 10
    assert not decode_mask(hidden.mask).any()


def test_amodal_masks_are_the_bits_of_the_images_of_whole_persons(tmp_path):
    clip = image_clip(tmp_path)
    bits = np.zeros((150, 240), np.uint16)
    bits[40:90, 30:60] = 1
    bits[70:100, 50:70] |= 2
    for name in clip.rig.names:
        for frame in range(3):
            write_image("ids", tmp_path / "amodal" / name / f"{frame:06d}.png", bits)
    clip = replace(clip, images=replace(clip.images, kinds=("rgb", "ids", "amodal")))
    for image in read_labelled_images(clip, joint_labels(clip, clip.truth, COCO17)):
        first, second = image.persons
        assert (first.amodal_box, second.amodal_box) == ((30, 40, 30, 50), (50, 70, 20, 30))
        np.testing.assert_array_equal(decode_mask(second.amodal_mask), bits & 2 > 0)


def test_every_other_frame(tmp_path):
    clip = image_clip(tmp_path)
    images = list(read_labelled_images(clip, joint_labels(clip, clip.truth, BODY25), every=2))
    assert [image.frame for image in images] == [0, 2] * 2
    assert images[1].persons[0].visible_pixels == clip.occlusion.visible_pixels[2, 0, 0]


def test_poses_that_are_not_the_truth_have_no_masks(tmp_path):
    """Tracks are in no relation to the persons of the ids."""
    clip = image_clip(tmp_path)
    clip = replace(clip, poses=Poses3D(BODY25, clip.truth.xyz[:, ::-1]))
    for image in read_labelled_images(clip, joint_labels(clip, clip.poses, BODY25)):
        for person in image.persons:
            assert person.mask is person.visible_pixels is person.cause is None
            low = person.xy[person.flags > 0].min(0)
            np.testing.assert_allclose(person.box[:2], low, atol=1e-3)


def test_the_file_of_a_image_stays_in_its_folder():
    names = {"../../up": "%2E%2E%2F%2E%2E%2Fup", "/etc": "%2Fetc", "..": "%2E%2E", "": "%", "cam-1_b": "cam-1_b"}
    for camera, part in names.items():
        assert LabelledImage(camera, 0, 0, 7, (4, 3), []).path == f"{part}/000007"


def test_an_image_of_another_size_is_named(tmp_path):
    clip = image_clip(tmp_path)
    larger = replace(clip, rig=replace(clip.rig, size=clip.rig.size + 2))
    with pytest.raises(ValueError, match=r"rgb of camera cam0, frame 0: expected 242 x 152 px, found 240 x 150"):
        next(read_labelled_images(larger, joint_labels(larger, larger.truth, BODY25)))


def test_a_derived_joint_is_hidden_by_what_hides_the_least_visible_of_its_joints():
    truth = Poses3D(COCO17, t_pose(COCO17)[None, None] * 0.5)
    visibility = np.full((1, 4, 1, 17), Visibility.VISIBLE)
    occluder = np.full(visibility.shape, -1)
    hip = COCO17.index("l_hip")[0]
    visibility[0, 2, 0, hip], occluder[0, 2, 0, hip] = Visibility.HIDDEN_BY_OBJECT, 4
    clip = replace(recording(COCO17, 1), truth=truth, occlusion=OcclusionLabels(visibility, occluder))
    found = joint_labels(clip, truth, BODY25)
    joints = BODY25.index("mid_hip", "l_hip", "r_hip", "neck", "l_big_toe")
    seen, behind, absent = Visibility.VISIBLE, Visibility.HIDDEN_BY_OBJECT, Visibility.ABSENT
    assert found.cause[0, 2, 0, joints].tolist() == [behind, behind, seen, seen, absent]
    assert found.occluder[0, 2, 0, joints].tolist() == [4, 4, -1, -1, -1]
    assert found.cause[0, 1, 0, joints].tolist() == [seen, seen, seen, seen, absent]


# Masks as COCO's own library reads them, and boxes by definition.

masks = arrays(bool, st.tuples(st.integers(1, 9), st.integers(1, 9)))


@given(masks)
def test_run_lengths_are_those_of_pycocotools(mask):
    runs = encode_mask(mask)
    read = coco_mask.frPyObjects(runs, *runs["size"])
    np.testing.assert_array_equal(coco_mask.decode(read), mask)
    assert coco_mask.encode(np.asfortranarray(mask, np.uint8))["counts"] == read["counts"]
    if mask.any():
        assert list(mask_box(mask)) == coco_mask.toBbox(read).tolist()
        assert coco_mask.area(read) == mask.sum()
    else:
        assert mask_box(mask) is None


def test_a_box_of_joints_is_of_labelled_ones():
    xy = np.array([[1.0, 5.0], [4.0, 2.5], [np.nan, np.nan], [90.0, 90.0]])
    assert joints_box(xy, np.array([True, True, False, False])) == pytest.approx((1, 2.5, 3, 2.5))
    assert joints_box(xy, np.zeros(4, bool)) is None
