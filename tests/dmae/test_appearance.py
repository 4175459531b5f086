"""What people look like, and who is who by it."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.appearance import Looks
from dmae.capture import CaptureConfig, capture
from dmae.clip import Clip, Detections2D, Poses3D
from dmae.identify import Joints
from dmae.images import Images, write_video
from dmae.skeleton import BODY25

from .examples import looking_at_origin
from .film import FPS, errors, film, rows_of, walk

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
    """Two cameras at hip height and two people, one in red and one in blue, first and second detection of each view.

    The hips of the one in one view and of the other in the other view are on rays that meet.
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


def test_looks_are_the_colours_of_clothes(painted):
    looks = Looks(painted)
    colours = np.stack([looks(frame) for frame in range(10)])
    red, blue = [53.2, 62.5, 40.4], [32.5, 30.6, -65.4]  # CIELAB of what was painted
    np.testing.assert_allclose(colours[..., 0, :], np.broadcast_to(red, (10, 2, 3)), atol=15)
    np.testing.assert_allclose(colours[..., 1, :], np.broadcast_to(blue, (10, 2, 3)), atol=15)


def test_looks_of_some_frames_are_those_of_all(painted):
    every, some = Looks(painted), Looks(painted)
    colours = [every(frame) for frame in range(10)]
    for frame in (2, 3, 7):
        np.testing.assert_array_equal(some(frame), colours[frame])
    with pytest.raises(ValueError, match="frame 7 is over, the next is 8"):
        some(7)


def test_who_has_no_torso_has_no_looks(painted):
    torso = BODY25.index("neck", "mid_hip", "l_shoulder", "r_shoulder", "l_hip", "r_hip")
    painted.detections.xy[3, 1, 0, torso], painted.detections.score[3, 1, 0, torso] = np.nan, np.nan
    painted.detections.xy[4, 1, 0] += 5000
    looks = Looks(painted)
    colours = np.stack([looks(frame) for frame in range(10)])
    assert np.isnan(colours).any(-1).sum() == 2
    assert np.isnan(colours[3:5, 1, 0]).all()


@pytest.mark.parametrize("swapped", [False, True])
def test_colours_tell_apart_whom_hips_cannot(painted, swapped):
    order = [1, 0] if swapped else [0, 1]
    xy, score = painted.detections.xy.copy(), painted.detections.score
    xy[:, 1] = xy[:, 1, order]
    clip = replace(painted, detections=Detections2D(BODY25, xy, score))
    hips = replace(DEFAULT, matching=Joints.mid_hip, th_a=0.25)
    assert sorted(rows_of(capture(clip, hips), clip.truth.xyz)) == [[0], [1]]
    assert np.nanmax(errors(capture(clip, hips), clip.truth.xyz)) < 0.01


@pytest.mark.parametrize("coloured", [True, False])
def test_who_comes_back_is_told_by_the_colour_of_clothes(tmp_path, coloured):
    """Two of one build leave, and come back each where the other has left: only their clothes say who is who."""
    people = np.stack([walk((-0.4, 0), (-0.4, 0)), walk((0.4, 0.1), (0.4, 0.1))], 1)
    people[60:] = people[60:, ::-1]
    people[40:60] = np.nan
    clip = film(people, views=4)
    if coloured:
        clip = replace(clip, images=paint(clip, people, [(200, 40, 40), (40, 60, 200)], tmp_path))
    # Nearness alone takes the one for the other.
    rows = rows_of(capture(clip, DEFAULT), people)
    assert sorted(rows) == ([[0], [1]] if coloured else [[0, 1], [1, 0]])
