"""Corruptions: requirements that each meets, what single ones do, and what they share."""

from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest

from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.skeleton import BODY25, SKELETONS, Skeleton
from dmae.evaluation.corruption.corrupt import (
    corrupt,
    detections_of_people,
    limb_of_joint,
    people_of,
    people_of_detections,
    share_of_time,
)
from dmae.evaluation.corruption.corruptions import clearance, clearance_of_self, companion, delayed, nearest_other
from dmae.evaluation.corruption.registry import corruption, corruptions
from dmae.reconstruction.config import CaptureConfig
from tests.support.clips import t_pose
from tests.support.stressed_clips import strollers

NAMES = [entry.name for entry in corruptions()]


@cache
def corrupted(name: str, level: float, seed: int = 0) -> Clip:
    return corrupt(strollers(), {name: level}, seed=seed)


@cache
def measured() -> Poses3D:
    """The people that the cameras measure in a clip without truth."""
    return people_of(strollers(truth=False), CaptureConfig())


def arrays(clip: Clip) -> dict[str, np.ndarray]:
    found = {f"rig.{f.name}": getattr(clip.rig, f.name) for f in fields(clip.rig)[1:]}
    return found | {"xy": clip.detections.xy, "score": clip.detections.score, "fps": np.array(clip.fps)}


def same(one: Clip, other: Clip) -> bool:
    pairs = [(a, arrays(other)[name]) for name, a in arrays(one).items()]
    return all(a.shape == b.shape and np.array_equal(a, b, equal_nan=True) for a, b in pairs)


@pytest.mark.parametrize("name", NAMES)
class TestEveryCorruption:
    def test_level_0_is_the_clip_itself(self, name):
        clip = strollers()
        assert corrupt(clip, {name: 0}) is clip

    def test_something_changes_and_the_clip_given_does_not(self, name):
        clip = strollers()
        before = {key: array.copy() for key, array in arrays(clip).items()}
        found = corrupt(clip, {name: corruption[name].small[-1]})
        assert not same(found, clip)
        for key, array in arrays(clip).items():
            np.testing.assert_array_equal(array, before[key])

    def test_arrays_that_cannot_be_written_are_taken(self, name):
        """Worker processes get arrays that are mapped from files."""
        clip = strollers()
        for array in (clip.detections.xy, clip.detections.score, clip.truth.xyz):
            array.setflags(write=False)
        assert same(corrupt(clip, {name: corruption[name].levels[0]}), corrupted(name, corruption[name].levels[0]))

    def test_seeds_repeat_and_differ(self, name):
        level = corruption[name].small[-1]
        assert same(corrupted(name, level), corrupt(strollers(), {name: level}))
        if name not in ("edges", "own_body", "frame_rate"):  # nothing is drawn
            assert not same(corrupted(name, level), corrupted(name, level, seed=1))

    def test_truth_stays_as_it_is(self, name):
        clip = strollers()
        found = corrupted(name, corruption[name].small[-1])
        kept = slice(None, None, 1 + int(corruption[name].small[-1])) if name == "frame_rate" else slice(None)
        np.testing.assert_array_equal(found.truth.xyz, clip.truth.xyz[kept])
        assert len(found) == len(found.truth.xyz)
        assert found.poses is None

    def test_detections_are_absent_in_whole(self, name):
        """`Detections2D` checks scores against places; levels are in the order of what is left or added."""
        found = corrupted(name, corruption[name].small[-1]).detections
        assert np.isfinite(found.xy[found.observed]).all() and np.isfinite(found.score[found.observed]).all()
        assert (found.score[found.observed] >= 0.5 - 1e-6).all()

    def test_a_clip_without_truth_is_corrupted_by_what_its_cameras_measure(self, name):
        clip, level = strollers(truth=False), {name: corruption[name].small[-1]}
        found = corrupt(clip, level, people=measured())
        assert not same(found, clip)
        if name == "objects":  # as one does by default: to capture for each takes long
            assert same(found, corrupt(clip, level))

    def test_levels_increase_and_the_small_ones_are_within_the_range(self, name):
        entry = corruption[name]
        assert list(entry.levels) == sorted(set(entry.levels)) and entry.levels[0] > 0
        assert list(entry.small) == sorted(set(entry.small)) and entry.small[0] > 0
        assert max(entry.levels[-1], entry.small[-1]) <= entry.most

    def test_an_empty_clip_stays_empty(self, name):
        clip = strollers(persons=2)
        nothing = Detections2D(BODY25, *(np.full_like(a, np.nan) for a in (clip.detections.xy, clip.detections.score)))
        clip = replace(clip, detections=nothing, detection_labels=None)
        if corruption[name].people > 1:
            with pytest.raises(ValueError, match="2 people or more in an image, clip 'strollers' has at most 0"):
                corrupt(clip, {name: 1})
        else:
            assert not corrupt(clip, {name: 1}).detections.observed.any()

    def test_level_below_zero_is_refused(self, name):
        with pytest.raises(ValueError, match=rf"{name}=-1: expected .*0 or .* in "):
            corrupt(strollers(), {name: -1})


