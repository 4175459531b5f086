"""Statistics against counts made one by one, and the page and picture that show them."""

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dmae.data.clip import Poses3D
from dmae.data.labels import Visibility
from dmae.data.skeleton import BODY25
from dmae.data.store import clip_folders, load_clip, save_clip, write_manifest
from synth.datasets.statistics import QUANTITIES, Statistics, draw, measure, measure_clip, numbers, page, quantiles
from tests.support.clips import full_clip, looking_inwards, t_pose
from tests.support.commands import synth
from tests.support.data_sets import pictured_set


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    return pictured_set(tmp_path_factory.mktemp("data") / "set", clips=3)


def bins(found: Statistics, name: str) -> dict[float, int]:
    """Counts by the middle of the bin."""
    edges, counts = QUANTITIES[name].edges, found.histograms[name]
    return {round(float(edges[i] + edges[i + 1]) / 2, 3): int(counts[i]) for i in np.flatnonzero(counts)}


def test_occlusion_is_counted_by_joint_cause_and_occluder():
    clip = full_clip()
    found = measure_clip(clip)
    code = clip.occlusion.visibility
    for joint in (0, 7, 24):
        for cause in Visibility:
            assert found.causes[joint, cause] == (code[..., joint] == cause).sum()
    assert found.occluders["box"] == (code == Visibility.HIDDEN_BY_OBJECT).sum()
    assert found.occluders["person"] == (code == Visibility.HIDDEN_BY_PERSON).sum()
    seen = (code == Visibility.VISIBLE).sum(1)[(code != Visibility.ABSENT).any(1)]
    assert bins(found, "visible_views") == {float(n): int(c) for n, c in enumerate(np.bincount(seen)) if c}
    assert bins(found, "visible_share") == {0.775: 12 * 4 * 2}
    assert found.counts == {
        "clips": 1,
        "frames": 12,
        "pictures": 48,
        "cameras=4": 1,
        "persons=2": 1,
        "seconds": 12 / 25,
    }


def test_distances_and_angles_of_a_person_who_faces_x():
    """Cameras in front, to the left, and behind and above the person."""
    rig = looking_inwards(np.array([[4.2, 0, 0.95], [0, 3.2, 0.95], [-2.0, 0.2, 3.2]]))
    xyz = np.tile(t_pose(), (2, 1, 1, 1))
    xyz[1, ..., 0] += 0.105
    clip = full_clip(2, 3)
    clip = replace(clip, rig=rig, true_rig=None, truth=Poses3D(BODY25, xyz), occlusion=None, fps=10)
    both, first = measure_clip(clip), measure_clip(clip.select([0]))
    assert bins(first, "distance") == {4.25: 1, 3.25: 2}
    assert bins(first, "azimuth") == {7.5: 1, 97.5: 1, 172.5: 1}
    assert bins(first, "elevation") == {3.75: 2, 48.75: 1}
    assert bins(both, "hip_speed") == {1.05: 1}
    assert bins(both, "wrist_speed") == {1.1: 2}
    assert bins(both, "persons_in_picture") == {1.0: 6}


def test_statistics_of_a_set_are_those_of_its_clips_from_any_number_of_processes(data):
    one, two = measure(data), measure(data, workers=2)
    whole = sum((measure_clip(load_clip(folder)) for folder in clip_folders(data)), Statistics())
    assert numbers(one, 0) == numbers(two, 0)
    assert numbers(one, 0)["histograms"] == numbers(whole, 0)["histograms"]
    assert one.counts["frames"] == 9 and one.scenes["motion=bvh"] == 3
    assert (len(one.persons), len(one.takes), len(one.rigs)) == (5, 6, 1)


def test_clips_of_several_skeletons_are_not_added_up(tmp_path):
    with pytest.raises(ValueError, match="clips of one skeleton"):
        measure_clip(full_clip()) + Statistics(joints=("nose",))


def test_quantiles_are_those_of_the_values():
    values = np.random.default_rng(0).gamma(2.0, 1.0, 5000)
    edges = np.arange(0, 20.1, 0.1)
    found = quantiles(np.histogram(values, edges)[0], edges)
    np.testing.assert_allclose(found, np.quantile(values, (0.05, 0.5, 0.95)), atol=0.06)


def test_what_is_not_there_is_not_measured():
    bare = replace(full_clip(), truth=None, occlusion=None, detection_labels=None)
    found = measure_clip(bare)
    text = page(found, "bare", 1)
    assert "1, and 1 that failed" in text and "clips without truth | 1" in text
    assert "Not measured: the clips have no labels" in text
    assert text.count("not measured") == len(QUANTITIES)
    assert Image.open(io.BytesIO(draw(found))).size == (1430, 1045)


def test_the_command_writes_page_picture_and_numbers(data, tmp_path):
    done = synth(tmp_path, "stats", f"data={data}", "out=card", "workers=2")
    assert done.returncode == 0, done.stderr
    assert "3 clips, 9 frames" in done.stdout
    text = (tmp_path / "card/README.md").read_text()
    assert "| clips by persons | 2: 3 |" in text and "| box |" in text and "![Histograms](statistics.png)" in text
    picture = np.asarray(Image.open(tmp_path / "card/statistics.png").convert("RGB"))
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50
    content = json.loads((tmp_path / "card/statistics.json").read_text())
    assert content["different"] == {"persons": 5, "takes": 6, "rigs": 1}
    assert synth(tmp_path, "stats", f"data={data}", "out=card").returncode == 0


def test_bad_input_is_refused(data, tmp_path):
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign/README.md").write_text("mine")
    clip = replace(load_clip(data / "000000"), images=None)
    save_clip(clip, tmp_path / "damaged/0")
    (tmp_path / "damaged/0/arrays.safetensors").write_bytes(b"")
    write_manifest(tmp_path / "damaged", [{"id": "0", "status": "ok"}])
    for arguments, said in (
        (("data=none", "out=out"), "none: expected a clip"),
        ((f"data={data}", "out=foreign"), "foreign: expected no such folder, an empty one, or one with an earlier"),
        ((f"data={data}", "out=foreign/README.md"), "expected a folder, found a file"),
        ((f"data={data}", "workers=0", "out=out"), "workers: expected"),
        (("data=damaged", "out=out"), "does not match the checksum"),
    ):
        done = synth(tmp_path, "stats", *arguments)
        assert done.returncode == 1
        assert said in done.stderr and len(done.stderr.splitlines()) == 1
    assert (tmp_path / "foreign/README.md").read_text() == "mine"
    assert not (tmp_path / "out").exists()
