"""Colours of clothes, and people distinguished by them."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.images import Images, write_video
from dmae.data.skeleton import BODY25
from dmae.reconstruction.appearance import TorsoColours
from dmae.reconstruction.config import AssociationConfig, CaptureConfig, ComparedJoints
from dmae.reconstruction.pipeline import capture
from tests.support.clips import looking_at_origin
from tests.support.detected_people import FPS, detected_clip, errors, rows_of, walk

DEFAULT = CaptureConfig()


def paint(clip: Clip, people: np.ndarray, colours: list[tuple], folder) -> Images:
    """Videos of plain torsos on grey."""
    pixels = clip.rig.project(people[:, :, BODY25.index("l_shoulder", "r_shoulder", "l_hip", "r_hip")])[0]
    for view, name in enumerate(clip.rig.names):

        def frames(view=view):
            for corners in pixels[:, view]:
                image = np.full((600, 960, 3), 120, np.uint8)
                for person in np.flatnonzero(np.isfinite(corners).all((1, 2))):
                    left, top = corners[person].min(0).astype(int)
                    right, bottom = corners[person].max(0).astype(int)
                    image[top - 9 : bottom + 9, left - 9 : right + 9] = colours[person]
                yield image

        write_video(folder / "rgb" / f"{name}.mp4", frames(), clip.fps)
    return Images(folder, clip.rig.names, tuple(range(len(clip))), ("rgb",))


@pytest.fixture
def painted(tmp_path) -> Clip:
    """Two cameras at hip height; a person in red, the first detection of each view, and one in blue, the second.

    The rays of the red person's hips in one view and of the blue person's in the other view meet.
    """
    rig = looking_at_origin(8)[[0, 2]]
    level = np.array([[[0, 1, 0], [0, 0, -1], [-1, 0, 0]], [[-1, 0, 0], [0, 0, -1], [0, -1, 0.0]]])
    T = np.tile(np.eye(4), (2, 1, 1))
    T[:, :3, :3], T[:, :3, 3] = level, -np.einsum("vij,vj->vi", level, [[6, 0, 0.95], [0, 6, 0.95]])
    rig = replace(rig, cam_from_world=T)
    people = np.stack([walk((0.1, 0), (0.1, 0), frames=10), walk((1.0, 0.8), (1.0, 0.8), frames=10)], 1)
    xy = rig.project(people)[0]
    score = np.full(xy.shape[:-1], 0.9)
    clip = Clip("painted", FPS, rig, Detections2D(BODY25, xy, score), truth=Poses3D(BODY25, people))
    return replace(clip, images=paint(clip, people, [(200, 40, 40), (40, 60, 200)], tmp_path))


def test_torso_colours_are_those_of_the_clothes(painted):
    torso_colours = TorsoColours(painted)
    colours = np.stack([torso_colours(frame) for frame in range(10)])
    red, blue = [53.2, 62.5, 40.4], [32.5, 30.6, -65.4]  # CIELAB of what was painted
    np.testing.assert_allclose(colours[..., 0, :], np.broadcast_to(red, (10, 2, 3)), atol=15)
    np.testing.assert_allclose(colours[..., 1, :], np.broadcast_to(blue, (10, 2, 3)), atol=15)


def test_colours_of_frames_in_any_order_are_the_same(painted):
    every, some = TorsoColours(painted), TorsoColours(painted)
    colours = [every(frame) for frame in range(10)]
    for frame in (2, 3, 7, 5):
        np.testing.assert_array_equal(some(frame), colours[frame])


def test_a_detection_without_a_torso_in_the_image_has_no_colour(painted):
    torso = BODY25.index("neck", "mid_hip", "l_shoulder", "r_shoulder", "l_hip", "r_hip")
    painted.detections.xy[3, 1, 0, torso], painted.detections.score[3, 1, 0, torso] = np.nan, np.nan
    painted.detections.xy[4, 1, 0] += 5000
    torso_colours = TorsoColours(painted)
    colours = np.stack([torso_colours(frame) for frame in range(10)])
    assert np.isnan(colours).any(-1).sum() == 2
    assert np.isnan(colours[3:5, 1, 0]).all()


@pytest.mark.parametrize("swapped", [False, True])
def test_colours_resolve_what_the_rays_of_hips_leave_ambiguous(painted, swapped):
    order = [1, 0] if swapped else [0, 1]
    xy, score = painted.detections.xy.copy(), painted.detections.score
    xy[:, 1] = xy[:, 1, order]
    clip = replace(painted, detections=Detections2D(BODY25, xy, score))
    hips = replace(DEFAULT, association=AssociationConfig(joints=ComparedJoints.mid_hip, min_affinity=0.25))
    assert sorted(rows_of(capture(clip, hips), clip.truth.xyz)) == [[0], [1]]
    assert np.nanmax(errors(capture(clip, hips), clip.truth.xyz)) < 0.01


@pytest.mark.parametrize("coloured", [True, False])
def test_a_re_entry_is_recognised_by_the_colour_of_clothes(tmp_path, coloured):
    """Two people of one build leave, and each re-enters where the other left: only clothes distinguish them."""
    people = np.stack([walk((-0.4, 0), (-0.4, 0)), walk((0.4, 0.1), (0.4, 0.1))], 1)
    people[60:] = people[60:, ::-1]
    people[40:60] = np.nan
    clip = detected_clip(people, views=4)
    if coloured:
        clip = replace(clip, images=paint(clip, people, [(200, 40, 40), (40, 60, 200)], tmp_path))
    # Distance alone confuses them.
    rows = rows_of(capture(clip, DEFAULT), people)
    assert sorted(rows) == ([[0], [1]] if coloured else [[0, 1], [1, 0]])