@pytest.mark.parametrize("name", ["objects", "persons", "own_body", "edges", "misses", "bursts", "dropouts"])
@pytest.mark.parametrize("level", [10, 40])
def test_the_asked_share_of_the_joints_is_lost(name, level):
    clip = strollers()
    lost = 1 - corrupted(name, level).detections.observed.sum() / clip.detections.observed.sum()
    # Events are drawn for joints that are not in the image as well.
    exact = name in ("objects", "persons", "own_body", "edges")
    assert abs(100 * lost - level) < (0.5 if exact else 5)


@pytest.mark.parametrize("name", ["objects", "persons", "own_body", "edges", "misses", "bursts", "dropouts", "cameras"])
def test_what_a_level_hides_a_higher_one_hides_as_well(name):
    """A camera that is left out takes its detections with it."""
    low, high = corruption[name].levels[:2]
    cameras = (set(corrupted(name, level).rig.names) for level in (low, high))
    first, second = cameras
    assert second <= first
    if name != "cameras":
        seen, seen_less = (corrupted(name, level).detections.observed for level in (low, high))
        assert not (seen_less & ~seen).any() and seen_less.sum() < seen.sum()


def test_jitter_is_as_large_as_asked():
    clip = strollers(frames=100)
    off = corrupt(clip, {"jitter": 2}).detections.xy - clip.detections.xy
    xy = clip.detections.xy
    height = (np.nanmax(np.where(np.isnan(xy), -1e9, xy), -2) - np.nanmin(np.where(np.isnan(xy), 1e9, xy), -2)).max(-1)
    assert np.nanstd(off / height[..., None, None]) == pytest.approx(0.02, rel=0.03)


def test_side_swaps_mirror_whole_people():
    clip, mirror = strollers(), list(BODY25.mirror)
    found = corrupted("side_swaps", 40).detections
    mirrored = np.isclose(found.xy, clip.detections.xy[..., mirror, :], equal_nan=True).all((-1, -2))
    kept = np.isclose(found.xy, clip.detections.xy, equal_nan=True).all((-1, -2))
    assert (mirrored | kept).all()
    assert abs(100 * (mirrored & ~kept).mean() - 40) < 6


def test_person_swaps_take_limbs_of_another_detection():
    clip = strollers()
    found, xy = corrupted("person_swaps", 20).detections, clip.detections.xy
    moved = ~np.isclose(found.xy, xy, equal_nan=True).all(-1) & found.observed
    frame, view, _, joint = np.nonzero(moved)
    others = xy[frame, view, :, joint]
    assert np.isclose(others, found.xy[moved][:, None]).all(-1).any(1).all()
    assert 5 < 100 * moved.sum() / found.observed.sum() < 30


def test_merged_people_are_fewer():
    count = [corrupted("merges", level).detections.observed.any(-1).sum() for level in (10, 20, 40, 60)]
    before = strollers().detections.observed.any(-1).sum()
    assert before > count[0] > count[1] > count[2] > count[3] > before / 3


