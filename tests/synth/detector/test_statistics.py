"""Statistics of detections with planted errors."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.skeleton import BODY25
from dmae.data.store import save_clip, write_manifest
from dmae.formats.shelf import read_shelf
from synth.detector.config import ErrorReference
from synth.detector.statistics import measure, read_recording
from tests.support.circling_people import circling_people
from tests.support.clips import full_clip, looking_at_origin

pytestmark = pytest.mark.slow

FRAMES, FPS, VIEWS = 150, 25.0, 5
NOISE = 0.01


@pytest.fixture(scope="module")
def exact() -> Clip:
    """Return three circling_people detected without error by five cameras, detections in the order of persons."""
    truth = circling_people(FRAMES, 3, rng=np.random.default_rng(0))
    rig = looking_at_origin(VIEWS)
    xy = rig.project(0.6 * truth.xyz)[0]
    inside = rig.inside(xy)
    assert inside.mean() > 0.95
    return clip_of(np.where(inside[..., None], xy, np.nan), rig, Poses3D(BODY25, 0.6 * truth.xyz))


def clip_of(xy, rig, truth, score=0.8) -> Clip:
    return Clip(
        "planted", FPS, rig, Detections2D(BODY25, xy, np.where(np.isnan(xy[..., 0]), np.nan, score)), truth=truth
    )


def heights(clip: Clip) -> np.ndarray:
    """(F, V, P, 1) px."""
    y = clip.rig.project(clip.truth.xyz)[0][..., 1]
    return (y.max(-1) - y.min(-1))[..., None]


def noisy(clip: Clip, rng) -> np.ndarray:
    return clip.detections.xy + NOISE * heights(clip)[..., None] * rng.normal(size=clip.detections.xy.shape)


def test_correlations_over_less_than_a_frame_are_unknown(exact):
    slow = replace(clip_of(noisy(exact, np.random.default_rng(1)), exact.rig, exact.truth), fps=1.0)
    assert np.isnan(list(measure(slow, ErrorReference.annotated).autocorrelation.values())).all()


@pytest.mark.parametrize("reference", ErrorReference)
def test_the_size_of_independent_errors_is_measured(exact, reference):
    clip = clip_of(noisy(exact, np.random.default_rng(1)), exact.rig, exact.truth)
    found = measure(clip, reference)
    # Rayleigh's median; the other views err too, by less.
    want = NOISE * np.sqrt(2 * np.log(2))
    assert want * (0.97 if reference == ErrorReference.annotated else 1.0) < np.median(found.error) < 1.3 * want
    assert abs(found.autocorrelation[0.2]) < 0.1
    assert found.constant < 0.05
    assert found.inverted.mean() < 0.001
    assert np.nanmax(found.missed) < 0.02
    assert np.nanmean(found.person_missed) < 0.01
    assert found.ghosts.sum() == 0


def test_misses_are_counted_by_kind_by_neighbour_and_by_length(exact):
    xy = noisy(exact, np.random.default_rng(1))
    wrists, elbows = BODY25.index("l_wrist", "r_wrist"), BODY25.index("l_elbow", "r_elbow")
    # In every second: 10 frames without wrists, in 5 of them without elbows.
    for start in range(0, FRAMES, 25):
        xy[start + 5 : start + 15][..., wrists, :] = np.nan
        xy[start + 5 : start + 10][..., elbows, :] = np.nan
    found = measure(clip_of(xy, exact.rig, exact.truth))
    by_kind = dict(zip(found.kinds, np.nanmean(found.missed, 0), strict=True))
    assert by_kind["wrist"] == pytest.approx(0.4, abs=0.03)
    assert by_kind["elbow"] == pytest.approx(0.2, abs=0.03)
    assert by_kind["knee"] < 0.02
    assert found.joint_misses["elbow|wrist"] == pytest.approx(0.5, abs=0.05)
    assert found.joint_misses["wrist|elbow"] == pytest.approx(1, abs=0.01)
    assert np.isin(np.round(found.miss_seconds * FPS), (5, 10)).mean() > 0.9
    assert found.views[found.kinds.index("wrist"), 0] == pytest.approx(0.4, abs=0.05)


def test_misses_on_the_far_side_differ_from_those_on_the_near_side(exact):
    xy = noisy(exact, np.random.default_rng(1))
    flat, index = exact.truth.xyz[..., :2], BODY25.index
    elbows = index("l_elbow", "r_elbow")
    out = flat[:, :, elbows] - flat[:, :, index("l_shoulder", "r_shoulder")].mean(2, keepdims=True)
    sight = exact.rig.centers[:, None, None, :2] - flat[:, None, :, elbows]
    along = (sight * out[:, None]).sum(-1) / np.linalg.norm(sight, axis=-1) / np.linalg.norm(out, axis=-1)[:, None]
    hidden = np.zeros(xy.shape[:-1], bool)
    hidden[..., elbows] = along < -0.45
    found = measure(clip_of(np.where(hidden[..., None], np.nan, xy), exact.rig, exact.truth))
    near, far = found.missed_by_side[found.kinds.index("elbow")]
    assert near < 0.05
    assert far > 0.95
    assert np.isnan(found.missed_by_side[found.kinds.index("neck")]).all()


def test_inversions_ghosts_and_missed_persons_are_distinguished(exact):
    rng = np.random.default_rng(1)
    xy = noisy(exact, rng)
    legs = BODY25.index("l_knee", "l_ankle", "r_knee", "r_ankle")
    mirror = np.asarray(BODY25.mirror)[legs]
    xy[50:60, 1][..., legs, :] = xy[50:60, 1][..., mirror, :].copy()
    xy[100:130, 2, 0] = np.nan
    ghost = np.full((FRAMES, VIEWS, 1, 25, 2), np.nan)
    ghost[:, 3, 0, :8] = (60, 60) + rng.uniform(0, 40, (8, 2))
    found = measure(clip_of(np.concatenate([xy, ghost], 2), exact.rig, exact.truth))
    assert found.ghosts == pytest.approx([0, 0, 0, 1, 0], abs=0.02)
    assert found.ghost_joints == 8
    assert found.person_missed == pytest.approx([0, 0, 30 / FRAMES / 3, 0, 0], abs=0.02)
    ankle = found.inverted[found.kind == found.kinds.index("ankle")].mean()
    assert ankle == pytest.approx(10 / FRAMES / VIEWS, rel=0.6)
    assert found.inverted[found.kind == found.kinds.index("wrist")].mean() < 0.001


def test_clips_that_cannot_be_measured_are_refused(exact):
    with pytest.raises(ValueError, match="takes 3 cameras"):
        measure(exact.select(views=[0, 1]))
    empty = np.full_like(exact.detections.xy, np.nan)
    with pytest.raises(ValueError, match="no person is detected"):
        measure(clip_of(empty, exact.rig, exact.truth))
    with pytest.raises(ValueError, match="no person is annotated"):
        measure(replace(exact, truth=None), ErrorReference.annotated)


def test_a_data_set_in_place_of_a_recording_is_answered_by_one_of_its_clips(tmp_path):
    for name in ("a", "b"):
        save_clip(full_clip(), tmp_path / name)
    write_manifest(tmp_path, [{"id": name, "status": "ok"} for name in ("a", "b")])
    with pytest.raises(ValueError, match=f"expected one recording, found 2 clips; {tmp_path / 'a'} is one$"):
        read_recording(tmp_path)


@pytest.mark.slow
def test_statistics_of_shelf_equal_an_independent_analysis(data_folder):
    """Medians by confidence, and correlations of misses, from an analysis with other code."""
    found = measure(read_shelf(data_folder / "shelf"))
    edges = (0.05, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.01)
    medians = [np.median(found.error[(found.score >= low) & (found.score < high)]) for low, high in pairwise(edges)]
    np.testing.assert_allclose(medians, (0.039, 0.036, 0.031, 0.027, 0.025, 0.022, 0.018, 0.014, 0.011), atol=0.005)
    assert found.ghosts.mean() == pytest.approx(0.23, abs=0.05)
    assert found.constant == pytest.approx(0.23, abs=0.04)
