"""Drawings of a clip show the right joints, at the right places, in the right colours and shapes."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.labels import Visibility
from dmae.data.skeleton import BODY25, SHELF14, fuse
from dmae.viewing.config import LayersConfig
from dmae.viewing.overlay import (
    COLOURS,
    DETECTED,
    MEANINGS,
    RED,
    TRUE,
    Overlay,
    chosen_layers,
    first_joints,
    floor_of,
    occluder_name,
    occlusion_summary,
    person_colour,
)
from dmae.viewing.show import header, write_sheet
from tests.support.clips import full_clip
from tests.support.shown_clips import captured_clip, near, occluded_clip

VISIBLE, SELF, PERSON, OBJECT = list(Visibility)[:4]
BLACK = np.zeros((480, 640, 3), np.uint8)


def overlay(clip, width: int = 640, **layers) -> Overlay:
    return Overlay(clip, width, chosen_layers(clip, LayersConfig(**layers)))


def tile(clip, frame: int = 0, view: int = 0, **layers) -> np.ndarray:
    return overlay(clip, **layers).tiles(frame, [BLACK] * len(clip.rig))[view][:480]


def test_true_joints_are_drawn_in_the_colour_of_their_occlusion():
    clip = occluded_clip()
    drawn = tile(clip)
    xy, _ = clip.rig.project(clip.truth.xyz)
    right = 0
    for person in range(2):
        for joint in range(25):
            column, row = np.round(xy[0, 0, person, joint]).astype(int)
            right += near(drawn, COLOURS[Visibility(clip.occlusion.visibility[0, 0, person, joint])])[row, column]
    # Marks may cover each other.
    assert right >= 42
    assert not near(drawn[:, :320], COLOURS[OBJECT]).any()
    # Joints of the second skeleton are not drawn.
    assert first_joints(clip.truth) == list(range(25))
    assert len(Overlay.bones(clip.truth)) == 24


def test_occluders_are_named():
    clip = occluded_clip()
    assert [occluder_name(clip, 0, 0, 1, joint) for joint in range(3)] == ["itself", "P1", "shelf"]
    assert occluder_name(clip, 0, 0, 0, 0) == ""
    joints = list(range(25))
    assert sorted(occlusion_summary(clip, 0, 0, 1, joints)) == sorted(
        [("0 seen", COLOURS[VISIBLE]), ("9 behind itself", COLOURS[SELF]), ("8 behind P1", COLOURS[PERSON]),
         ("8 behind shelf", COLOURS[OBJECT])]
    )  # fmt: skip
    assert occlusion_summary(clip, 2, 0, 1, joints)[0][0] == "absent"


def test_measured_joints_have_their_person_s_colour_and_completed_ones_are_red():
    clip = captured_clip()
    drawn = tile(clip)
    xy, _ = clip.rig.project(clip.poses.xyz)
    hits = {True: 0, False: 0}
    for person in range(2):
        for joint in range(25):
            column, row = np.round(xy[0, 0, person, joint]).astype(int)
            completed = clip.poses.source[0, person, joint] == Source.COMPLETED
            hits[completed] += near(drawn, RED if completed else person_colour(person))[row, column]
    assert hits[True] >= 6 and hits[False] >= 30


def test_people_keep_their_colour_in_every_view_and_frame():
    clip = captured_clip(views=3)
    for frame in range(3):
        for view in range(3):
            drawn = tile(clip, frame, view, detections=False)
            # The first person is at the left, the second at the right.
            assert near(drawn[:, :300], person_colour(0)).any() and not near(drawn[:, 340:], person_colour(0)).any()
            assert near(drawn[:, 340:], person_colour(1)).any() and not near(drawn[:, :300], person_colour(1)).any()


@pytest.mark.parametrize(
    ("layers", "shown", "hidden"),
    [
        ({"measured": False}, RED, person_colour(0)),
        ({"completed": False}, person_colour(0), RED),
        ({"detections": True, "measured": False, "completed": False}, DETECTED, person_colour(0)),
        ({"detections": False}, RED, DETECTED),
        ({"truth": True}, TRUE, None),
        ({"truth": False}, person_colour(1), TRUE),
    ],
    ids=str,
)
def test_layers_are_toggled(layers, shown, hidden):
    # Text is left out: the camera's name has the colour of the truth, and so have the numbers of people.
    drawn = tile(captured_clip(), **layers)[200:]
    assert near(drawn, shown).any()
    assert hidden is None or not near(drawn, hidden).any()


def test_completed_joints_have_another_shape():
    """Squares fill their corners; a reader who does not see red still sees them."""
    clip = captured_clip()
    joint = int(np.flatnonzero(clip.poses.source[0, 0] == Source.COMPLETED)[0])
    alone = np.full(clip.poses.source.shape, True)
    alone[:, 0, joint] = False
    square = replace(clip, poses=clip.poses.without(alone))
    source = np.where(square.poses.source == Source.COMPLETED, Source.MEASURED, square.poses.source)
    disc = replace(clip, poses=replace(square.poses, source=source))
    xy, _ = clip.rig.project(clip.poses.xyz[:1, :1, joint])
    x, y = np.round(xy[0, 0, 0]).astype(int)
    areas = [
        near(tile(each, detections=False)[y - 6 : y + 7, x - 6 : x + 7], colour).sum()
        for each, colour in ((square, RED), (disc, person_colour(0)))
    ]
    assert areas[0] > 1.15 * areas[1] > 0


def test_what_a_clip_has_is_shown_by_default():
    simulated, captured = occluded_clip(), captured_clip()
    layers = chosen_layers(simulated, LayersConfig())
    assert (layers.truth, layers.occlusion, layers.poses, layers.detections) == (True, True, False, False)
    layers = chosen_layers(captured, LayersConfig())
    assert (layers.truth, layers.occlusion, layers.poses, layers.detections) == (False, False, True, True)
    bare = chosen_layers(replace(captured, poses=None, truth=None), LayersConfig(truth=True))
    assert (bare.truth, bare.poses, bare.detections) == (False, False, True)
    assert bare.lacking == ("images", "poses", "truth")


def test_a_clip_of_nothing_is_drawn_as_empty_views(tmp_path):
    clip = captured_clip()
    nothing = np.full_like(clip.detections.xy, np.nan)
    clip = replace(clip, detections=replace(clip.detections, xy=nothing, score=nothing[..., 0]), poses=None, truth=None)
    layers = chosen_layers(clip, LayersConfig())
    assert layers.lacking == ("images", "poses", "detections")
    write_sheet(clip, tmp_path / "a.png", layers, width=200)
    assert cv2.imread(str(tmp_path / "a.png")).std() > 5


def test_the_legend_is_complete_at_any_width():
    shown = overlay(occluded_clip(), 160)
    wide, narrow = header(shown, 1600), header(shown, 332)
    assert narrow.shape[0] > wide.shape[0]
    for cause in MEANINGS:
        assert near(narrow, COLOURS[cause]).sum() == pytest.approx(near(wide, COLOURS[cause]).sum(), abs=20)
    captured = header(overlay(captured_clip(), truth=True), 900)
    for colour in (RED, DETECTED, TRUE, person_colour(0), person_colour(1)):
        assert near(captured, colour).sum() > 20


def test_joints_far_outside_a_image_are_left_out():
    clip = captured_clip()
    xyz = clip.poses.xyz.copy()
    xyz[:, 0, BODY25.index("l_wrist")[0]] = (-3.999, 3, 1)
    far = replace(clip, poses=replace(clip.poses, xyz=xyz))
    assert tile(far).shape == (480, 640, 3)


def test_only_joints_that_are_drawn_are_counted():
    clip = captured_clip()
    both = [clip.poses, convert(clip.poses, SHELF14)]
    xyz, source = (np.concatenate([getattr(each, name) for each in both], 2) for name in ("xyz", "source"))
    fused = replace(clip, poses=Poses3D(fuse(BODY25, SHELF14), xyz, source))
    assert overlay(fused)._counts(0, 0) == overlay(clip)._counts(0, 0)


def test_the_floor_is_drawn_where_people_are():
    """On a court with its origin in a corner, the grid lay beside people."""
    clip = replace(full_clip(), occlusion=None, detection_labels=None)
    assert floor_of(replace(clip, truth=None)).tolist() == [[-5, -5], [5, 5]]
    assert clip.truth is not None
    usual = floor_of(clip)
    xyz = clip.truth.xyz + np.array([20, 8, 0], np.float32)
    far = floor_of(replace(clip, truth=Poses3D(clip.truth.skeleton, xyz)))
    places = xyz[..., :2].reshape(-1, 2)
    assert (far[0] < np.nanmin(places, 0)).all() and (far[1] > np.nanmax(places, 0)).all()
    assert usual.tolist() == [[-5, -5], [5, 5]] and (far[1] - far[0] < 12).all()
