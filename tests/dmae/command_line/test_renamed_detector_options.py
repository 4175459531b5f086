"""Old names of the simulated detector's options."""

import pytest

from dmae.command_line.renamed import RENAMED, renamed


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("detector.ghosts=1.5", "detector.ghosts.count=1.5"),
        ("detector.together=0.9", "detector.misses.limb_correlation=0.9"),
        ("detector.out_of_step=1", "detector.timing.unsynchronised=1"),
        ("detector.bursts=[3,0.4]", "detector.times.bursts=[3,0.4]"),
    ],
)
def test_an_old_option_is_replaced_with_a_note(old, new):
    found, (note,) = renamed("synth generate", [old])
    assert found == [new]
    assert note.startswith(f"{old.partition('=')[0]} is now called {new.partition('=')[0]};")


@pytest.mark.parametrize(
    "option", ["detector.ghosts.joints=0.5", "detector.ghosts.count=1", "detector.parts.ear.miss=[]"]
)
def test_a_new_option_is_left_alone(option):
    assert renamed("synth fit-detector", [option]) == ([option], [])


def test_new_names_are_options_of_the_detector():
    from synth.detector.config import DetectorConfig

    detector = DetectorConfig()
    for new in (name for old, name in RENAMED["synth generate"].items() if old.startswith("detector.")):
        _, error, parameter = new.split(".")
        assert hasattr(getattr(detector, error), parameter)
