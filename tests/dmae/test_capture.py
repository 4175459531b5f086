"""Capture of made-up people, of whom everything is known, and of the Shelf recording."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from omegaconf import OmegaConf

from dmae.appearance import Looks
from dmae.baselines import fill_linear, smooth
from dmae.cameras import CameraRig
from dmae.capture import CaptureConfig, capture
from dmae.clip import Clip, Detections2D, Poses3D, Source
from dmae.identify import Joints
from dmae.images import Images, write_video
from dmae.mapping import convert
from dmae.metrics import correct_limbs, idf1, match, percent, take_matched
from dmae.resources import resource_folder
from dmae.skeleton import BODY25, SHELF14

from .examples import looking_at_origin, t_pose

FPS = 25.0
FRAMES = 100
DEFAULT = CaptureConfig()
PAPER = CaptureConfig(**OmegaConf.load(resource_folder("dmae", "configs") / "capture" / "paper.yaml"))


def walk(start: tuple, end: tuple, scale: float = 1.0, heading: float = 0.0, frames: int = FRAMES) -> np.ndarray:
    """(F, 25, 3) somebody with hanging, swinging arms, of a size and heading, on a straight way."""
    body = t_pose()
    for side, sign in (("l", 1), ("r", -1)):
        body[BODY25.index(f"{side}_elbow", f"{side}_wrist")] = (0, 0.24 * sign, 1.17), (0.05, 0.25 * sign, 0.92)
    cos, sin = np.cos(heading), np.sin(heading)
    xyz = np.tile(scale * body @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]), (frames, 1, 1))
    swing = 0.12 * np.sin(2 * np.pi * np.arange(frames) / FPS)[:, None] * (cos, sin, 0)
    xyz[:, BODY25.index("l_wrist")[0]] += swing
    xyz[:, BODY25.index("r_wrist")[0]] -= swing
    xyz[..., :2] += np.linspace(start, end, frames)[:, None]
    return xyz


def film(
    people: np.ndarray,
    views: int = 4,
    miss: float = 0.1,
    noise: float = 3.0,
    seed: int = 0,
    rig: CameraRig | None = None,
) -> Clip:
    """Detections of people (F, P, 25, 3), NaN where away: off by some pixels, some missed, in random order."""
    rng = np.random.default_rng(seed)
    rig = rig or looking_at_origin(views)
    xy = rig.project(people)[0]
    xy = xy + rng.normal(0, noise, xy.shape)
    xy[~rig.inside(xy) | (rng.random(xy.shape[:-1]) < miss)] = np.nan
    score = np.where(np.isnan(xy[..., 0]), np.nan, rng.uniform(0.6, 0.95, xy.shape[:-1]))
    order = rng.permuted(np.tile(np.arange(xy.shape[2]), (*xy.shape[:2], 1)), axis=-1)[..., None]
    detections = Detections2D(BODY25, np.take_along_axis(xy, order[..., None], 2), np.take_along_axis(score, order, 2))
    return Clip("made up", FPS, rig, detections, truth=Poses3D(BODY25, people))


@cache
def crossing() -> np.ndarray:
    """(F, 3, 25, 3) three people who cross each other's ways."""
    ways = [((-1.5, 0), (1.5, 0.2), 1, 0), ((1.5, -0.3), (-1.5, 0.7), 1.06, 3), ((0, -1.5), (0.4, 1.5), 0.9, 1.6)]
    return np.stack([walk(*way) for way in ways], 1)


def rows_of(poses: Poses3D, people: np.ndarray) -> list[list[int]]:
    """For each true person the rows it was captured in, in the order of time."""
    matches = match(poses.xyz, people)
    changes = [np.flatnonzero(np.diff(row, prepend=-2)) for row in (person[person >= 0] for person in matches.T)]
    return [person[person >= 0][change].tolist() for person, change in zip(matches.T, changes, strict=True)]


def errors(poses: Poses3D, people: np.ndarray) -> np.ndarray:
    """(F, P, J) m; NaN where absent or nobody is there."""
    return np.linalg.norm(take_matched(poses.xyz, match(poses.xyz, people)) - people, axis=-1)


@pytest.mark.parametrize("views", [3, 4, 7])
def test_people_who_cross_keep_their_rows(views):
    poses = capture(film(crossing(), views), DEFAULT)
    assert sorted(rows_of(poses, crossing())) == [[0], [1], [2]]
    off = errors(poses, crossing())
    assert np.nanmedian(off) < 0.03
    assert np.nanquantile(off, 0.99) < 0.1
    assert np.isfinite(off).mean() > 0.95


