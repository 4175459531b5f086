"""Masks as COCO's own library reads them, and boxes by definition."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pycocotools import mask as coco_mask

from dmae.formats.labelled_images.masks import decode_mask, encode_mask, joints_box, mask_box

masks = arrays(bool, st.tuples(st.integers(1, 9), st.integers(1, 9)))


@given(masks)
def test_run_lengths_are_those_of_pycocotools(mask):
    runs = encode_mask(mask)
    read = coco_mask.frPyObjects(runs, *runs["size"])
    np.testing.assert_array_equal(coco_mask.decode(read), mask)
    np.testing.assert_array_equal(decode_mask(runs), mask)
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
