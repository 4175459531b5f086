"""Statistics against counts made one by one, and the page and image that show them."""

import io
import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dmae.data.clip import Poses3D
from dmae.data.labels import Visibility
from dmae.data.skeleton import BODY25
from dmae.data.store import clip_folders, load_clip, save_clip, write_manifest
from synth.datasets.statistics import (
    QUANTITIES,
    Statistics,
    clip_contacts,
    draw,
    measure,
    measure_clip,
    numbers,
    page,
    quantiles,
    spread,
    terms,
)
from synth.people.body import SEGMENTS, Body
from synth.physics.body_state import BodyState
from tests.support.clips import full_clip, looking_inwards, t_pose
from tests.support.commands import synth
from tests.support.data_sets import image_set


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    return image_set(tmp_path_factory.mktemp("data") / "set", clips=3)


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
        "images": 48,
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
    assert bins(both, "persons_in_image") == {1.0: 6}


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


def test_the_command_writes_page_image_and_numbers(data, tmp_path):
    done = synth(tmp_path, "stats", f"data={data}", "out=card", "workers=2")
    assert done.returncode == 0, done.stderr
    assert "3 clips, 9 frames" in done.stdout
    text = (tmp_path / "card/README.md").read_text()
    assert "| clips by persons | 2: 3 |" in text and "| box |" in text and "![Histograms](statistics.png)" in text
    image = np.asarray(Image.open(tmp_path / "card/statistics.png").convert("RGB"))
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 50
    content = json.loads((tmp_path / "card/statistics.json").read_text())
    assert content["different"] == {"persons": 5, "takes": 6, "rigs": 1}
    assert synth(tmp_path, "stats", f"data={data}", "out=card").returncode == 0


@pytest.mark.parametrize("command", ["stats", "split", "export format=npz"])
def test_a_data_set_whose_clips_all_failed_is_refused(tmp_path, command):
    write_manifest(tmp_path / "set", [{"id": "000000", "status": "failed", "seed": 0}])
    done = synth(tmp_path, *command.split(), "data=set", "out=out")
    assert done.returncode == 1 and "set: no clip of this data set is ok, nothing to do" in done.stderr
    assert not (tmp_path / "out").exists()


def test_bad_input_is_refused(data, tmp_path):
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign/README.md").write_text("mine")
    clip = replace(load_clip(data / "000000"), images=None)
    save_clip(clip, tmp_path / "damaged/0")
    (tmp_path / "damaged/0/arrays.safetensors").write_bytes(b"")
    write_manifest(tmp_path / "damaged", [{"id": "0", "status": "ok"}])
    for arguments, said in (
        (("data=none", "out=out"), "data=none: no such file"),
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


# Contacts between people, against a state in which each contact is known.


def state(contacts: list[tuple[int, int, int, float]]) -> BodyState:
    """A state of 10 frames with contacts of frame, both indices of names, and force, N."""
    frame, one, other, force = np.array(contacts, float).reshape(-1, 4).T
    empty = np.zeros((10, 2, 3), np.float32)
    return BodyState(
        qpos=np.zeros((10, 7)),
        root=empty,
        rotations=np.zeros((10, 2, len(SEGMENTS), 4), np.float32),
        forces=np.zeros((10, 2, len(SEGMENTS) + 1, 3), np.float32),
        shapes=(Body(), Body()),
        actions=np.zeros((10, 2), np.int16),
        action_names=("hug",),
        contact_frame=frame.astype(np.int32),
        contact_between=np.stack([one, other], 1).astype(np.int16),
        contact_names=("person0/l_hand", "person0/chest", "person1/chest", "personal_box"),
        contact_point=np.zeros((len(frame), 3), np.float32),
        contact_force=np.stack([0 * force, force, 0 * force], 1).astype(np.float32),
        contact_depth=np.zeros(len(frame), np.float32),
    )


def test_only_contacts_between_different_people_count():
    # A hand on one's own chest and on a box, then on the other's chest, twice.
    found = clip_contacts(state([(0, 0, 1, 9), (1, 0, 3, 9), (2, 0, 2, 5), (3, 2, 0, 7), (3, 1, 2, 3), (8, 0, 2, 6)]))
    assert found == (10, 3, 2, 6.0)
    assert clip_contacts(state([])) == (10, 0, 0, 0.0)


def test_the_spread_of_clips():
    found = spread([clip_contacts(state([(k, 0, 2, 4.0) for k in range(n)])) for n in (2, 5, 9)])
    assert [found[f"share_{which}"] for which in ("least", "median", "most")] == [0.2, 0.5, 0.9]
    assert found["clips"] == 3
    assert found["touches_most"] == 1


# A data set's page says which inputs bring terms of their own.


def section(**scenes: int) -> str:
    return terms(Counter({key.replace("__", "="): count for key, count in scenes.items()}))


def test_what_is_made_by_code_belongs_to_the_user():
    found = section(motion__procedural=3, arena__office=3)
    assert "belong to you" in found
    assert "Recorded motion" not in found
    assert "Rooms from files" not in found


def test_recorded_motion_and_foreign_rooms_bring_their_terms():
    found = section(motion__procedural=3, motion__bvh=1, motion__amc=2, arena__office=3, **{"arena__my/room.xml": 3})
    assert "**Recorded motion** (amc: 2 clips, bvh: 1 clip)" in found
    assert "**Rooms from files** (my/room.xml: 3 clips)" in found


def test_clips_of_unknown_origin_are_not_said_to_be_free():
    assert "Not simulated by this project" in section()