def test_a_huddle_of_six_keeps_who_is_who():
    """They meet within 0.6 m and part again; of each person a fifth of the views sees nothing for half a second."""
    angle = np.arange(6) * np.pi / 3
    out, near = (radius * np.stack([np.cos(angle), np.sin(angle)], -1) for radius in (1.8, 0.6))
    ways = [
        np.concatenate([walk(a, b, heading=h, frames=50), walk(b, a, heading=h, frames=50)])
        for a, b, h in zip(out, near, angle, strict=True)
    ]
    people = np.stack(ways, 1)
    clip = film(people, views=5, miss=0.1)
    blind = np.random.default_rng(0).random((8, 5, 6)) < 0.2
    blind = np.repeat(blind, 13, 0)[:FRAMES]
    clip.detections.xy[blind], clip.detections.score[blind] = np.nan, np.nan
    assert idf1(capture(clip, DEFAULT).xyz, people) > 98


def test_absent_is_absent_and_measured_is_measured():
    poses = capture(film(crossing(), miss=0.4), DEFAULT)
    absent = np.isnan(poses.xyz).any(-1)
    assert 0.02 < absent.mean() < 0.5
    assert (poses.source[absent] == Source.ABSENT).all()
    assert (poses.source[~absent] == Source.MEASURED).all()
    assert (poses.views[absent] == 0).all()
    assert (poses.views[~absent] >= 2).all()
    assert np.isnan(poses.cov[absent]).all()
    assert (np.linalg.eigvalsh(poses.cov[~absent]) > 0).all()


def test_who_leaves_and_soon_comes_back_is_the_same_and_shifts_nobody():
    people = crossing().copy()
    people[30:62, 1] = np.nan
    poses = capture(film(people), DEFAULT)
    assert sorted(rows_of(poses, people)) == [[0], [1], [2]]
    assert np.isnan(poses.xyz[40:60, rows_of(poses, people)[1][0]]).all()


def test_who_comes_back_late_or_far_off_is_new_and_shifts_nobody():
    people = crossing().copy()
    people[20:85, 1] = np.nan
    rows = rows_of(capture(film(people), DEFAULT), people)
    assert len(rows[1]) == 2
    assert len(rows[0]) == len(rows[2]) == 1
    assert sorted({row for person in rows for row in person}) == [0, 1, 2, 3]


def test_a_stranger_who_comes_when_another_left_is_somebody_else():
    people = np.stack([walk((-1.5, 0), (1.5, 0)), walk((0, 1), (0, 1)), walk((0.3, 1), (0.3, 1), 0.7)], 1)
    people[50:, 1] = np.nan
    people[:65, 2] = np.nan
    rows = rows_of(capture(film(people, miss=0), DEFAULT), people)
    assert sorted(rows) == [[0], [1], [2]]


def test_ghosts_of_single_views_and_fragments_are_nobody():
    """In each view a false person at a fixed place; of the true ones legs that hang on nobody, every third frame."""
    clip = film(crossing())
    rng = np.random.default_rng(1)
    xy, score = clip.detections.xy, clip.detections.score
    ghost = rng.uniform(300, 600, (1, 4, 1, 25, 2)) + rng.normal(0, 2, (FRAMES, 4, 1, 25, 2))
    fragment = np.full_like(xy[:, :, :1], np.nan)
    legs = BODY25.index("r_knee", "r_ankle", "r_heel", "r_big_toe", "r_small_toe")
    fragment[::3, :, 0, legs] = xy[::3, :, 0][..., legs, :]
    xy[::3, :, 0][..., legs, :] = np.nan
    xy = np.concatenate([xy, ghost, fragment], 2)
    score = np.concatenate([score, np.full((FRAMES, 4, 2, 25), 0.6)], 2)
    score[np.isnan(xy[..., 0])] = np.nan
    xy[np.isnan(score)] = np.nan
    poses = capture(replace(clip, detections=Detections2D(BODY25, xy, score)), DEFAULT)
    assert poses.xyz.shape[1] == 3
    assert sorted(rows_of(poses, crossing())) == [[0], [1], [2]]
    found = np.isfinite(errors(poses, crossing()))
    assert found[::3, :, legs].mean() > 0.9 * found[1::3, :, legs].mean()


