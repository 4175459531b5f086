"""Noise learned from a recording: against the noise that was put in."""

from dataclasses import replace

import numpy as np
import pytest

import dmae
from dmae.calibration.bundle_adjustment import CENTRE, ROTATION, Calibration, Q
from dmae.calibration.config import RefineConfig
from dmae.calibration.refinement import refine
from dmae.data.clip import Clip, Detections2D
from dmae.data.skeleton import BODY25
from dmae.reconstruction.config import CaptureConfig, NoiseModel
from dmae.reconstruction.noise import DetectionNoise, Residuals, fit
from dmae.reconstruction.pipeline import capture, learn_noise
from tests.support.detected_people import crossing, detected_clip

LEARNED, TOLD = CaptureConfig(), CaptureConfig(noise=NoiseModel(learn=False))
PRIOR = DetectionNoise.prior(NoiseModel(), 4, 25)


def seen(noise_px: float, confidence=None, views: int = 4) -> Clip:
    """People who cross, detected with noise; `confidence` turns uniform numbers u into scores, noise is u^-1/2."""
    clip = detected_clip(crossing()[:60], views=views, noise=0.0)
    rng = np.random.default_rng(0)
    u = rng.uniform(0.1, 1, clip.detections.score.shape)
    xy = clip.detections.xy + noise_px * (0.6 / np.sqrt(u))[..., None] * rng.normal(size=clip.detections.xy.shape)
    score = np.ones_like(u) if confidence is None else confidence(u)
    return replace(clip, detections=Detections2D(BODY25, xy, np.where(clip.detections.observed, score, np.nan)))


def drawn(size: int, outliers: float, rng) -> tuple[Residuals, np.ndarray]:
    """Return residuals of a detector with known noise, and its sigmas (n,) px."""
    view, joint = rng.integers(0, 4, size), rng.integers(0, 25, size)
    scale, score = rng.uniform(100, 400, size), rng.uniform(0.2, 1, size)
    sigma = np.hypot(np.array([1.0, 1.0, 2.0, 12.0])[view], scale * 0.03 * (1.8 - score))
    freedom = np.full(size, 0.6)
    square = 2 * freedom * sigma**2 * rng.exponential(size=size) * np.where(rng.random(size) < outliers, 100, 1)
    return Residuals(view, joint, score, square, scale, freedom, np.zeros(size, bool), np.zeros(4), np.zeros(4)), sigma


@pytest.mark.parametrize("outliers, off", [(0.0, 0.05), (0.05, 0.12)])
def test_sigmas_of_drawn_residuals_are_found(outliers, off):
    found, sigma = drawn(20_000, outliers, np.random.default_rng(0))
    noise = fit(found, PRIOR, PRIOR, BODY25)
    spread = noise.spread_m[found.joint] * noise.shape(noise.trusted(np.tile(found.score, (4, 1, 1)))[0, 0])
    ratio = np.hypot(noise.floor_px[found.view], found.scale * spread) / sigma
    for view in range(4):
        assert abs(np.median(ratio[found.view == view]) - 1) < off
    assert noise.floor_px[3] == pytest.approx(12, rel=0.2)


def test_few_residuals_change_little():
    found, _ = drawn(8, 0.0, np.random.default_rng(1))
    noise = fit(replace(found, square=100 * found.square), PRIOR, PRIOR, BODY25)
    assert noise.usual_m < 3 * PRIOR.usual_m
    assert fit(Residuals(*(part[:0] for part in vars(found).values())), PRIOR, PRIOR, BODY25) is PRIOR


@pytest.mark.parametrize("noise_px", [1.0, 12.0])
@pytest.mark.parametrize(
    "confidence", [None, lambda u: u, lambda u: 1.1 - u, lambda u: 0.3 * u**2], ids=["none", "good", "inverted", "low"]
)
def test_whatever_confidences_say_people_are_captured(noise_px, confidence):
    clip = seen(noise_px, confidence)
    noise = learn_noise(clip, LEARNED)
    assert noise.constant.all() == (confidence is None)
    assert noise.usual_px == pytest.approx(0.8 * noise_px, rel=0.25)
    poses, truth = capture(clip, LEARNED, noise), crossing()[:60]
    assert poses.xyz.shape[1] == truth.shape[1]
    order = [int(np.nanargmin(np.nanmedian(np.linalg.norm(poses.xyz - one[:, None], axis=-1), (0, 2))))
             for one in truth.swapaxes(0, 1)]  # fmt: skip
    off = (poses.xyz[:, order] - truth).astype(np.float64)
    known = np.isfinite(off[..., 0])
    inverse = np.linalg.inv(poses.cov[:, order][known].astype(np.float64))
    inside = np.einsum("ni,nij,nj->n", off[known], inverse, off[known]) < 6.25
    assert known.mean() > 0.93
    # Noise of less than a pixel is not known as well as more: cameras are hardly calibrated to less.
    assert 0.85 < inside.mean() < (0.96 if noise_px > 1 else 1.0)


def test_a_detector_without_confidences_is_recognised_in_one_camera():
    clip = seen(4.0, lambda u: u)
    score = clip.detections.score.copy()
    score[:, 1] = np.where(np.isnan(score[:, 1]), np.nan, 1.0)
    noise = learn_noise(replace(clip, detections=Detections2D(BODY25, clip.detections.xy, score)), LEARNED)
    assert noise.constant.tolist() == [False, True, False, False]
    assert "confidences of camera 1 say nothing" in noise.describe(("0", "1", "2", "3"))
    assert (noise.trusted(np.full((4, 1, 1), 0.2))[[0, 2, 3]] < 0.5).all()


