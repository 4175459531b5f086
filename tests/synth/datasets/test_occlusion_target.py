"""Occlusion: counted exactly, generated at a requested level, or refused with advice."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.data.labels import Visibility
from dmae.data.rng import Stream, generator
from synth.datasets.clip import generate_clip
from synth.datasets.config import GenerateConfig, OcclusionConfig
from synth.datasets.generate import generate
from synth.datasets.occlusion import histogram, sample_hidden_scene, share, summary
from synth.errors import FailedSimulation
from synth.motion.config import MotionConfig
from synth.rigs.config import RigConfig, RingConfig
from synth.rigs.rig import make_rig
from synth.scene.config import SceneConfig
from synth.scene.sampling import lay_out, load_motions, sample_people, sample_scene

RING = RigConfig(ring=RingConfig(views=4))
RIG = make_rig(RING, rng=generator(0, 0, Stream.CAMERAS))
SCENE = SceneConfig(persons=[2, 2], seconds=1.0)
SEEN, SELF, PERSON, OBJECT = (Visibility(code) for code in range(4))


def states(*joints) -> np.ndarray:
    """(1, V, 1, 39): the first joints as given, one tuple of V states each, all others absent."""
    visibility = np.full((1, len(joints[0]), 1, 39), Visibility.ABSENT, np.uint8)
    visibility[0, :, 0, : len(joints)] = np.transpose(joints)
    return visibility


HALF_HIDDEN = states(
    (SEEN, SEEN, SEEN),
    (SELF, SEEN, OBJECT),
    (PERSON, OBJECT, SELF),
    (Visibility.OUTSIDE_IMAGE, Visibility.BEHIND_CAMERA, PERSON),
)


def test_a_histogram_counts_the_cameras_in_which_a_joint_is_hidden():
    np.testing.assert_allclose(histogram(HALF_HIDDEN), (1 / 4, 1 / 4, 1 / 4, 1 / 4))
    np.testing.assert_allclose(histogram(HALF_HIDDEN, by_self=False), (1 / 4, 2 / 4, 1 / 4, 0))
    np.testing.assert_array_equal(histogram(np.full((2, 3, 1, 39), Visibility.ABSENT)), np.zeros(4))


def test_a_summary_states_target_and_result():
    assert "target" not in summary(HALF_HIDDEN, OcclusionConfig())
    asked = OcclusionConfig(target=[0.4, 0.6], views=2)
    found = summary(HALF_HIDDEN, asked)
    assert (found["share"], found["target"], found["views"], found["by_self"]) == (0.5, [0.4, 0.6], 2, True)
    assert found["hidden_in"] == [0.25] * 4
    assert found["hidden_in_by_others"] == [0.25, 0.5, 0.25, 0.0]
    assert found["absent"] == round(21 / 25, 4)
    assert share(HALF_HIDDEN, replace(asked, by_self=False)) == 0.25


def test_only_joints_of_body25_count():
    visibility = np.full((1, 2, 1, 39), SEEN)
    visibility[..., 25:] = OBJECT
    found = summary(visibility, OcclusionConfig())
    assert found["hidden_in"] == [1.0, 0.0, 0.0]
    assert (found["visible"], found["hidden_by_object"]) == (1.0, 0.0)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"target": [0.5, 0.3]}, r"occlusion.target: expected \[least, greatest\].*found \[0.5, 0.3\]"),
        ({"target": [0.3, 0.3]}, "occlusion.target"),
        ({"target": [-0.1, 0.3]}, "occlusion.target"),
        ({"target": [0.3, 1.2]}, "occlusion.target"),
        ({"target": [0.3]}, "occlusion.target"),
        ({"target": [float("nan"), 0.4]}, "occlusion.target"),
        ({"views": 0}, "occlusion.views: expected 1 or more"),
    ],
)
def test_impossible_targets_are_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        OcclusionConfig(**fields)


def test_more_views_than_cameras_are_refused_before_anything_is_written(tmp_path):
    config = GenerateConfig(
        out=str(tmp_path / "data"), rig=RING, scene=SCENE, occlusion=OcclusionConfig(target=[0.1, 0.2], views=5)
    )
    with pytest.raises(ValueError, match="hidden in 5 cameras, the rig has 4; expected 1 to 4"):
        generate(config)
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize("views", [2, 5, 9])
def test_a_target_means_the_same_with_any_number_of_cameras(views):
    rig = RigConfig(ring=RingConfig(views=views))
    config = GenerateConfig(rig=rig, scene=SCENE, occlusion=OcclusionConfig(target=[0.3, 0.5]))
    clip = generate_clip(config, 0)
    joints = clip.occlusion.visibility[..., :25]
    hidden = ((joints >= SELF) & (joints <= OBJECT)).mean()
    assert 0.3 <= hidden <= 0.5
    assert clip.provenance["manifest"]["occlusion"]["share"] == pytest.approx(hidden, abs=1e-4)


@pytest.mark.parametrize(("target", "views"), [([0.05, 0.2], 3), ([0.4, 0.6], 3)])
def test_a_target_is_met(target, views):
    config = GenerateConfig(rig=RING, scene=SCENE, occlusion=OcclusionConfig(target=target, views=views))
    clip = generate_clip(config, 1)
    found = clip.provenance["manifest"]["occlusion"]
    hidden = (clip.occlusion.visibility >= SELF) & (clip.occlusion.visibility <= OBJECT)
    counted = (hidden[..., :25].sum(1) >= views).mean()
    assert target[0] <= counted <= target[1]
    assert found["share"] == pytest.approx(counted, abs=1e-4)
    assert sum(found["hidden_in"][views:]) == pytest.approx(counted, abs=1e-3)


def test_the_scene_depends_only_on_seed_and_clip():
    asked = OcclusionConfig(target=[0.3, 0.5])
    one, again, other = (
        sample_hidden_scene(GenerateConfig(scene=SCENE, occlusion=asked), RIG, seed=2, clip=clip).spec
        for clip in (4, 4, 5)
    )
    assert one == again
    assert one != other


def test_the_search_paints_nothing(monkeypatch):
    """Labels need no textures, which took three quarters of the time of a search."""

    def painted(*_, **__):
        raise AssertionError("painted")

    for paint in ("paint", "paint_skin", "paint_clothes"):
        monkeypatch.setattr(f"synth.people.mjcf.{paint}", painted)
    config = GenerateConfig(scene=SCENE, occlusion=OcclusionConfig(target=[0.3, 0.5]))
    assert sample_hidden_scene(config, RIG, seed=2, clip=4).spec.persons


def test_people_are_the_same_in_every_layout():
    people = sample_people(SCENE, MotionConfig(), seed=0, clip=0)
    streams = generator(0, 0, Stream.LAYOUT).spawn(2)
    specs = [lay_out(people, SCENE, rng=rng, cameras=((3.5, 0.0),)).spec for rng in streams]
    specs.append(sample_scene(SCENE, MotionConfig(), seed=0, clip=0).spec)
    assert len({tuple((person.body, person.looks, person.motion) for person in spec.persons) for spec in specs}) == 1
    assert len({tuple(person.start for person in spec.persons) for spec in specs}) == 3
    lengths = [np.linalg.norm(np.diff(load_motions(spec)[0].root, axis=0), axis=1).sum() for spec in specs]
    np.testing.assert_allclose(lengths, lengths[0], rtol=0.3)


def test_props_are_placed_in_front_of_the_cameras():
    people, many = sample_people(SCENE, MotionConfig(), seed=0, clip=0), replace(SCENE, props=[8, 8])
    (rng,) = generator(0, 0, Stream.LAYOUT).spawn(1)
    spec = lay_out(people, many, rng=rng, clearance=0.5, cameras=((3.5, 0.0),)).spec
    places = np.array([prop.at for prop in spec.props])
    assert len(places) >= 3
    assert np.median(places[:, 0]) > 0.5
    assert np.linalg.norm(places - (3.5, 0), axis=1).min() > 0.6


def test_a_target_out_of_reach_is_refused_with_remedies():
    asked = OcclusionConfig(target=[0.0, 0.01], views=1)
    with pytest.raises(FailedSimulation) as failure:
        sample_hidden_scene(GenerateConfig(scene=SCENE, occlusion=asked), RIG, seed=0, clip=0)
    message = str(failure.value)
    assert "occlusion.target=[0.0, 0.01] is not met" in message
    assert "in at least 1 of 4 cameras" in message
    assert all(f"({number}) " in message for number in (1, 2))
    assert "fewer people" in message


def test_a_data_set_of_a_target_out_of_reach_is_not_begun(tmp_path):
    config = GenerateConfig(
        out=str(tmp_path / "data"), clips=1, retries=0, rig=RING, scene=SCENE,
        occlusion=OcclusionConfig(target=[0.97, 1.0], views=4),
    )  # fmt: skip
    with pytest.raises(FailedSimulation, match=r"is not met.*What would help: \(1\) a target around"):
        generate(config)
    assert not (tmp_path / "data").exists()
