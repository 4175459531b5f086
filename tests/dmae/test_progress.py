import io
import itertools
from types import SimpleNamespace

import pytest
from rich.console import Console

from dmae import progress as module
from dmae.progress import counted_progress, progress, progress_line


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


def test_parts_counted_elsewhere_are_forecast_without_the_first_ones(monkeypatch, capsys):
    """As images are, of which the first comes after the simulation: 1 of 750 after 2 minutes forecast 25 hours."""
    clock, waits, counts = itertools.count(0, 30), iter([False] * 4 + [True]), itertools.count()
    event = SimpleNamespace(wait=lambda seconds: next(waits), set=lambda: None)
    monkeypatch.setattr(module.time, "monotonic", lambda: float(next(clock)))
    monkeypatch.setattr(module.threading, "Event", lambda: event)
    watcher = SimpleNamespace(start=lambda: None)
    monkeypatch.setattr(module.threading, "Thread", lambda target, daemon: setattr(watcher, "join", target) or watcher)
    list(counted_progress([], "rendering", lambda: (next(counts), 750)))
    assert capsys.readouterr().err.splitlines() == [
        "rendering: 1 of 750, 1.0 min",
        "rendering: 3 of 750, 2.0 min, about 373.5 min left",
    ]


def test_names_with_brackets_are_shown_on_a_terminal(monkeypatch):
    screen = io.StringIO()
    monkeypatch.setattr(module, "Console", lambda **_: Console(file=screen, force_terminal=True, width=100))
    assert list(progress("abc", "images of walk [take 2]")) == ["a", "b", "c"]
    assert "images of walk [take 2]" in screen.getvalue()


def test_short_work_prints_nothing(capsys):
    list(progress(range(100), "capturing"))
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("total", "line"), [(40, "reading: 10 of 40, 5.0 min, about 15.0 min left"), (None, "reading: 10, 5.0 min")]
)
def test_the_line_says_what_is_known(total, line):
    assert progress_line("reading", 10, total, 300) == line
