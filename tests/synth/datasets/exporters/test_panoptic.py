"""Sequences of CMU Panoptic, read back by the reader of such recordings."""

import cv2
import numpy as np

from dmae.data.conversion import convert
from dmae.data.skeleton import PANOPTIC19
from dmae.data.store import load_clip
from dmae.formats import panoptic
from dmae.formats.calibrations import read_calibration


def test_poses_cameras_and_pictures_are_those_of_the_clip(exported, data):
    out = exported("panoptic", workers=2)
    for split, name in (("train", "000000"), ("train", "000001"), ("validation", "000002")):
        clip, folder = load_clip(data / name), out / split / name
        found = panoptic.read_poses(folder)
        assert sorted(found.xyz) == [5, 6, 7]
        np.testing.assert_allclose(np.stack(list(found.xyz.values())), convert(clip.truth, PANOPTIC19).xyz, atol=1e-5)
        rig = read_calibration(folder)
        assert rig.names == ("00_00", "00_01")
        np.testing.assert_allclose(rig.projections, clip.rig.projections, atol=1e-6)
        for view, camera in enumerate(rig.names):
            for frame, colour in enumerate(clip.images.read("rgb", clip.rig.names[view])):
                picture = cv2.imread(str(folder / "hdImgs" / camera / f"{camera}_{5 + frame:08d}.jpg"))
                assert np.abs(picture[..., ::-1].astype(int) - colour).mean() < 3
