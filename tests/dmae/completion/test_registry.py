"""Completion methods: requirements on each kind, lookup by name, and adding a method."""

import subprocess
import sys

import numpy as np
import pytest

from dmae.completion.methods import METHODS, completion_method, find_method
from dmae.completion.methods.registry import RENAMED
from dmae.data.clip import Poses3D, Source
from dmae.data.skeleton import BODY25
from tests.support.gaps import FPS, turning

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
        "from dmae.completion.methods.registry import completion_method as methods; import sys; "
        "print({name: method.help for name, method in methods.items()}); "
        "print([name for name in sys.modules if name.startswith(('numpy', 'torch', 'dmae.data', 'dmae.online'))])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert found.splitlines() == [str({name: method.help for name, method in completion_method.items()}), "[]"]
    assert "dmae_online" in completion_method


def test_a_mistyped_name_is_answered_with_the_nearest():
    with pytest.raises(ValueError, match=r"no completion method 'lineer'; did you mean 'linear'\? There are .*pchip"):
        find_method("lineer")


@pytest.mark.parametrize(("old", "new"), RENAMED.items())
def test_renamed_methods_are_found_by_their_old_names_with_a_note(old, new):
    with pytest.warns(FutureWarning, match=f"{old} is now called {new}; the old name works until 0.3"):
        assert find_method(old).name == new


def test_learned_methods_are_not_among_those_that_need_no_training():
    assert "dmae" in completion_method and "dmae" not in list(METHODS)
    with pytest.raises(KeyError, match="needs weights"):
        METHODS["dmae"]


def test_a_function_of_another_package_is_a_method(tmp_path, monkeypatch):
    (tmp_path / "my_filling.py").write_text("def to_origin(poses, fps):\n    return poses\n")
    monkeypatch.syspath_prepend(tmp_path)
    poses = random_gaps()
    assert find_method("my_filling:to_origin").load()(poses, FPS) is poses
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

    assert find_method("zero").function is fill_zero and "zero" in METHODS
    with pytest.raises(ValueError, match="completion method 'zero': there is one already"):
        completion_method("zero")(lambda poses, fps: poses)
