"""What every kind of detector error has to do. A new kind is tested as soon as it is a field of `DetectorConfig`."""

import sys
from dataclasses import fields, replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from dmae.data.labels import JointError, Visibility
from dmae.data.skeleton import BODY25
from synth.detector.config import DetectorConfig
from synth.detector.parts import PartConfig, by_joint
from synth.detector.view import Times, View
from tests.support.detectors import CLEAN, FPS, everywhere, preset, run

ERRORS = list(DetectorConfig().errors())
TERRIBLE = preset("terrible")
FRAMES, PERSONS = 60, 3


def view(config: DetectorConfig = TERRIBLE) -> View:
    """Return three persons as one camera detects them without error. One joint and one person are absent for a time."""
    rng = np.random.default_rng(0)
    xyz = rng.normal(0, 0.3, (1, PERSONS, 25, 3)) + 0.1 * np.arange(FRAMES)[:, None, None, None] / FRAMES
    true_xy = (200 * xyz[..., :2] + (320, 240)).copy()
    true_xy[:, 0, 4] = np.nan
    true_xy[20:30, 1] = np.nan
    codes = np.zeros(true_xy.shape[:-1], np.uint8)
    codes[:, 0, :20] = Visibility.HIDDEN_BY_PERSON
    made = View(
        fps=FPS,
        size=np.array([640, 480]),
        xyz=xyz,
        true_xy=true_xy,
        visibility=codes,
        occluder=np.where(codes == Visibility.HIDDEN_BY_PERSON, 2, -1).astype(np.int16),
        parts=by_joint(config.parts),
        times=config.times,
        minimum_score=config.scores.minimum,
        random=lambda *stream: np.random.default_rng(stream),
    )
    return made.reported()


def assert_same(found: View, want: View) -> None:
    for name in ("true_xy", "visibility", "xy", "score", "owner", "kind", "person", "shown"):
        np.testing.assert_array_equal(getattr(found, name), getattr(want, name), name)


@pytest.mark.parametrize("name", ERRORS)
def test_an_error_is_switched_off_by_default(name):
    clean = view(everywhere(PartConfig(miss=[0, 0, 0, 0])))
    assert_same(getattr(CLEAN, name).apply(clean), clean)


@pytest.mark.parametrize("name", ERRORS)
def test_the_preset_terrible_switches_every_error_on(name):
    assert getattr(TERRIBLE, name) != getattr(CLEAN, name)
    start = view()
    with pytest.raises(AssertionError):
        assert_same(getattr(TERRIBLE, name).apply(start), start)


@pytest.mark.parametrize("name", ERRORS)
def test_the_same_streams_give_the_same_errors(name):
    error = getattr(TERRIBLE, name)
    assert_same(error.apply(view()), error.apply(view()))


@pytest.mark.parametrize("name", ERRORS)
def test_joints_that_are_unknown_stay_absent(name):
    start = view()
    found = getattr(TERRIBLE, name).apply(start).reported()
    np.testing.assert_array_equal(np.isnan(found.xy).any(-1), np.isnan(found.score))
    owned = (found.owner[..., None] == np.arange(PERSONS)) & found.observed[..., None]
    lost = np.isnan(start.true_xy).any(-1).swapaxes(1, 2)[:, None]
    # Timing looks a frame ahead and back, and an inversion puts a joint of the other side there.
    if name not in ("timing", "inversions"):
        assert not (owned & lost).any()


@pytest.mark.parametrize("name", ERRORS)
def test_arrays_keep_their_shapes_and_types(name):
    found = getattr(TERRIBLE, name).apply(view())
    detections = found.xy.shape[1]
    assert found.xy.shape == (FRAMES, detections, 25, 2)
    assert found.score.shape == found.owner.shape == found.kind.shape == (FRAMES, detections, 25)
    assert (found.owner.dtype, found.kind.dtype, found.person.shape) == (np.int16, np.uint8, (detections,))
    assert found.shown.shape == (FRAMES,)
    assert ((found.owner < 0) == (found.person < 0)[:, None]).all()


@pytest.mark.parametrize("name", ERRORS)
def test_every_parameter_is_documented(name):
    error = getattr(DetectorConfig(), name)
    assert error.__doc__
    source = sys.modules[type(error).__module__].__file__
    text = Path(source).read_text()
    for one in fields(error):
        assert f"    {one.name}: " in text
        assert text.split(f"    {one.name}: ", 1)[1].split("\n", 1)[1].lstrip().startswith('"""')


def test_an_error_of_your_own_is_named_by_module_and_function(truth, occlusion, rig, monkeypatch):
    module = ModuleType("my_errors")

    def lose_left_wrist(view: View, *, rng: np.random.Generator) -> View:
        joints = np.zeros(view.score.shape, bool)
        joints[..., BODY25.index("l_wrist")] = rng.random((*view.score.shape[:2], 1)) < 0.5
        return view.without(joints)

    module.lose_left_wrist = lose_left_wrist
    monkeypatch.setitem(sys.modules, "my_errors", module)
    detector = everywhere(PartConfig(miss=[0, 0, 0, 0]))
    custom = replace(detector, custom=["my_errors:lose_left_wrist"])
    whole, found, again = (run(truth, occlusion, rig, config).detections for config in (detector, custom, custom))
    wrist, others = BODY25.index("l_wrist"), [j for j in range(25) if j not in BODY25.index("l_wrist")]
    assert 0.4 < found.observed[..., wrist].sum() / whole.observed[..., wrist].sum() < 0.6
    assert found.observed[..., others].sum() == whole.observed[..., others].sum()
    np.testing.assert_array_equal(found.xy, again.xy)
    labels = run(truth, occlusion, rig, custom).labels
    assert (labels.error[~found.observed] == JointError.ABSENT).all()
    module.lost = lambda view, rng: None
    with pytest.raises(ValueError, match="my_errors:lost: expected it to return a View, found NoneType"):
        run(truth, occlusion, rig, replace(detector, custom=["my_errors:lost"]))


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("my_errors", "expected package.module:function"),
        ("no_such_module:lose", "cannot import no_such_module"),
        ("math:floor", "detector.custom=math:floor: expected a function of a synth.detector.view.View and rng, as in"),
        ("synth.detector.view:lose", r"has no function 'lose'; it has \[.*'box', 'height'\]"),
    ],
)
def test_an_error_of_your_own_that_is_not_there_is_refused(truth, occlusion, rig, name, message):
    with pytest.raises(ValueError, match=message):
        run(truth, occlusion, rig, replace(CLEAN, custom=[name]))


def test_times_of_errors_are_checked():
    with pytest.raises(ValueError, match=r"detector\.times\.correlation: expected 0 or more, found -1"):
        Times(correlation=-1)
