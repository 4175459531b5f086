"""Scene specifications: deterministic by seed and clip, plausible, and stored as JSON."""

import json
import os
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from dmae.data.typed import decode
from synth.interactions.casting import draw_motions
from synth.interactions.registry import InteractionConfig
from synth.motion.config import MotionConfig, ProceduralConfig, UpAxis
from synth.people.body import SEGMENTS, body_at
from synth.people.clothing import WARDROBE
from synth.rooms.config import room_choices
from synth.rooms.props import footprints, prop_size
from synth.rooms.room import arena_file, prop_file
from synth.scene.config import SceneConfig
from synth.scene.sampling import load_motions, sample_scene
from synth.scene.spec import PropSpec, SceneSpec

MOTION = MotionConfig()
SHORT = SceneConfig(seconds=1.0)


def specs(config=SHORT, clips=range(6), seed=3) -> dict[int, SceneSpec]:
    return {clip: sample_scene(config, MOTION, seed=seed, clip=clip).spec for clip in clips}


def test_a_clip_does_not_depend_on_other_clips():
    assert specs(clips=[5, 2]) == {clip: spec for clip, spec in specs().items() if clip in (2, 5)}


def test_clips_and_seeds_differ():
    drawn = [*specs(clips=range(3)).values(), *specs(clips=range(3), seed=0).values()]
    assert len({spec.to_json() for spec in drawn}) == 6
    assert len({spec.persons[0].body for spec in drawn}) == 6


def test_json_preserves_spec_and_motions():
    spec = sample_scene(replace(SHORT, arena="office", props=[2, 3]), MOTION, seed=0, clip=1).spec
    again = SceneSpec.from_json(spec.to_json())
    assert again == spec
    for one, other in zip(load_motions(spec), load_motions(again), strict=True):
        np.testing.assert_array_equal(one.root, other.root)
        np.testing.assert_array_equal(one.rotations, other.rotations)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda spec: spec.pop("decor"), "SceneSpec: expected the fields"),
        (
            lambda spec: spec["persons"][0]["body"].update(stature="tall"),
            r"persons\[0\].body.stature: expected a ",
        ),
        (lambda spec: spec["persons"][0].update(start=[1.0]), r"persons\[0\].start: expected 2 values, found 1"),
        (lambda spec: spec.update(props={}), "props: expected a list"),
        (lambda spec: spec["motion"].update(kind="dance"), "no motion 'dance'; there are procedural, .*bvh"),
    ],
)
def test_a_malformed_spec_is_refused(change, message):
    data = json.loads(sample_scene(SHORT, MOTION, seed=0, clip=0).spec.to_json())
    change(data)
    with pytest.raises(ValueError, match=message):
        SceneSpec.from_json(json.dumps(data))


def test_optionals_dicts_and_enums_are_decoded():
    assert decode(float | None, None) is None
    assert decode(float | None, 2) == 2.0
    assert decode(dict[str, list[float]], {"a": [1, 2]}) == {"a": [1.0, 2.0]}
    assert decode(UpAxis, "z") is UpAxis.z


def test_children_are_drawn_on_request_only():
    grown, mixed = (replace(SHORT, persons=[4, 4], children=share) for share in (0.0, 0.5))
    ages = [[person.body.age for person in spec.persons] for spec in specs(mixed).values()]
    assert 4 < np.sum(np.array(ages) < 18) < 20
    assert specs(grown) == specs(replace(SHORT, persons=[4, 4]))


def test_what_people_wear_changes_nothing_else():
    config = replace(SHORT, persons=[4, 4])
    plain, worn = (specs(replace(config, wardrobe=wardrobe), range(15)) for wardrobe in ([], list(WARDROBE)))
    bare = {"hat": None, "beard": None, "bag": None, "coat": None}
    persons = [person for spec in worn.values() for person in spec.persons]
    men = [person for person in persons if person.body.feminine < 0.5]
    assert 0.1 < np.mean([person.looks.beard is not None for person in men]) < 0.45
    assert all(person in men for person in persons if person.looks.beard)
    looks = [person.looks for spec in worn.values() for person in spec.persons]
    assert 4 < sum(each.hat is not None for each in looks) < 16
    assert 4 < sum(person.looks.skirt for person in persons) < 15
    for clip, spec in worn.items():
        persons = []
        for person, without in zip(spec.persons, plain[clip].persons, strict=True):
            skirt = {"skirt": False, "bottom": without.looks.bottom, "untucked": without.looks.untucked}
            looks = replace(person.looks, **bare, **skirt) if person.looks.skirt else replace(person.looks, **bare)
            persons.append(replace(person, looks=looks))
        assert replace(spec, persons=tuple(persons)) == plain[clip]
        assert all(getattr(person.looks, name) is None for person in plain[clip].persons for name in bare)


def test_a_child_takes_shorter_and_quicker_steps():
    child, adult = body_at(0, 6), body_at(0)
    alone = ProceduralConfig(standing=0, straight=1, gesture=0, speed=[1.2, 1.2])
    walking = replace(MOTION, actions=[], procedural=alone)
    alike = [
        draw_motions(walking, InteractionConfig(), [body], 400, 25.0, 1.9, seed=0, clip=0)[0][0]
        for body in (child, adult)
    ]
    ways = [float(np.linalg.norm(motion.root[-1, :2] - motion.root[0, :2])) for motion in alike]
    thighs = [motion.rotations[:, SEGMENTS.index("l_thigh"), 0, 2] for motion in alike]
    strides = [np.abs(np.fft.rfft(thigh))[1:].argmax() + 1 for thigh in thighs]
    assert ways[0] / strides[0] == pytest.approx(child.hip_height / adult.hip_height * ways[1] / strides[1], rel=0.07)
    # Froude numbers, speed over the root of the legs' length, are equal.
    assert ways[0] / ways[1] == pytest.approx(np.sqrt(child.hip_height / adult.hip_height), rel=0.04)


