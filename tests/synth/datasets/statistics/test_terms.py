"""A data set's page says which inputs bring terms of their own."""

from collections import Counter

from synth.datasets.statistics import Statistics, terms


def section(**scenes: int) -> str:
    return terms(Statistics(scenes=Counter({key.replace("__", "="): count for key, count in scenes.items()})))


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
