"""Capture of procedural people with known truth, and of the Shelf recording."""

from dataclasses import replace

import numpy as np
import pytest
from omegaconf import OmegaConf

from dmae.completion.fillings import fill_linear
from dmae.data.clip import Clip, Detections2D, Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.resources import resource_folder
from dmae.data.skeleton import BODY25, SHELF14
from dmae.metrics.comparison import match, take_matched
from dmae.metrics.identity import idf1
from dmae.metrics.pcp import correct_limbs
from dmae.metrics.position import percent
from dmae.numerics.filling import smooth
from dmae.online.capture import OnlineCapture
from dmae.reconstruction.config import CaptureConfig, NoiseModel, ReassignmentConfig
from dmae.reconstruction.pipeline import capture
from tests.support.clips import looking_at_origin
from tests.support.detected_people import FPS, FRAMES, crossing, detected_clip, errors, rows_of, walk

DEFAULT = CaptureConfig()


def preset(name: str) -> CaptureConfig:
    """A configuration of `configs/capture`."""
    values = OmegaConf.to_container(OmegaConf.load(resource_folder("dmae", "configs") / f"capture/{name}.yaml"))
    groups = {key: type(getattr(DEFAULT, key))(**value) for key, value in values.items() if isinstance(value, dict)}
    return CaptureConfig(**values | groups)


PAPER = preset("paper")


@pytest.mark.parametrize("views", [3, 4, 7])
def test_people_who_cross_keep_their_rows(views):
    poses = capture(detected_clip(crossing(), views), DEFAULT)
    assert sorted(rows_of(poses, crossing())) == [[0], [1], [2]]
    off = errors(poses, crossing())
    assert np.nanmedian(off) < 0.03
    assert np.nanquantile(off, 0.99) < 0.1
    assert np.isfinite(off).mean() > 0.95


def test_a_huddle_of_six_keeps_identities():
    """They meet within 0.6 m and part again; for half a second at a time, a fifth of the views miss each person."""
    angle = np.arange(6) * np.pi / 3
    out, near = (radius * np.stack([np.cos(angle), np.sin(angle)], -1) for radius in (1.8, 0.6))
    paths = [
        np.concatenate([walk(a, b, heading=h, frames=50), walk(b, a, heading=h, frames=50)])
        for a, b, h in zip(out, near, angle, strict=True)
    ]
    people = np.stack(paths, 1)
    clip = detected_clip(people, views=5, miss=0.1)
    missed = np.random.default_rng(0).random((8, 5, 6)) < 0.2
    missed = np.repeat(missed, 13, 0)[:FRAMES]
    clip.detections.xy[missed], clip.detections.score[missed] = np.nan, np.nan
    assert idf1(capture(clip, DEFAULT).xyz, people) > 98


def test_source_views_and_covariance_match_what_was_measured():
    poses = capture(detected_clip(crossing(), miss=0.4), DEFAULT)
    absent = np.isnan(poses.xyz).any(-1)
    assert 0.02 < absent.mean() < 0.5
    assert (poses.source[absent] == Source.ABSENT).all()
    assert (poses.source[~absent] == Source.MEASURED).all()
    assert (poses.views[absent] == 0).all()
    assert (poses.views[~absent] >= 2).all()
    assert np.isnan(poses.cov[absent]).all()
    assert (np.linalg.eigvalsh(poses.cov[~absent]) > 0).all()


def test_a_person_who_re_enters_soon_keeps_the_row():
    people = crossing().copy()
    people[30:62, 1] = np.nan
    poses = capture(detected_clip(people), DEFAULT)
    assert sorted(rows_of(poses, people)) == [[0], [1], [2]]
    assert np.isnan(poses.xyz[40:60, rows_of(poses, people)[1][0]]).all()


def test_a_person_who_re_enters_late_gets_a_new_row():
    people = crossing().copy()
    people[20:85, 1] = np.nan
    rows = rows_of(capture(detected_clip(people), DEFAULT), people)
    assert len(rows[1]) == 2
    assert len(rows[0]) == len(rows[2]) == 1
    assert sorted({row for person in rows for row in person}) == [0, 1, 2, 3]


def test_a_person_of_another_build_who_enters_after_an_exit_gets_a_new_row():
    people = np.stack([walk((-1.5, 0), (1.5, 0)), walk((0, 1), (0, 1)), walk((0.3, 1), (0.3, 1), 0.7)], 1)
    people[50:, 1] = np.nan
    people[:65, 2] = np.nan
    rows = rows_of(capture(detected_clip(people, miss=0), DEFAULT), people)
    assert sorted(rows) == [[0], [1], [2]]


def test_ghosts_of_single_views_and_fragments_are_no_people():
    """Each view has a ghost at a fixed place; every third frame, the legs of a person are a detection of their own."""
    clip = detected_clip(crossing())
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


def test_a_joint_that_jumps_to_a_neighbour_is_dropped():
    """For two frames every view confuses a left wrist with that of a neighbour at 0.6 m."""
    people = np.stack([walk((-0.3, 0), (-0.3, 0)), walk((0.3, 0), (0.3, 0))], 1)
    wrong = people.copy()
    wrist = BODY25.index("l_wrist")[0]
    wrong[50:52, 0, wrist] = people[50:52, 1, wrist]
    poses = capture(detected_clip(wrong, miss=0), DEFAULT)
    off = errors(poses, people)[:, 0, wrist]
    assert np.isnan(off[50:52]).all()
    assert np.isfinite(off[[48, 49, 52, 53]]).all()


