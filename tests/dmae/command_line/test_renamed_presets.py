import pytest

from dmae.command_line.renamed_presets import renamed_options
from tests.support.commands import run_command

OLD = """# A detector of version 0.1.
name: mine
parts:
  nose: {noise: 0.02}
bias: 0.4
ghosts: 0.3
person_miss: 0.02
"""


@pytest.fixture
def presets(tmp_path):
    (tmp_path / "presets/detector").mkdir(parents=True)
    (tmp_path / "presets/detector/mine.yaml").write_text(OLD)
    return tmp_path / "presets"


def test_old_names_get_their_new_places():
    old = {"name": "mine", "parts": {"nose": {"noise": 0.02}}, "bias": 0.4, "ghosts": 0.3, "person_miss": 0.02}
    values, notes = renamed_options("synth generate", "detector", old)
    assert values == {
        "name": "mine",
        "parts": {"nose": {"noise": 0.02}},
        "noise": {"bias": 0.4},
        "ghosts": {"count": 0.3},
        "misses": {"person": 0.02},
    }
    assert len(notes) == 3 and all("until 0.3" in note for note in notes)
    assert renamed_options("synth generate", "detector", values) == (values, [])


def test_nested_options_are_renamed():
    old = {"half_ray": 0.1, "noise": {"unsure": 0.02}}
    values, _ = renamed_options("dmae capture", "capture", old)
    assert values == {"association": {"ray_distance_m": 0.1}, "noise": {"sigma_unsure_m": 0.02}}


def test_an_option_given_as_a_value_and_as_a_table_is_refused():
    with pytest.raises(ValueError, match="misses is given twice"):
        renamed_options("synth generate", "detector", {"misses": 1, "person_miss": 0.1})


def test_an_old_preset_works_with_a_note(presets, tmp_path):
    done = run_command(
        tmp_path, "synth", "generate", f"--config-dir={presets}", "detector=mine", "out=set", "clips=1",
        "scene.seconds=0.2",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "detector/mine.yaml: detector.bias is now called detector.noise.bias" in done.stderr
    assert "count: 0.3" in (tmp_path / "set/config.yaml").read_text()


def test_a_mistyped_option_of_a_preset_is_named(presets, tmp_path):
    (presets / "detector/mine.yaml").write_text("name: mine\nbais: 0.4\n")
    done = run_command(tmp_path, "synth", "generate", f"--config-dir={presets}", "detector=mine", "out=set")
    assert done.returncode == 1
    assert done.stderr.startswith("synth generate: error: ")
    assert "detector/mine.yaml: detector.bais: no such option; did you mean detector." in done.stderr