@pytest.mark.parametrize("level", [1, 4])
def test_ghosts_are_as_many_as_asked(level):
    clip = strollers(frames=1500, persons=1, views=3)
    added = corrupt(clip, {"ghosts": level}).detections.observed.any(-1).sum()
    added -= clip.detections.observed.any(-1).sum()
    assert added / (1500 * 3) == pytest.approx(level, rel=0.25)


@pytest.mark.parametrize("level", [1, 3])
def test_added_people_are_captured_as_well(level):
    import dmae

    clip = strollers(persons=1, views=5)
    assert dmae.capture(corrupt(clip, {"crowd": level})).xyz.shape[1] == 1 + level


def test_an_added_person_is_as_close_as_asked():
    import dmae

    clip = strollers(persons=1)
    found = dmae.capture(corrupt(clip, {"closeness": 1}))
    hips = found.xyz[:, :2, BODY25.index("mid_hip")[0], :2]
    assert np.nanmedian(np.linalg.norm(hips[:, 0] - hips[:, 1], axis=-1)) == pytest.approx(1.0, abs=0.15)


def test_calibration_turns_each_camera_about_its_centre():
    clip, found = strollers(), corrupted("calibration", 1)
    np.testing.assert_allclose(found.rig.centers, clip.rig.centers, atol=1e-9)
    turned = found.rig.cam_from_world[:, :3, :3] @ clip.rig.cam_from_world[:, :3, :3].swapaxes(1, 2)
    np.testing.assert_allclose(np.degrees(np.arccos((np.trace(turned, axis1=1, axis2=2) - 1) / 2)), 1)
    np.testing.assert_array_equal(found.true_rig.cam_from_world, clip.rig.cam_from_world)


def test_offsets_move_half_of_the_cameras():
    clip, found = strollers(), corrupted("offsets", 4).detections
    late = [view for view in range(5) if not found.observed[:4, view].any()]
    assert len(late) == 2
    np.testing.assert_array_equal(found.xy[4:, late], clip.detections.xy[:-4, late])


def test_frame_rate_keeps_every_other_frame():
    found = corrupted("frame_rate", 1)
    assert (len(found), found.fps) == (20, 12.5)


def test_corruptions_of_a_pair_draw_what_they_draw_alone():
    both = corrupt(strollers(), {"cameras": 2, "misses": 20})
    assert both.rig.names == corrupted("cameras", 2).rig.names
    kept = [strollers().rig.names.index(name) for name in both.rig.names]
    np.testing.assert_array_equal(both.detections.xy, corrupted("misses", 20).detections.xy[:, kept])


@pytest.mark.parametrize(
    ("levels", "message"),
    [
        ({"jiter": 1}, "no corruption 'jiter'; did you mean jitter"),
        ({"cameras": 4}, "clip 'strollers' has 5 cameras, and two must be left; expected levels up to 3"),
        ({"cameras": 1.5}, r"cameras=1\.5: expected a whole number, 0 or more, in cameras fewer"),
        ({"objects": 101}, r"objects=101: expected 0 or up to 100, in %"),
        ({"misses": float("nan")}, "misses=nan: expected 0"),
        ({"cameras": float("inf")}, "cameras=inf: expected a whole number, 0 or more"),
        ({"jitter": float("inf")}, "jitter=inf: expected 0 or more"),
        ({"numpy:mean": 1}, r"expected a function under the decorator corruption"),
    ],
)
def test_what_cannot_be_is_named(levels, message):
    with pytest.raises(ValueError, match=message):
        corrupt(strollers(), levels)


def test_real_detections_are_corrupted(shelf):
    """The people of Shelf are known by capture: its truth has another skeleton."""
    clip = shelf.select(frames=slice(0, 40))
    found = corrupt(clip, {"objects": 40})
    lost = 1 - found.detections.observed.sum() / clip.detections.observed.sum()
    assert 0.3 < lost <= 0.4
    np.testing.assert_array_equal(found.truth.xyz, clip.truth.xyz)


STICK = Skeleton("stick", ("low", "high"), (-1, 0))
CAMERA = np.array([[-6.0, 0, 1]])


def stick(x: float, y: float) -> np.ndarray:
    """(1, 1, 2, 3) a pole of 2 m."""
    return np.array([[[[x, y, 0], [x, y, 2]]]], float)


