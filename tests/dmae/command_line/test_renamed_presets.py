import pytest
import yaml

from dmae.command_line.renamed_presets import update_presets
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
    for group, text in (("detector", OLD), ("capture", "half_ray: 0.1\nnoise: {unsure: 0.02}\n")):
        (tmp_path / "presets" / group).mkdir(parents=True)
        (tmp_path / "presets" / group / "mine.yaml").write_text(text)
    return tmp_path / "presets"


def test_old_names_get_their_new_places(presets, tmp_path):
    notes = update_presets("synth generate", presets, tmp_path / "copy")
    text = (tmp_path / "copy/detector/mine.yaml").read_text()
    assert text.startswith("# A detector of version 0.1.\n")
    assert yaml.safe_load(text) == {
        "name": "mine",
        "parts": {"nose": {"noise": 0.02}},
        "noise": {"bias": 0.4},
        "ghosts": {"count": 0.3},
        "misses": {"person": 0.02},
    }
    assert len(notes) == 3 and all("detector/mine.yaml" in note and "until 0.3" in note for note in notes)


def test_nested_options_are_renamed(presets, tmp_path):
    update_presets("dmae capture", presets, tmp_path / "copy")
    values = yaml.safe_load((tmp_path / "copy/capture/mine.yaml").read_text())
    assert values == {"association": {"ray_distance_m": 0.1}, "noise": {"sigma_unsure_m": 0.02}}


def test_presets_with_new_names_are_not_copied(presets, tmp_path):
    update_presets("synth generate", presets, tmp_path / "copy")
    assert update_presets("synth generate", tmp_path / "copy", tmp_path / "again") == []
    assert not (tmp_path / "again").exists()


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
    assert done.stderr.strip() == "synth generate: error: In 'detector/mine': Key 'bais' not in 'DetectorConfig'"