def test_a_joint_that_jumps_to_a_neighbour_is_dropped_not_believed():
    """For two frames every view takes one's left wrist for that of another, who stands 0.6 m off."""
    people = np.stack([walk((-0.3, 0), (-0.3, 0)), walk((0.3, 0), (0.3, 0))], 1)
    wrong = people.copy()
    wrist = BODY25.index("l_wrist")[0]
    wrong[50:52, 0, wrist] = people[50:52, 1, wrist]
    poses = capture(film(wrong, miss=0), DEFAULT)
    off = errors(poses, people)[:, 0, wrist]
    assert np.isnan(off[50:52]).all()
    assert np.isfinite(off[[48, 49, 52, 53]]).all()


def test_what_is_unsure_counts_where_it_is_expected():
    """A wrist of confidence 0.15, below th_p, in two of four views for some frames: the second pass takes it."""
    people = crossing()[:, :1]
    clip = film(people, miss=0, views=4)
    wrist = BODY25.index("r_wrist")[0]
    score = clip.detections.score
    score[40:44, :2, :, wrist], score[40:44, 2:, :, wrist] = 0.15, np.nan
    clip.detections.xy[40:44, 2:, :, wrist] = np.nan
    assert np.isfinite(errors(capture(clip, DEFAULT), people)[40:44, 0, wrist]).all()
    assert np.isnan(errors(capture(clip, replace(DEFAULT, reach=0)), people)[40:44, 0, wrist]).all()


def test_the_paper_wants_three_views_of_a_joint():
    clip = film(crossing(), views=5)
    poses = capture(clip, PAPER)
    known = poses.views > 0
    assert (poses.views[known] >= 3).all()
    assert np.nanmedian(errors(poses, crossing())) < 0.03
    assert capture(clip.select(views=[0, 1]), PAPER).xyz.shape[1] == 0


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


def test_a_fisheye_measures_what_a_pinhole_does():
    rig = looking_at_origin(4)
    bent = replace(rig, dist=np.tile([0.04, -0.01, 0.002, 0, 0], (4, 1)), fisheye=np.ones(4, bool))
    poses = [capture(film(crossing(), rig=lenses, noise=1.0), DEFAULT) for lenses in (rig, bent)]
    off = [np.nanmedian(errors(each, crossing())) for each in poses]
    assert off[1] < 1.2 * off[0] < 0.02


def test_ghosts_at_fixed_spots_are_nobody_and_spoil_nobody():
    """Every view has two: figures in the furniture, with a confidence of their own, that people walk in front of."""
    clip, rng = film(crossing(), views=4), np.random.default_rng(3)
    body = clip.rig.project(walk((0, 0), (0, 0), 0.9, heading=1, frames=1))[0][0].reshape(4, 1, 25, 2)
    spots = body + np.array([[(-200, -120), (150, 60)], [(-90, 130), (210, -60)], [(120, -150), (-180, 40)],
                             [(60, 140), (-150, -90)]])[:, :, None]  # fmt: skip
    xy = spots + rng.normal(0, 2, (FRAMES, 4, 2, 25, 2))
    xy[rng.random(xy.shape[:-1]) < 0.4] = np.nan
    score = np.where(np.isnan(xy[..., 0]), np.nan, rng.uniform(0.3, 0.7, xy.shape[:-1]))
    haunted = Detections2D(
        BODY25,
        np.concatenate([clip.detections.xy, xy], 2),
        np.concatenate([clip.detections.score, score], 2),
    )
    poses = capture(replace(clip, detections=haunted), DEFAULT)
    assert sorted(rows_of(poses, crossing())) == [[0], [1], [2]]
    assert poses.xyz.shape[1] == 3
    plain, off = errors(capture(clip, DEFAULT), crossing()), errors(poses, crossing())
    assert np.nanquantile(off, 0.99) < 1.2 * np.nanquantile(plain, 0.99)
    assert np.isfinite(off).mean() > np.isfinite(plain).mean() - 0.005