def test_a_scatter_that_no_detector_has_points_to_the_cameras():
    noise = replace(learn_noise(seen(4.0), LEARNED), usual_m=0.115)
    names = ("0", "1", "2", "3")
    assert "115 mm on the person; detectors err by less than 80 mm: dmae doctor, with the same" in noise.describe(names)
    assert "dmae doctor" not in replace(noise, usual_m=0.06).describe(names)
    far = replace(noise, usual_m=0.06, floor_px=np.where(np.arange(len(names)) == 1, 9.0, 0.5))
    assert f"camera {names[1]} by 9 px more (see dmae doctor)" in far.describe(names)


@pytest.mark.parametrize("value", [0.0, 2.0, -1.0])
def test_scores_that_are_equal_everywhere_are_said_not_to_be_used(value):
    clip = seen(4.0)
    score = np.where(clip.detections.observed, value, np.nan)
    strange = replace(clip, detections=Detections2D(BODY25, clip.detections.xy, score))
    noise, plain = learn_noise(strange, LEARNED), learn_noise(clip, LEARNED)
    assert noise.describe(clip.rig.names).endswith("confidences say nothing, so they are not used")
    np.testing.assert_allclose(noise.floor_px, plain.floor_px, rtol=0.05, atol=0.2)
    assert noise.usual_m == pytest.approx(plain.usual_m, rel=0.02)
    assert capture(strange, LEARNED, noise).xyz.shape[1] == crossing().shape[1]


def test_what_scores_say_is_learned_whichever_way_they_go():
    """Two cameras share each residual; errors at u = 0.3 are 1.73 times those at 0.9."""
    u = np.array([0.3, 0.9])
    for confidence in (lambda u: u, lambda u: 1.1 - u):
        noise = learn_noise(seen(4.0, confidence, views=2), LEARNED)
        sigma = noise.shape(noise.trusted(np.tile(confidence(u), (2, 1, 1)))[0, 0])
        assert 1.6 < sigma[0] / sigma[1] < 2.1


def test_scores_that_have_nothing_to_do_with_errors_are_not_used():
    clip, rng = seen(4.0), np.random.default_rng(2)
    score = np.where(clip.detections.observed, rng.uniform(0.6, 0.95, clip.detections.score.shape), np.nan)
    strange = replace(clip, detections=Detections2D(BODY25, clip.detections.xy, score))
    assert learn_noise(strange, LEARNED).constant.all()


def with_moved_cameras(clip: Clip, moved_m: float, turned_deg: float, view: int | None = None, seed: int = 0) -> Clip:
    """Return a clip with a calibration in which all cameras, or one, are elsewhere and look elsewhere."""
    rng, step = np.random.default_rng(seed), np.zeros((len(clip.rig), Q))
    for part, size in ((CENTRE, moved_m), (ROTATION, np.radians(turned_deg))):
        direction = rng.normal(size=(len(clip.rig), 3))
        step[:, part] = size * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    if view is not None:
        step[np.arange(len(step)) != view] = 0
    return replace(clip, rig=Calibration.of(clip.rig).changed(step).rig)


@pytest.mark.parametrize("seed", range(3))
def test_no_camera_is_trusted_to_a_pixel_where_all_are_displaced(seed):
    """Points follow a camera that weighs much, so it looks right; nothing else says that it is."""
    clip = seen(2.0)
    faulty = with_moved_cameras(clip, 0.03, 0.7, seed=seed)
    noise, xyz = learn_noise(faulty, LEARNED), crossing()[:60].reshape(-1, 3)
    displaced = np.sqrt(np.mean((faulty.rig.project(xyz)[0] - clip.rig.project(xyz)[0]) ** 2))
    assert noise.floor_px.min() > 0.5 * displaced and noise.floor_px.max() < 2 * displaced
    assert "calibrations are off by" in noise.describe(clip.rig.names)


def test_one_displaced_camera_counts_less_than_the_others():
    noise = learn_noise(with_moved_cameras(seen(2.0, views=5), 0.05, 2.0, view=3), LEARNED)
    assert noise.calibration_px.argmax() == 3
    assert noise.floor_px[3] > 3 * np.median(noise.floor_px)


def test_sound_cameras_are_said_to_be_sound():
    noise = learn_noise(seen(4.0), LEARNED)
    assert noise.calibration_px.max() < 1 and "calibrations" not in noise.describe(tuple("abcd"))


@pytest.mark.slow
def test_the_line_says_that_a_correction_of_a_real_calibration_helped(data_folder):
    """One person in one place for 1.7 s: most of what cameras may be off by cannot be told."""
    clip = dmae.read(data_folder / "pose2sim/S00_P00_SingleParticipant/S00_P00_T01_BalancingTrial")
    corrected = replace(clip, rig=refine(clip, RefineConfig(cameras=["cam_03"])).rig)
    for frames in (slice(100), slice(10, 40), slice(50, 80)):
        before, after = (
            learn_noise(each.select(frames=frames), LEARNED).describe(clip.rig.names) for each in (clip, corrected)
        )
        assert "calibrations are off by" in before and "calibrations" not in after
        assert float(after.split()[4]) < float(before.split()[4])


def test_what_cannot_be_learned_is_assumed():
    clip = seen(2.0).select(frames=range(0))
    noise = learn_noise(clip, LEARNED)
    assert noise.count == 0 and "usual values are used" in noise.describe(clip.rig.names)
    told = learn_noise(seen(2.0), TOLD)
    assert told.floor_px.tolist() == [1.0] * 4 and told.trusted(np.full((4, 1, 1), 0.3)).ravel().tolist() == [0.3] * 4
