from dataclasses import replace

import numpy as np
import pytest

from dmae.data.labels import DetectionLabels, OcclusionLabels, Visibility
from tests.support.clips import full_clip


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"visibility": np.zeros((12, 4, 2))}, r"OcclusionLabels.visibility: expected shape \(F, V, P, J\)"),
        ({"occluder": np.zeros((12, 4, 3, 25))}, r"OcclusionLabels.occluder: expected shape \(12, 4, 2, 25\)"),
        ({"depth_margin": np.zeros((12, 4, 2))}, r"OcclusionLabels.depth_margin: expected shape \(12, 4, 2, 25\)"),
        ({"amodal_pixels": np.zeros((12, 4, 3))}, r"OcclusionLabels.amodal_pixels: expected shape \(12, 4, 2\)"),
    ],
)
def test_occlusion_labels_of_other_shapes_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(full_clip().occlusion, **changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"person": np.zeros((12, 4))}, r"DetectionLabels.person: expected shape \(F, V, D\)"),
        ({"error": np.zeros((12, 4, 3, 25))}, r"DetectionLabels.error: expected shape \(12, 4, 2, J\)"),
        ({"offset_px": np.zeros((12, 4, 2))}, r"DetectionLabels.offset_px: expected shape \(12, 4, 2, J\)"),
    ],
)
def test_detection_labels_of_other_shapes_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(full_clip().detection_labels, **changes)


def test_visible_views_are_the_number_of_cameras_that_see_a_joint():
    labels = full_clip().occlusion
    assert labels.visible_views.shape == (12, 2, 25)
    seen = [labels.visibility[3, view, 1, 5] == Visibility.VISIBLE for view in range(4)]
    assert labels.visible_views[3, 1, 5] == sum(seen)


def test_visible_fraction_is_the_part_of_a_person_that_is_not_hidden():
    labels = full_clip().occlusion
    assert (labels.visible_fraction == 0.75).all()
    outside = replace(labels, visible_pixels=np.zeros((12, 4, 2)), amodal_pixels=np.zeros((12, 4, 2)))
    assert np.isnan(outside.visible_fraction).all()
    assert replace(labels, amodal_pixels=None).visible_fraction is None


def test_select_cuts_known_arrays_and_leaves_the_others_unknown():
    labels = OcclusionLabels(full_clip().occlusion.visibility, objects=("box",)).select([7, 2], [3])
    assert labels.visibility.shape == (2, 1, 2, 25)
    assert labels.occluder is None
    assert labels.objects == ("box",)
    assert DetectionLabels(np.zeros((12, 4, 2))).select(views=[0, 1]).person.shape == (12, 2, 2)
