"""Options of training: old names lead to options that exist, and impossible values are refused."""

import dataclasses

import pytest

from dmae.cli import DMAE
from dmae.command_line.renamed import RENAMED, renamed
from dmae.completion.network.config import ModelConfig
from dmae.completion.training.config import TrainConfig
from tests.support.training import changed

OPTIONS = {old: new for old, new in RENAMED["dmae train"].items() if "=" not in old}


@pytest.mark.parametrize(("old", "new"), OPTIONS.items())
def test_old_options_lead_to_new_ones(old, new):
    options = DMAE.commands["train"].options()
    assert options.find(new) is not None
    found, (note, *_) = renamed("dmae train", [f"{old}=1"])
    assert found == [f"{new}=1"] and note.startswith(f"{old} is now called {new};")


def test_options_under_an_old_group_and_old_features_are_renamed():
    found, _ = renamed("dmae train", ["hiding.bursts=3", "augment.noise=0.1", "model.blind=[carried,gap]"])
    assert found == ["examples.masking.bursts=3", "examples.augment.noise=0.1", "model.ablate=[held,gap]"]


@pytest.mark.parametrize("config", [TrainConfig, ModelConfig])
def test_no_level_has_more_than_a_dozen_options(config):
    def levels(kind):
        parts = dataclasses.fields(kind)
        yield kind, len(parts)
        for part in parts:
            if part.default_factory is not dataclasses.MISSING and dataclasses.is_dataclass(part.default_factory):
                yield from levels(part.default_factory)

    crowded = {kind.__name__: count for kind, count in levels(config) if count > 12}
    assert not {name for name in crowded if name not in ("CaptureConfig", "DataConfig")}


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"steps": 0}, "learning.steps: expected at least 1"),
        ({"average": 1.0}, r"learning.average: expected a decay in \[0, 1\)"),
        ({"held_back": 1.0}, r"examples.held_back: expected a share in \[0, 1\)"),
        ({"replay": 2.0}, "examples.replay=2.0: expected a share"),
        ({"replay": 0.5}, r"examples.replay=0.5: expected extra_data=\[...\]"),
    ],
)
def test_impossible_values_are_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        changed(TrainConfig(), **wrong)