def test_detections_are_those_of_the_people_they_were_made_of():
    clip = strollers()
    clip = replace(clip, poses=people_of(clip, CaptureConfig()))
    shown, seen = people_of_detections(clip), clip.detections.observed.sum(-1) > 5
    assert (shown[seen] == clip.detection_labels.person[seen]).mean() > 0.99
    assert (detections_of_people(clip) >= 0).mean() > 0.8


def test_without_truth_people_are_those_that_all_cameras_measure():
    clip = strollers()
    found, wanted = (people_of(each, CaptureConfig()).xyz for each in (replace(clip, truth=None), clip))
    nearest = np.linalg.norm(found[:, :, None, 8] - wanted[:, None, :, 8], axis=-1).min(-1)
    assert np.nanmax(nearest) < 0.05


@pytest.mark.parametrize(("x", "y", "expected"), [(-3, 0.5, 0.45), (-3, 0.02, -0.03), (3, 0.5, None), (-0.1, 0, None)])
def test_clearance_is_the_distance_of_a_pole_from_the_line_of_sight(x, y, expected):
    """At the height of the line of sight. A pole behind the joint, or just before it, hides nothing."""
    joint = np.array([[[[0, 0, 1.0], [np.nan] * 3]]])
    found = clearance(CAMERA, joint, stick(x, y), STICK)[0, 0, 0]
    assert np.isnan(found[1])
    if expected is None:
        assert found[0] > -0.05
    else:
        assert found[0] == pytest.approx(expected, abs=1e-6)


def test_the_far_arm_is_behind_the_trunk():
    body = t_pose()[None, None]
    beside = np.array([[0.0, -6, 1.3]])
    margin = clearance_of_self(beside, body, BODY25)[0, 0, 0]
    left, right = (margin[BODY25.index(f"{side}_wrist")[0]] for side in "lr")
    assert left < 0 < right


def test_companions_keep_their_distance():
    people = strollers().truth.xyz.astype(float)
    copy = companion(people, 1, 2.0, 0.3, 7)
    middles = [(body[..., :2].max(1) + body[..., :2].min(1)) / 2 for body in (people[:, 1], copy)]
    np.testing.assert_allclose(np.linalg.norm(middles[0] - middles[1], axis=-1), 2)
    np.testing.assert_allclose(copy[20, :, 2], people[13, 1, :, 2])


def test_delay_runs_back_at_the_ends():
    assert delayed(4, 1).tolist() == [1, 0, 1, 2]
    assert delayed(4, -2).tolist() == [2, 3, 2, 1]
    assert delayed(1, 5).tolist() == [0]


def test_limbs_are_arms_legs_head_and_trunk():
    for skeleton in SKELETONS.values():
        limb = limb_of_joint(skeleton)
        assert len(set(limb.tolist())) == 6
        trunk = {joint for joint, of in zip(skeleton.joints, limb, strict=True) if of == limb[skeleton.index("l_hip")]}
        assert trunk <= {"neck", "mid_hip", *(f"{side}_{joint}" for side in "lr" for joint in ("hip", "shoulder"))}
        assert len(set(limb[skeleton.index("l_knee", "l_ankle")].tolist())) == 1
        assert limb[skeleton.index("l_wrist")[0]] != limb[skeleton.index("r_wrist")[0]]


@pytest.mark.parametrize("percent", [0, 10, 50, 100])
def test_events_fill_the_asked_share(percent):
    clip = strollers()
    events = share_of_time(clip, (5, 3), percent, (1.0, 0.1), rng=np.random.default_rng(0))
    assert 100 * events.mean() == pytest.approx(percent, abs=0.1)
    more = share_of_time(clip, (5, 3), min(percent + 20, 100), (1.0, 0.1), rng=np.random.default_rng(0))
    assert not (events & ~more).any()


def test_nearest_other_detection():
    xy = np.full((1, 1, 4, 1, 2), np.nan)
    xy[0, 0, :3, 0] = [[0, 0], [10, 0], [100, 0]]
    assert nearest_other(xy).tolist() == [[[1, 0, 1, 3]]]
    assert nearest_other(xy[:, :, :1]).tolist() == [[[0]]]
