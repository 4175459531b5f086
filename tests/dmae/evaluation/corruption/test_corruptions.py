"""Requirements that every corruption meets."""

from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest

from dmae.data.clip import Clip, Detections2D
from dmae.data.skeleton import BODY25
from dmae.evaluation.corruption.corrupt import corrupt
from dmae.evaluation.corruption.registry import corruption, corruptions
from tests.support.stressed_clips import strollers

NAMES = [entry.name for entry in corruptions()]


@cache
def corrupted(name: str, level: float, seed: int = 0) -> Clip:
    return corrupt(strollers(), {name: level}, seed=seed)


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
        clip = strollers(truth=False)
        assert not same(corrupt(clip, {name: corruption[name].small[-1]}), clip)

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
        ({"jiter": 1}, "no corruption 'jiter'; did you mean 'jitter'"),
        ({"cameras": 4}, "clip 'strollers' has 5 cameras, and two must be left; expected levels up to 3"),
        ({"cameras": 1.5}, r"cameras=1\.5: expected a whole number, 0 or more, in cameras fewer"),
        ({"objects": 101}, r"objects=101: expected 0 or up to 100, in %"),
        ({"misses": float("nan")}, "misses=nan: expected 0"),
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
