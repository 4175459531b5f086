"""Numbers of things in words."""

from dmae.reporting.tables import counted


def test_one_thing_is_singular():
    assert [counted(number, "clip") for number in (0, 1, 2)] == ["0 clips", "1 clip", "2 clips"]
    assert [counted(number, "person", "people") for number in (1, 3)] == ["1 person", "3 people"]