def test_reassignment_accepts_low_confidence_where_a_joint_is_expected():
    """A wrist has confidence 0.15, below th_p, in two of four views for some frames: only the second pass takes it."""
    people = crossing()[:, :1]
    clip = detected_clip(people, miss=0, views=4)
    wrist = BODY25.index("r_wrist")[0]
    score = clip.detections.score
    score[40:44, :2, :, wrist], score[40:44, 2:, :, wrist] = 0.15, np.nan
    clip.detections.xy[40:44, 2:, :, wrist] = np.nan
    told = replace(DEFAULT, noise=NoiseModel(learn=False))
    assert np.isfinite(errors(capture(clip, told), people)[40:44, 0, wrist]).all()
    one_pass = replace(told, reassignment=ReassignmentConfig(distance_m=0))
    assert np.isnan(errors(capture(clip, one_pass), people)[40:44, 0, wrist]).all()


def test_the_preset_of_the_paper_needs_three_views_for_a_joint():
    clip = detected_clip(crossing(), views=5)
    poses = capture(clip, PAPER)
    known = poses.views > 0
    assert (poses.views[known] >= 3).all()
    assert np.nanmedian(errors(poses, crossing())) < 0.03
    assert capture(clip.select(views=[0, 1]), PAPER).xyz.shape[1] == 0


def test_a_fisheye_measures_as_well_as_a_pinhole():
    rig = looking_at_origin(4)
    bent = replace(rig, dist=np.tile([0.04, -0.01, 0.002, 0, 0], (4, 1)), fisheye=np.ones(4, bool))
    poses = [capture(detected_clip(crossing(), rig=lenses, noise=1.0), DEFAULT) for lenses in (rig, bent)]
    off = [np.nanmedian(errors(each, crossing())) for each in poses]
    assert off[1] < 1.2 * off[0] < 0.02


def test_ghosts_at_fixed_places_are_no_people_and_harm_no_one():
    """Every view has two: figures in the furniture, with their own confidence, that people walk in front of."""
    clip, rng = detected_clip(crossing(), views=4), np.random.default_rng(3)
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


def test_arms_swapped_left_to_right_are_rejected():
    """In one view of four for half a second, then in another: as good as if that view had missed them."""
    sound, mirror = detected_clip(crossing(), views=4, miss=0.03), np.asarray(BODY25.mirror)
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
        capture(detected_clip(crossing(), views=3).select(views=[1]), DEFAULT)


def test_cameras_far_from_the_origin_are_refused():
    """UTM coordinates: poses, stored in 32 bits, would be in steps of half a metre."""
    clip = detected_clip(crossing(), views=3)

    def moved(by: tuple[float, float, float]) -> Clip:
        shift = np.eye(4)
        shift[:3, 3] = by
        return replace(clip, rig=replace(clip.rig, cam_from_world=clip.rig.cam_from_world @ shift))

    with pytest.raises(ValueError, match=r"clip 'made up': its cameras are 5,215 km .* steps of 500 mm .*subtract"):
        capture(moved((-4e5, -5.2e6, -100)), DEFAULT)
    with pytest.raises(ValueError, match="calibration: its cameras are 20 km from the origin"):
        OnlineCapture(moved((2e4, 0, 0)).rig, BODY25, FPS, DEFAULT)
    assert capture(moved((3000, 0, 0)), DEFAULT).measured.any()


def test_a_single_view_cannot_make_a_joint():
    with pytest.raises(ValueError, match="th_v=1"):
        CaptureConfig(th_v=1)


def test_zero_people_are_a_valid_result():
    clip = detected_clip(crossing())
    empty = Detections2D(BODY25, np.empty((FRAMES, 4, 0, 25, 2)), np.empty((FRAMES, 4, 0, 25)))
    assert capture(replace(clip, detections=empty), DEFAULT).xyz.shape == (FRAMES, 0, 25, 3)
    absent = Detections2D(BODY25, np.full((FRAMES, 4, 2, 25, 2), np.nan), np.full((FRAMES, 4, 2, 25), np.nan))
    assert capture(replace(clip, detections=absent), DEFAULT).xyz.shape == (FRAMES, 0, 25, 3)


def test_truth_is_never_read():
    clip = detected_clip(crossing())
    np.testing.assert_array_equal(capture(replace(clip, truth=None), DEFAULT).xyz, capture(clip, DEFAULT).xyz)


@pytest.fixture(scope="session")
def captured(shelf) -> Poses3D:
    return capture(shelf, DEFAULT)


def test_shelf_people_are_found_and_keep_their_rows(shelf, captured):
    """The recording shows four people, some unannotated for most of it; none is found twice, none changes row."""
    assert captured.xyz.shape[:3] == (301, 4, 25)
    here = np.isfinite(captured.xyz).all(-1).any(-1).sum(0)
    assert (here > 100).all()
    matches = match(convert(captured, SHELF14).xyz, shelf.truth.xyz)
    for actor in range(4):
        annotated = ~np.isnan(shelf.truth.xyz[:, actor]).any((-1, -2))
        assert len(set(matches[annotated, actor])) == 1
        assert (matches[annotated, actor] >= 0).all()


def test_shelf_joints_lie_on_their_detections(shelf, captured):
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
