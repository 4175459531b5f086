import itertools

import pytest

from dmae import progress as module
from dmae.progress import progress, progress_line


def test_items_pass_unchanged():
    assert list(progress(iter("abc"), "reading")) == ["a", "b", "c"]


def test_a_line_a_minute_without_a_terminal_forecasts_without_the_first_item(monkeypatch, capsys):
    clock = itertools.count(0, 40)
    monkeypatch.setattr(module.time, "monotonic", lambda: float(next(clock)))
    list(progress(range(5), "capturing"))
    lines = capsys.readouterr().err.splitlines()
    assert lines == [
        "capturing: 1 of 5, 1.3 min",
        "capturing: 3 of 5, 2.7 min, about 1.3 min left",
    ]


def test_short_work_prints_nothing(capsys):
    list(progress(range(100), "capturing"))
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("total", "line"), [(40, "reading: 10 of 40, 5.0 min, about 15.0 min left"), (None, "reading: 10, 5.0 min")]
)
def test_the_line_says_what_is_known(total, line):
    assert progress_line("reading", 10, total, 300) == line