def test_arms_taken_for_those_of_the_other_side_are_rejected():
    """In one view of four for half a second, then in another: as good as if that view had not seen them."""
    sound, mirror = film(crossing(), views=4, miss=0.03), np.asarray(BODY25.mirror)
    arms = BODY25.index("l_elbow", "l_wrist", "r_elbow", "r_wrist")
    wrong, without = (Detections2D(BODY25, sound.detections.xy.copy(), sound.detections.score.copy()) for _ in range(2))
    for view, start in ((1, 20), (2, 50)):
        for array in (wrong.xy, wrong.score):
            array[start : start + 13, view][:, :, arms] = array[start : start + 13, view][:, :, mirror[arms]]
        for array in (without.xy, without.score):
            array[start : start + 13, view][:, :, arms] = np.nan
    frames = np.r_[20:33, 50:63]
    off, least = (
        errors(capture(replace(sound, detections=each), DEFAULT), crossing())[frames][..., arms]
        for each in (wrong, without)
    )
    assert np.nanmax(off) < 1.1 * np.nanmax(least)
    assert np.isfinite(off).mean() > 0.95 * np.isfinite(least).mean()


def test_one_camera_is_refused():
    with pytest.raises(ValueError, match=r"clip 'made up': capture needs at least 2 cameras, found 1"):
        capture(film(crossing(), views=3).select(views=[1]), DEFAULT)


def test_a_single_view_cannot_make_a_joint():
    with pytest.raises(ValueError, match="th_v=1"):
        CaptureConfig(th_v=1)


def test_nobody_is_a_result():
    clip = film(crossing())
    nobody = Detections2D(BODY25, np.empty((FRAMES, 4, 0, 25, 2)), np.empty((FRAMES, 4, 0, 25)))
    assert capture(replace(clip, detections=nobody), DEFAULT).xyz.shape == (FRAMES, 0, 25, 3)
    absent = Detections2D(BODY25, np.full((FRAMES, 4, 2, 25, 2), np.nan), np.full((FRAMES, 4, 2, 25), np.nan))
    assert capture(replace(clip, detections=absent), DEFAULT).xyz.shape == (FRAMES, 0, 25, 3)


def test_infinite_pixels_are_absent():
    clip = film(crossing())
    clip.detections.xy[10:20, 0] = np.where(np.isnan(clip.detections.xy[10:20, 0]), np.nan, np.inf)
    assert sorted(rows_of(capture(clip, DEFAULT), crossing())) == [[0], [1], [2]]


def test_truth_is_never_read():
    clip = film(crossing())
    np.testing.assert_array_equal(capture(replace(clip, truth=None), DEFAULT).xyz, capture(clip, DEFAULT).xyz)


@pytest.fixture(scope="session")
def captured(shelf) -> Poses3D:
    return capture(shelf, DEFAULT)


def test_shelf_people_are_found_and_stay_who_they_are(shelf, captured):
    """Four people are in the recording, some unannotated for most of it; none is found twice, none changes row."""
    assert captured.xyz.shape[:3] == (301, 4, 25)
    here = np.isfinite(captured.xyz).all(-1).any(-1).sum(0)
    assert (here > 100).all()
    matches = match(convert(captured, SHELF14).xyz, shelf.truth.xyz)
    for actor in range(4):
        annotated = ~np.isnan(shelf.truth.xyz[:, actor]).any((-1, -2))
        assert len(set(matches[annotated, actor])) == 1
        assert (matches[annotated, actor] >= 0).all()


def test_shelf_joints_lie_on_the_detections_they_are_made_of(shelf, captured):
    pixels, _ = shelf.rig.project(captured.xyz)
    off = np.linalg.norm(shelf.detections.xy[:, :, None] - pixels[:, :, :, None], axis=-1)
    nearest = np.where(np.isnan(off), np.inf, off).min(3)
    used = np.sort(np.where(np.isfinite(nearest), nearest, np.nan), 1)[:, :2]
    known = np.isfinite(captured.xyz[..., 0])
    assert np.nanmedian(used.max(1)[known]) < 6
    assert (captured.views[known] >= 2).all()


@pytest.mark.parametrize(("cameras", "least"), [([0, 1, 2, 3, 4], 98.0), ([0, 1, 3, 4], 97.0), ([0, 2, 3], 94.0)])
def test_shelf_limbs_are_right(shelf, captured, cameras, least):
    """Strict PCP of actors 0 to 2 after linear filling and light smoothing."""
    poses = captured if len(cameras) == 5 else capture(shelf.select(views=cameras), DEFAULT)
    poses = convert(smooth(fill_linear(poses, FPS), FPS, 0.1), SHELF14)
    truth = shelf.truth.xyz
    correct, known = correct_limbs(take_matched(poses.xyz, match(poses.xyz, truth)), truth, SHELF14)
    assert np.mean([percent(correct[:, actor], known[:, actor]) for actor in range(3)]) > least
