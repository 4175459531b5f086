"""Covariances of joints in the image: estimated from scattered points, and read from files."""

import json
from dataclasses import replace

import numpy as np

import dmae
from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.skeleton import BODY25
from dmae.formats.recordings.pixel_covariances import covariance_entry, pixel_covariances
from tests.support.circling_people import circling_people
from tests.support.faulty_recordings import lenses

FACTOR = np.array([[0.02, 0, 0], [0.01, 0.01, 0], [-0.005, 0, 0.015]])


def poses() -> Poses3D:
    truth = circling_people(2, 1, rng=np.random.default_rng(0))
    cov = np.broadcast_to(FACTOR @ FACTOR.T, (2, 1, 25, 3, 3)).copy()
    cov[0, 0, 3] = np.nan
    return Poses3D(BODY25, truth.xyz, cov=cov)


def test_they_are_the_scatter_of_reprojected_points():
    rig, known = lenses(), poses()
    found = pixel_covariances(known, rig)
    assert np.isnan(found[0, :, 0, 3]).all()
    scatter = np.random.default_rng(1).normal(size=(4000, 3)) @ FACTOR.T
    xy = rig.project(known.xyz[1, 0, 4] + scatter)[0]
    for view in range(len(rig)):
        expected = np.cov(xy[:, view], rowvar=False)
        size = np.trace(expected)
        np.testing.assert_allclose(found[1, view, 0, 4], expected[np.triu_indices(2)], atol=0.06 * size)
    assert pixel_covariances(replace(known, cov=None), rig) is None


def test_entries_have_null_where_nothing_is_known():
    assert covariance_entry(np.array([[1, 0.00004, 2], [np.nan] * 3])) == [[1.0, 0.0, 2.0], None]


def test_files_of_coco_and_openpose_hold_them(tmp_path):
    rig, known = lenses(), poses()
    nothing = np.full((2, len(rig), 0, 25), np.nan)
    clip = Clip("one", 25.0, rig, Detections2D(BODY25, np.stack([nothing] * 2, -1), nothing), poses=known)
    expected = covariance_entry(pixel_covariances(known, rig)[1, 2, 0])
    dmae.export(clip, tmp_path / "coco.json", format="coco")
    content = json.loads((tmp_path / "coco.json").read_text())
    image = next(each["id"] for each in content["images"] if (each["camera"], each["frame"]) == (rig.names[2], 1))
    (annotation,) = [each for each in content["annotations"] if each["image_id"] == image]
    assert annotation["joint_covariance"] == expected
    dmae.export(clip, tmp_path / "openpose", format="openpose")
    file = next((tmp_path / "openpose" / rig.names[2]).glob("*_000000000001_keypoints.json"))
    assert json.loads(file.read_text())["people"][0]["joint_covariance"] == expected
