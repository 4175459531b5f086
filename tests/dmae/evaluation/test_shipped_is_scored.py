"""`dmae evaluate` scores exactly the poses that `dmae complete` writes."""

from dataclasses import replace

import numpy as np
import pytest

import dmae
from dmae.commands import complete as complete_command
from dmae.commands.config import CompleteCommand
from dmae.completion.methods import completion_method, find_method
from dmae.data.store import load_clip, save_clip
from dmae.evaluation.config import SCORED, EvaluateConfig, Input
from dmae.evaluation.evaluate import filled_trials
from dmae.formats.reading import Clips, DataConfig
from tests.support.circling_people import circling_people, clip_of

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def trial(tmp_path_factory):
    """Perturbed poses of two people, and what each method makes of them."""
    clip = clip_of(circling_people(80, 2, rng=np.random.default_rng(3)), "circling")
    folder = tmp_path_factory.mktemp("circling")
    save_clip(clip, folder)
    config = EvaluateConfig(input=Input.perturbed_poses, smooth=CompleteCommand().smooth)
    methods = {name: find_method(name).load() for name in ("dmae_denoise", "dmae_online", "measured")}
    return next(iter(filled_trials(Clips(DataConfig(path=str(folder))), config, methods)))


@pytest.mark.parametrize("online", [False, True])
def test_command_function_and_score_are_one(trial, online, tmp_path):
    given, filled = trial
    scored = filled["dmae_online" if online else "dmae_denoise"]
    by_function = dmae.complete(given.given, given.clip.fps, online=online)
    save_clip(replace(given.clip, poses=given.given), tmp_path / "given")
    out = tmp_path / "out"
    complete_command.run(CompleteCommand(str(tmp_path / "given"), online=online, out=str(out)), out)
    for found in (by_function, load_clip(out).poses):
        for name in ("xyz", "cov", "source"):
            np.testing.assert_array_equal(getattr(found, name), getattr(scored, name))
    assert np.abs(by_function.xyz - given.given.xyz)[given.given.measured].max() > 0.001


def test_it_is_scored_by_default():
    assert {"measured", "dmae_denoise"} <= {*SCORED} <= {*completion_method}
    assert EvaluateConfig().methods is None


def test_what_was_measured_is_scored_as_it_is(trial):
    given, filled = trial
    np.testing.assert_array_equal(filled["measured"].xyz, given.given.xyz)
