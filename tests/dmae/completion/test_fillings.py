"""Completion methods: requirements on each kind, lookup by name, and adding a method."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dmae.completion.fillings import (
    contradicted,
    fill_hold,
    fill_linear,
    fill_pchip,
    fill_pchip_body,
    fill_reject_pchip,
)
from dmae.completion.methods import completion_method, find_method
from dmae.data.clip import Poses3D, Source
from dmae.data.skeleton import BODY25, COCO17, SHELF14, get_skeleton
from dmae.evaluation.synthetic_gaps import cut_gaps, perturb
from dmae.numerics.filling import LONGEST_ABSENCE, LONGEST_HOLD, present, smooth
from tests.support.circling_people import circling_people
from tests.support.clips import t_pose, walkers
from tests.support.gaps import FPS, turning, without
from tests.support.untrained_methods import UNTRAINED

FILLING = [method for name, method in UNTRAINED.items() if name != "measured"]
KEEPING = [method for name, method in UNTRAINED.items() if name not in ("measured", "kalman", "reject_pchip")]
"""Methods that leave measured joints as they are."""


def test_linear_motion_is_filled_exactly():
    truth = walkers(frames=40)
    wrist = BODY25.index("l_wrist")[0]
    holed = without(truth, slice(5, 30), 0, wrist)
    for method in (fill_linear, fill_pchip):
        filled = method(holed, FPS)
        np.testing.assert_allclose(filled.xyz, truth.xyz, atol=1e-5)
        assert (filled.source[5:30, 0, wrist] == Source.COMPLETED).all()
        assert (filled.source == Source.COMPLETED).sum() == 25


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("Poses3D(poses.skeleton, np.nan_to_num(poses.xyz))", "25 joints that no camera measured are marked as meas"),
        ("replace(poses, xyz=poses.xyz + 0.01)", r"marked as measured were moved by up to 17\.3 mm; expected"),
        (
            "Poses3D(poses.skeleton, poses.xyz[:30], source=poses.source[:30])",
            r"expected poses of 1 persons in 60 frames back, found 1 in 30",
        ),
    ],
)
def test_a_method_that_calls_joints_measured_that_are_not_is_refused(monkeypatch, tmp_path, body, message):
    head = "from dataclasses import replace\nimport numpy as np\nfrom dmae import Poses3D, Source\n"
    (tmp_path / "boastful.py").write_text(f"{head}def fill(poses, fps):\n    return {body}\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "boastful", raising=False)
    holed = without(turning(), slice(5, 30), 0, BODY25.index("l_wrist")[0])
    with pytest.raises(ValueError, match=f"^method boastful:fill: .*{message}"):
        find_method("boastful:fill").load()(holed, FPS)


def test_a_method_may_change_joints_that_it_marks_as_denoised(monkeypatch, tmp_path):
    (tmp_path / "honest.py").write_text(
        "from dataclasses import replace\nfrom dmae import Source\n"
        "def fill(poses, fps):\n    source = poses.source.copy()\n    source[source == 1] = Source.DENOISED\n"
        "    return replace(poses, xyz=poses.xyz + 0.01, source=source)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    holed = without(turning(), slice(5, 30), 0, BODY25.index("l_wrist")[0])
    filled = find_method("honest:fill").load()(holed, FPS)
    assert (filled.source[holed.measured] == Source.DENOISED).all()


def test_a_method_that_returns_no_poses_is_named(monkeypatch, tmp_path):
    (tmp_path / "forgetful.py").write_text("def fill(poses, fps):\n    poses.measured\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ValueError, match=r"forgetful:fill: expected it to return dmae.Poses3D, found NoneType"):
        find_method("forgetful:fill").load()(walkers(frames=4), FPS)


def test_a_method_may_fill_in_place_and_is_named_if_it_marks_nothing(monkeypatch, tmp_path):
    (tmp_path / "hasty.py").write_text(
        "import numpy as np\n\ndef fill(poses, fps):\n    poses.xyz[np.isnan(poses.xyz)] = 0\n    return poses\n\n"
        "def marked(poses, fps):\n    poses.source[poses.source == 0] = 3\n    return fill(poses, fps)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    holed = without(walkers(frames=4), slice(1, 3), 0, 5)
    with pytest.raises(ValueError, match=r"^method hasty:fill: Poses3D: source .* filled are Source\.COMPLETED$"):
        find_method("hasty:fill").load()(holed, FPS)
    filled = find_method("hasty:marked").load()(holed, FPS)
    assert (filled.source == Source.COMPLETED).sum() == (holed.source == Source.ABSENT).sum() == 2
    assert np.isnan(holed.xyz).any(-1).sum() == 2


@pytest.mark.parametrize("method", KEEPING)
def test_filled_joints_are_marked_and_measured_ones_stay(method):
    truth = replace(walkers(frames=40), views=np.full((40, 2, 25), 3), cov=np.tile(np.eye(3), (40, 2, 25, 1, 1)))
    rng = np.random.default_rng(0)
    xyz, views, cov = truth.xyz.copy(), truth.views.copy(), truth.cov.copy()
    hidden = rng.random(xyz.shape[:3]) < 0.3
    xyz[hidden], views[hidden], cov[hidden] = np.nan, 0, np.nan
    holed = Poses3D(BODY25, xyz, cov=cov, views=views)
    filled = method(holed, FPS)
    np.testing.assert_array_equal(filled.xyz[~hidden], truth.xyz[~hidden])
    assert (filled.source[~hidden] == Source.MEASURED).all()
    assert (filled.source[hidden] == Source.COMPLETED).all()
    assert (filled.views[hidden] == 0).all()
    assert np.isnan(filled.cov[hidden]).all()
    assert (filled.measured == ~hidden).all()


@pytest.mark.parametrize("method", FILLING)
def test_people_are_filled_independently(method):
    """Another person has no influence."""
    holed = without(turning(), slice(20, 30), 0, BODY25.index("l_wrist"))
    other = walkers(frames=60, persons=1)
    both = Poses3D(BODY25, np.concatenate([holed.xyz, other.xyz], 1))
    np.testing.assert_array_equal(method(both, FPS).xyz[:, :1], method(holed, FPS).xyz)


@pytest.mark.parametrize("method", FILLING)
def test_poses_without_people_or_measurements_are_accepted(method):
    assert method(Poses3D(BODY25, np.empty((9, 0, 25, 3))), FPS).xyz.shape == (9, 0, 25, 3)
    never = Poses3D(BODY25, np.full((9, 2, 25, 3), np.nan))
    assert (method(never, FPS).source == Source.ABSENT).all()
    single = without(walkers(frames=9), np.arange(9) != 4, slice(None), slice(None))
    # Seen for one frame, a person is there for that frame.
    seen = method(single, FPS)
    assert seen.measured[4].all()
    assert (np.delete(seen.source, 4, 0) == Source.ABSENT).all()
    np.testing.assert_allclose(seen.xyz[4], single.xyz[4], atol=1e-5)


@pytest.mark.parametrize("method", FILLING)
def test_a_person_absent_for_long_is_not_filled(method):
    longest = round(LONGEST_ABSENCE * FPS)
    truth = walkers(frames=3 * longest)
    stays = without(truth, slice(5, 5 + longest), 0, slice(None))
    assert (method(stays, FPS).source != Source.ABSENT).all()
    leaves = without(truth, slice(5, 6 + longest), 0, slice(None))
    filled = method(leaves, FPS)
    assert (filled.source[5 : 6 + longest, 0] == Source.ABSENT).all()
    assert filled.measured[:, 1].all()


@pytest.mark.parametrize("method", FILLING)
def test_joints_are_held_for_half_a_second_at_both_ends(method):
    hold = round(LONGEST_HOLD * FPS - 0.5)
    wrist = BODY25.index("l_wrist")[0]
    holed = without(walkers(frames=100), np.r_[0:40, 60:100], 0, wrist)
    filled = method(holed, FPS)
    known = np.flatnonzero(filled.source[:, 0, wrist])
    assert (known[0], known[-1]) == (40 - hold, 59 + hold)
    assert np.flatnonzero(filled.measured[:, 0, wrist]).tolist() == [*range(40, 60)]
    # Nobody is there before the first or after the last sighting.
    late = without(walkers(frames=100), np.r_[0:40, 60:100], 0, slice(None))
    assert (method(late, FPS).source[np.r_[0:40, 60:100], 0] == Source.ABSENT).all()


def test_a_joint_never_measured_stays_absent():
    holed = without(walkers(frames=20), slice(None), 0, BODY25.index("nose"))
    for method in FILLING:
        assert (method(holed, FPS).source[:, 0, 0] == Source.ABSENT).all()


def test_hold_repeats_the_last_sample():
    truth = walkers(frames=40)
    filled = fill_hold(without(truth, slice(10, 15), 0, slice(None)), FPS)
    np.testing.assert_array_equal(filled.xyz[10:15, 0], np.broadcast_to(truth.xyz[9, 0], (5, 25, 3)))


HIDDEN = [
    ("l_wrist",),
    ("l_shoulder", "l_elbow", "l_wrist"),
    ("nose", "r_ear", "r_eye"),
    ("mid_hip",),
    ("bottom_head", "top_head"),
    ("l_hip", "r_hip", "l_knee", "r_knee", "mid_hip"),
    ("neck", "l_shoulder", "r_shoulder", "l_elbow"),
]


@pytest.mark.parametrize(
    ("skeleton", "hide"),
    [
        (skeleton, [joint for joint in hide if joint in skeleton.joints])
        for skeleton in (BODY25, SHELF14, COCO17)
        for hide in HIDDEN
        if set(hide) & set(skeleton.joints)
    ],
)
def test_pchip_body_fills_rigid_motion_exactly(skeleton, hide):
    """Also when the body turns and speeds up; straight lines in the world are decimetres off."""
    truth = turning(skeleton=skeleton)
    holed = without(truth, slice(15, 45), 0, skeleton.index(*hide))
    np.testing.assert_allclose(fill_pchip_body(holed, FPS).xyz, truth.xyz, atol=1e-4)
    assert np.abs(fill_linear(holed, FPS).xyz - truth.xyz).max() > 0.1


def test_pchip_body_works_on_a_fused_skeleton():
    skeleton = get_skeleton("body25+shelf14")
    truth = turning()
    xyz = np.concatenate([truth.xyz, turning(skeleton=SHELF14).xyz], 2)
    hide = skeleton.index("body25.l_wrist", "shelf14.l_wrist")
    holed = without(Poses3D(skeleton, xyz), slice(15, 45), 0, hide)
    np.testing.assert_allclose(fill_pchip_body(holed, FPS).xyz, xyz, atol=1e-4)


def test_pchip_body_interpolates_the_root_in_the_world_while_the_torso_is_hidden():
    """In a straight walk with the whole body hidden all joints move with the interpolated root."""
    truth = walkers(frames=40)
    filled = fill_pchip_body(without(truth, slice(10, 25), 0, slice(None)), FPS)
    np.testing.assert_allclose(filled.xyz, truth.xyz, atol=1e-5)


@pytest.mark.parametrize("method", [fill_pchip_body, UNTRAINED["linear_body"]])
def test_a_joint_meets_its_measurements_while_its_parent_is_hidden_for_longer(method):
    """Within 1 mm, in a straight walk with a wrist that moves aside while its elbow is hidden."""
    truth = walkers(frames=60, persons=1)
    elbow, wrist = BODY25.index("l_elbow", "l_wrist")
    xyz = truth.xyz.copy()
    xyz[10:50, 0, elbow] = np.nan
    xyz[15:45, 0, wrist] += (0, 0.1, 0)
    expected = xyz[28:32, 0, wrist].copy()
    xyz[28:32, 0, wrist] = np.nan
    np.testing.assert_allclose(method(Poses3D(BODY25, xyz), FPS).xyz[28:32, 0, wrist], expected, atol=1e-3)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_filling_does_not_depend_on_the_frame_of_the_world(seed):
    """Cubics in the world are left out: monotone in x and y is not monotone in rotated x and y."""
    rng = np.random.default_rng(seed)
    xyz = turning().xyz.astype(float)
    hidden = rng.random(xyz.shape[:3]) < 0.4
    hidden[:, :, BODY25.index("neck")] = False
    xyz[hidden] = np.nan
    R = Rotation.from_rotvec((0, 0, rng.uniform(-np.pi, np.pi))).as_matrix()
    away = rng.normal(size=3)
    for method in (fill_hold, fill_linear, fill_pchip_body):
        here, there = method(Poses3D(BODY25, xyz), FPS), method(Poses3D(BODY25, xyz @ R.T + away), FPS)
        np.testing.assert_array_equal(here.source, there.source)
        np.testing.assert_allclose(here.xyz @ R.T + away, there.xyz, atol=1e-4)


def test_filling_is_the_same_backwards_in_time():
    """Holds for all methods except hold."""
    rng = np.random.default_rng(1)
    xyz = turning().xyz.copy()
    xyz[rng.random(xyz.shape[:3]) < 0.4] = np.nan
    for method in (fill_linear, fill_pchip, fill_pchip_body):
        forth, back = method(Poses3D(BODY25, xyz), FPS), method(Poses3D(BODY25, xyz[::-1]), FPS)
        np.testing.assert_allclose(forth.xyz, back.xyz[::-1], atol=1e-5)


@pytest.mark.parametrize("method", FILLING)
def test_hips_never_measured_stay_absent_and_other_joints_are_filled(method):
    hips = BODY25.index("mid_hip", "l_hip", "r_hip")
    holed = without(without(turning(), slice(None), 0, hips), slice(20, 30), 0, BODY25.index("l_wrist", "l_knee"))
    absent = method(holed, FPS).source[:, 0] == Source.ABSENT
    assert absent[:, hips].all()
    assert absent.sum() == absent[:, hips].sum()


@pytest.mark.parametrize("method", UNTRAINED.values())
@pytest.mark.parametrize("fps", [5.0, 240.0])
def test_any_frame_rate_works(method, fps):
    """In a walk at 1 m/s absences, holds and results are the same in seconds."""
    rate = int(fps)
    frames = np.arange(6 * rate)
    xyz = np.tile(t_pose(), (len(frames), 1, 1, 1))
    xyz[..., 0] += frames[:, None, None] / fps
    wrist = BODY25.index("l_wrist")[0]
    holed = xyz.copy()
    holed[rate : 2 * rate, 0, wrist] = np.nan
    holed[3 * rate : 5 * rate] = np.nan
    found = method(Poses3D(BODY25, holed), fps)
    assert (found.source[3 * rate : 5 * rate] == Source.ABSENT).all()
    if method is not UNTRAINED["measured"]:
        assert (found.source[rate : 2 * rate, 0, wrist] == Source.COMPLETED).all()
        there = found.source != Source.ABSENT
        assert np.abs(found.xyz - xyz)[there].max() < (1.1 if method is UNTRAINED["hold"] else 0.02)


@pytest.mark.parametrize("method", FILLING)
def test_joints_that_are_not_finite_are_absent(method):
    truth = turning()
    xyz = truth.xyz.copy()
    xyz[20, 0, 4, 1], xyz[30, 0] = np.inf, -np.inf
    holed = xyz.copy()
    holed[20, 0, 4], holed[30, 0] = np.nan, np.nan
    found, expected = method(Poses3D(BODY25, xyz), FPS), method(Poses3D(BODY25, holed), FPS)
    np.testing.assert_array_equal(found.source, expected.source)
    np.testing.assert_array_equal(found.xyz, expected.xyz)
    assert np.isfinite(found.xyz[[20, 30]]).all()


@pytest.mark.parametrize("method", FILLING)
@pytest.mark.parametrize("fps", [0.0, -25.0, np.nan])
def test_impossible_frame_rates_are_refused(method, fps):
    with pytest.raises(ValueError, match="fps must be positive, found"):
        method(walkers(), fps)


def test_people_are_present_between_measurements():
    poses = without(walkers(frames=100), np.r_[0:10, 20:30, 40:70, 90:100], 0, slice(None))
    there = present(poses, FPS)
    assert np.flatnonzero(there[:, 0]).tolist() == [*range(10, 40), *range(70, 90)]
    assert there[:, 1].all()


class TestSmooth:
    def test_constant_acceleration_passes_unchanged(self):
        time = np.arange(60)[:, None, None, None] / FPS
        xyz = t_pose()[None, None] + time * (1, 0.5, 0) + time**2 * (2, -3, 9.81)
        xyz[20:24, :, 5] = np.nan
        found = smooth(Poses3D(BODY25, xyz), FPS, 0.1)
        np.testing.assert_allclose(found.xyz, xyz, atol=1e-4)

    def test_noise_is_reduced_without_delay(self):
        rng = np.random.default_rng(0)
        time = np.arange(200)[:, None, None, None] / FPS
        truth = t_pose()[None, None] + 0.3 * np.sin(2 * np.pi * 0.5 * time)
        noisy = truth + rng.normal(0, 0.02, truth.shape)
        found = smooth(Poses3D(BODY25, noisy), FPS, 0.1)
        # A local parabola with a Gaussian of 2.5 frames leaves a standard deviation of about 0.41 of white noise.
        assert (found.xyz - truth).std() < 0.5 * 0.02
        # A delay of one frame would leave 0.3 pi / 25 / sqrt(2) = 27 mm in every joint alike.
        assert np.sqrt(((found.xyz - truth).mean((1, 2)) ** 2).mean()) < 0.003

    @pytest.mark.parametrize(("sigma", "most"), [(0.01, 0.012), (None, 0.03), (0.3, np.inf)])
    def test_fast_motion_keeps_its_amplitude_as_far_as_errors_allow(self, sigma, most):
        """All joints circle three times a second: a long parabola takes 154 mm from a radius of 300."""
        angle = 2 * np.pi * 3 * np.arange(100)[:, None, None] / FPS
        circle = 0.3 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1)
        xyz = t_pose()[None, None] + circle
        cov = None if sigma is None else np.broadcast_to(sigma**2 * np.eye(3), (*xyz.shape, 3))
        off = np.linalg.norm(smooth(Poses3D(BODY25, xyz, cov=cov), FPS, 0.1).xyz - xyz, axis=-1)[20:-20]
        assert off.max() < most
        if sigma == 0.3:
            assert off.min() > 0.15

    @pytest.mark.parametrize(("metres", "hertz"), [(0.001, 2.34), (0.3, 5.85)])
    def test_power_is_halved_at_the_frequencies_of_the_documentation(self, metres, hertz):
        """Of motion within the stated error of 2 cm, and of larger motion."""
        wave = metres * np.sin(2 * np.pi * hertz * np.arange(2000) / 200)
        xyz, cov = np.zeros((2000, 1, 25, 3)), np.tile(0.02**2 * np.eye(3), (2000, 1, 25, 1, 1))
        xyz[..., 0] = wave[:, None, None]
        found = smooth(Poses3D(BODY25, xyz, cov=cov), 200, 0.1).xyz[..., 0]
        inner = slice(500, -500)
        assert (found[inner, 0, 0] @ wave[inner] / (wave[inner] @ wave[inner])) ** 2 == pytest.approx(0.5, abs=0.06)

    def test_source_says_what_was_moved(self):
        source = np.full((10, 1, 25), Source.MEASURED)
        source[3], source[4] = Source.COMPLETED, Source.DENOISED
        xyz = walkers(10, 1).xyz.copy()
        source[5], xyz[5] = Source.ABSENT, np.nan
        found = smooth(Poses3D(BODY25, xyz, source), FPS, 0.1).source
        assert (found[3] == Source.COMPLETED).all()
        assert (found[5] == Source.ABSENT).all()
        assert (np.delete(found, (3, 5), 0) == Source.DENOISED).all()

    def test_single_samples_stay_where_they_are(self):
        alone = without(walkers(frames=60), np.arange(60) % 30 != 7, slice(None), slice(None))
        np.testing.assert_allclose(smooth(alone, FPS, 0.1).xyz, alone.xyz, atol=1e-5)

    def test_zero_seconds_change_nothing(self):
        poses = walkers()
        assert smooth(poses, FPS, 0) is poses

    def test_poses_without_people_are_accepted(self):
        assert smooth(Poses3D(BODY25, np.empty((9, 0, 25, 3))), FPS, 0.1).xyz.shape == (9, 0, 25, 3)


def turning_at(fps: float) -> Poses3D:
    """Three seconds of a T-pose that turns, once in six."""
    time = np.arange(round(3 * fps)) / fps
    R = Rotation.from_rotvec(np.outer(2 * np.pi * time / 6, (0, 0, 1))).as_matrix()
    return Poses3D(BODY25, np.einsum("fij,kj->fki", R, t_pose())[:, None])


@pytest.mark.parametrize("fps", [5.0, 25.0, 240.0])
def test_an_outlier_is_dropped_filled_and_marked_completed(fps):
    truth = turning_at(fps)
    wrist, frame = BODY25.index("r_wrist")[0], len(truth.xyz) // 2
    xyz = truth.xyz.copy()
    off = 1.5 if fps == 5 else 0.3
    xyz[frame, 0, wrist] += (0, 0, off)
    found = fill_reject_pchip(Poses3D(BODY25, xyz, views=np.full(xyz.shape[:3], 3)), fps)
    assert np.argwhere(found.source == Source.COMPLETED).tolist() == [[frame, 0, wrist]]
    assert np.argwhere(found.rejected).tolist() == [[frame, 0, wrist]]
    assert np.linalg.norm(found.xyz - truth.xyz, axis=-1).max() < 0.03
    kept = np.delete(found.xyz, frame, 0)
    np.testing.assert_array_equal(kept, np.delete(xyz, frame, 0))


def test_outliers_of_several_frames_are_found():
    truth = turning()
    xyz = truth.xyz.copy()
    xyz[30:33, 0, 4] += (0.4, 0, 0)
    found = contradicted(xyz, FPS)
    assert np.argwhere(found).tolist() == [[frame, 0, 4] for frame in (30, 31, 32)]


def test_vigorous_motion_is_not_contradicted():
    """A hand moves in a circle of 25 cm one and a half times a second, with gaps in its path."""
    time = np.arange(100) / FPS
    phase = 2 * np.pi * 1.5 * time
    xyz = np.stack([0.25 * np.cos(phase), 0.25 * np.sin(phase), 0 * time], -1)[:, None, None]
    assert not contradicted(xyz, FPS).any()
    xyz[np.random.default_rng(0).random(100) < 0.2] = np.nan
    assert not contradicted(xyz, FPS).any()


def test_samples_at_the_ends_are_never_contradicted():
    xyz = turning().xyz.copy()
    xyz[0] += 0.5
    xyz[40:] += 0.5
    found = contradicted(xyz, FPS)
    assert not found[[0, 59]].any()


def test_rejection_brings_perturbed_poses_nearer_the_truth():
    """Strolling people with correlated noise, drift and outliers."""
    rng = np.random.default_rng(0)
    truth = circling_people(250, 4, rng=rng)
    poses = perturb(cut_gaps(truth, FPS, rng=rng), FPS, rng=rng)
    gone = contradicted(poses.xyz, FPS)
    off = np.linalg.norm(poses.xyz - truth.xyz, axis=-1)
    assert (off[gone] > 0.05).mean() > 0.6
    assert gone[off > 0.2].mean() > 0.6
    plain, without_them = fill_pchip_body(poses, FPS), fill_reject_pchip(poses, FPS)
    errors = [np.linalg.norm(found.xyz - truth.xyz, axis=-1).mean() for found in (plain, without_them)]
    assert errors[1] < errors[0]


ALL = list(completion_method)
SHIPPED_FOR = BODY25


@pytest.fixture(scope="module")
def fills():
    """The function of each method, learned ones with the weights that come with the package."""
    return {name: method.load() for name, method in completion_method.items()}


def random_gaps(seed: int = 0) -> Poses3D:
    """A person who turns, of whom a third of the joints is hidden."""
    xyz = turning(skeleton=SHIPPED_FOR).xyz.copy()
    xyz[np.random.default_rng(seed).random(xyz.shape[:3]) < 0.3] = np.nan
    return Poses3D(SHIPPED_FOR, xyz)


@pytest.mark.parametrize("name", ALL)
class TestEveryMethod:
    def test_has_one_line_of_help(self, name):
        text = completion_method[name].help
        assert text and "\n" not in text and text.endswith(".") and len(text) < 100

    def test_nothing_is_filled_where_nothing_is_known(self, name, fills):
        poses = Poses3D(SHIPPED_FOR, np.full((9, 2, 25, 3), np.nan))
        done = fills[name](poses, FPS)
        assert np.isnan(done.xyz).all() and not done.source.any()

    def test_poses_without_persons_or_frames_stay_empty(self, name, fills):
        for shape in ((9, 0, 25, 3), (0, 2, 25, 3)):
            assert fills[name](Poses3D(SHIPPED_FOR, np.empty(shape)), FPS).xyz.shape == shape

    def test_measured_joints_stay_or_say_that_they_were_moved(self, name, fills):
        poses = random_gaps()
        done = fills[name](poses, FPS)
        kept = done.source == Source.MEASURED
        assert done.xyz[kept].tobytes() == poses.xyz[kept].tobytes()
        assert not kept[~poses.measured].any()
        assert set(np.unique(done.source[poses.measured])) <= {Source.MEASURED, Source.DENOISED, Source.COMPLETED}
        if name not in ("kalman", "dmae_denoise", "dmae_online") and not name.startswith("reject"):
            assert (done.source[poses.measured] == Source.MEASURED).all()

    def test_what_is_filled_is_marked_completed_and_used_no_views(self, name, fills):
        poses = random_gaps()
        done = fills[name](poses, FPS)
        filled = ~poses.measured & ~np.isnan(done.xyz).any(-1)
        assert (done.source[filled] == Source.COMPLETED).all() and not done.views[filled].any()
        assert filled.any() == (name != "measured")

    def test_the_same_poses_give_the_same_answer(self, name, fills):
        poses = random_gaps(1)
        first, second = (fills[name](poses, FPS) for _ in range(2))
        assert first.xyz.tobytes() == second.xyz.tobytes() and (first.source == second.source).all()


def test_help_is_read_from_the_source_without_imports():
    code = (
        "from dmae.completion.methods import completion_method as methods; import sys; "
        "print({name: method.help for name, method in methods.items()}); "
        "print([name for name in sys.modules if name.startswith(('numpy', 'torch', 'dmae.data', 'dmae.online'))])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert found.splitlines() == [str({name: method.help for name, method in completion_method.items()}), "[]"]
    assert "dmae_online" in completion_method


def test_a_mistyped_name_is_answered_with_the_nearest():
    with pytest.raises(ValueError, match=r"no completion method 'lineer'; did you mean linear\? There are .*pchip"):
        find_method("lineer")


def test_a_function_of_another_package_is_a_method(tmp_path, monkeypatch):
    (tmp_path / "my_filling.py").write_text("def to_origin(poses, fps):\n    return poses\n")
    monkeypatch.syspath_prepend(tmp_path)
    poses = random_gaps()
    filled = find_method("my_filling:to_origin").load()(poses, FPS)
    np.testing.assert_array_equal(filled.xyz, poses.xyz)
    np.testing.assert_array_equal(filled.source, poses.source)
    for wrong, message in (
        ("my_filling:to_nowhere", r"my_filling has no function 'to_nowhere'; it has \['to_origin'\]"),
        ("not_there:to_origin", "cannot import not_there"),
        (":", "expected package.module:function"),
    ):
        with pytest.raises(ValueError, match=message):
            find_method(wrong)
    del sys.modules["my_filling"]


def test_a_method_is_added_by_a_decorator(monkeypatch):
    monkeypatch.setattr(completion_method, "_added", {})

    @completion_method("zero")
    def fill_zero(poses, fps):
        """Fill with zeros."""
        return poses

    assert find_method("zero").function.__wrapped__ is fill_zero and "zero" in completion_method
    with pytest.raises(ValueError, match="completion method 'zero': there is one already"):
        completion_method("zero")(lambda poses, fps: poses)