@pytest.mark.parametrize("arena", room_choices())
def test_people_start_apart_stay_within_the_radius_and_meet(arena):
    config = SceneConfig(arena=arena, persons=[3, 4], seconds=4.0, radius=2.0)
    nearest = []
    for spec in specs(config, clips=range(4)).values():
        paths = np.stack([motion.root[:, :2] for motion in load_motions(spec)], axis=1)
        assert 3 <= len(spec.persons) <= 4
        assert np.linalg.norm(paths, axis=-1).max() < 2.3 + 1e-9
        apart = np.linalg.norm(paths[:, :, None] - paths[:, None], axis=-1) + 9 * np.eye(len(spec.persons))
        assert apart[0].min() > 0.5
        nearest.append(apart.min())
    assert np.median(nearest) < 1.0


def test_props_stand_clear_of_all_paths():
    config = SceneConfig(persons=[2, 2], seconds=2.0, props=[3, 3])
    count = 0
    for spec in specs(config, clips=range(8)).values():
        paths = np.stack([motion.root[:, :2] for motion in load_motions(spec)], axis=1)
        places = np.array([prop.at for prop in spec.props]).reshape(-1, 2)
        count += len(places)
        assert np.linalg.norm(paths[:, :, None] - places, axis=-1).min(initial=9) > 0.3
    assert count > 8


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"persons": [4, 2]}, "scene.persons: expected .least, greatest."),
        ({"persons": [0, 2]}, r"expected \[least, greatest\], 1 to 30 people"),
        ({"persons": [1, 31]}, r"expected \[least, greatest\], 1 to 30 people"),
        ({"children": 1.5}, "scene.children: expected a number from 0 to 1, found 1.5"),
        ({"seconds": 0.0}, "scene.seconds: expected more than 0 and at most 3600 s, found 0"),
        ({"seconds": -2.0}, "scene.seconds: expected more than 0"),
        ({"seconds": float("inf")}, "scene.seconds: expected more than 0 and at most 3600 s, found inf"),
        ({"fps": 0.0}, "scene.fps: expected more than 0 and at most 1000 frames per second, found 0"),
        ({"fps": float("nan")}, "scene.fps: .*found nan"),
        ({"radius": float("nan")}, "scene.radius: .* m, found nan"),
        ({"clearance": [0.6, 0.3]}, r"scene.clearance: expected \[least, greatest\], 0 m or more"),
        ({"clearance": [0.3, float("inf")]}, "scene.clearance"),
        ({"clearance": [0.4]}, "scene.clearance"),
        ({"wardrobe": ["cap"]}, "scene.wardrobe: no word 'cap'; did you mean caps"),
        ({"props": [0, 1], "prop_kinds": []}, "scene.prop_kinds is empty"),
    ],
)
def test_bad_configurations_are_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        SceneConfig(**fields)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"arena": "moon"}, "no arena 'moon'; .* living_room, .*office"),
        ({"prop_kinds": ["piano"]}, "no prop 'piano'; .* chair"),
        ({"radius": 0.4, "persons": [4, 4], "seconds": 4.0}, r"no room for P\d of 4.*scene.radius"),
    ],
)
def test_unknown_names_and_missing_space_are_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        sample_scene(SceneConfig(**fields), MOTION, seed=0, clip=0)


def test_rooms_and_props_of_your_own(tmp_path):
    for source in (arena_file("studio"), prop_file("chair")):
        (tmp_path / f"my_{source.name}").write_text(source.read_text())
    mine = replace(SHORT, arena=str(tmp_path / "my_studio.xml"), prop_kinds=[str(tmp_path / "my_chair.xml")])
    spec = sample_scene(replace(mine, props=[2, 2]), MOTION, seed=0, clip=0).spec
    assert all(isinstance(prop, PropSpec) and prop.kind.endswith("my_chair.xml") for prop in spec.props)


def test_rooms_and_props_may_change_between_clips(tmp_path):
    """As in a notebook, beside which the file is edited."""
    room, mesh = tmp_path / "bench.xml", tmp_path / "bench.stl"
    found = []
    for size in (0.4, 0.9):
        room.write_text(f'<mujoco><worldbody><geom type="box" size="{size} .3 .3" pos="0 0 .3"/></worldbody></mujoco>')
        trimesh.creation.box((2 * size, 0.6, 0.6)).export(mesh)
        os.utime(room, (size, size))
        os.utime(mesh, (size, size))
        found.append([np.abs(footprints(room)).sum(), *(prop_size(str(path)).size[0] for path in (room, mesh))])
    assert (np.diff(found, axis=0) > 0.5).all()


def test_footprints_cover_long_objects_with_discs(tmp_path):
    file = tmp_path / "bench.xml"
    file.write_text(
        '<mujoco><worldbody><body pos="1 2 0" euler="0 0 90"><geom type="box" size="1 .2 .3" pos="0 0 .3"/></body>'
        '<geom type="sphere" size=".5" pos="0 0 4"/><geom type="plane" size="1 1 1"/></worldbody></mujoco>'
    )
    discs = footprints(file)
    along = np.linspace(-1, 1, 21)
    corners = np.concatenate([np.column_stack([np.full(21, 1 + side), 2 + along]) for side in (-0.2, 0.2)])
    covered = np.linalg.norm(corners[:, None] - discs[:, :2], axis=-1) <= discs[:, 2] + 1e-9
    assert covered.any(1).all()
    assert discs[:, 2].max() < 0.3
