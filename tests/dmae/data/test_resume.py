import json

import pytest

from dmae.data.resume import claim_folder


def test_the_first_run_writes_its_settings_and_the_same_ones_resume_it(tmp_path):
    path = tmp_path / "run" / "config.json"
    claim_folder(path, {"seed": 0, "scene": {"fps": 25.0, "size": (1, 2)}}, "a data set")
    assert json.loads(path.read_text()) == {"seed": 0, "scene": {"fps": 25.0, "size": [1, 2]}}
    before = path.stat().st_mtime_ns
    claim_folder(path, {"scene": {"size": (1, 2), "fps": 25.0}, "seed": 0}, "a data set")
    assert path.stat().st_mtime_ns == before


@pytest.mark.parametrize(
    ("settings", "names"),
    [
        ({"seed": 1, "scene": {"fps": 25.0, "middle": None}}, "seed"),
        ({"seed": 0, "scene": {"fps": 30.0, "middle": None}}, r"scene\.fps"),
        ({"seed": 0, "scene": {"fps": 25.0}}, r"scene\.middle"),
        ({"seed": 0, "scene": {"fps": 25.0, "middle": None, "walls": None}}, r"scene\.walls"),
        ({"seed": 1, "scene": {}}, r"scene, scene\.fps, scene\.middle, seed"),
    ],
)
def test_other_settings_are_refused_by_name(tmp_path, settings, names):
    path = tmp_path / "config.json"
    claim_folder(path, {"seed": 0, "scene": {"fps": 25.0, "middle": None}}, "a data set")
    with pytest.raises(
        ValueError, match=rf"data set of another configuration: config\.json differs in {names}\. Choose"
    ):
        claim_folder(path, settings, "a data set")


def test_a_long_list_of_differences_is_cut(tmp_path):
    path = tmp_path / "config.json"
    claim_folder(path, {}, "a data set")
    with pytest.raises(ValueError, match=r"differs in a0, .*, a7 and 2 more\. Choose"):
        claim_folder(path, {f"a{number}": 1 for number in range(10)}, "a data set")
