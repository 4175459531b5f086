import io
import itertools
import time
from types import SimpleNamespace

import pytest
from rich.console import Console

from dmae import progress as module
from dmae.progress import counted_progress, progress, progress_line


def test_items_pass_unchanged():
    assert list(progress(iter("abc"), "reading")) == ["a", "b", "c"]


def test_a_line_a_minute_without_a_terminal_also_while_one_item_lasts(monkeypatch, capsys):
    """Pieces of videos take minutes each; nothing was printed until one was done."""
    monkeypatch.setattr(module, "LINE_EVERY", 0.05)
    for item in progress(range(2), "detecting"):
        time.sleep(0 if item else 0.5)
    lines = capsys.readouterr().err.splitlines()
    assert 1 <= len(lines) <= 10
    assert lines[0].startswith("detecting: 0 of 2, ")


def test_an_outer_loop_prints_only_what_is_new_while_an_inner_one_prints(monkeypatch, capsys):
    monkeypatch.setattr(module, "LINE_EVERY", 0.05)
    for _ in progress(range(2), "clips"):
        for _ in progress(range(1), "frames"):
            time.sleep(0.5)
    lines = [line.partition(",")[0] for line in capsys.readouterr().err.splitlines()]
    assert lines.count("clips: 1 of 2") == 1
    assert lines.count("frames: 0 of 1") > 3
    # On a busy machine a line may come before the first inner loop, or after the last.
    assert len([line for line in lines if line.startswith("clips")]) <= 3


def test_the_forecast_leaves_the_first_parts_out(monkeypatch, capsys):
    """As images are, of which the first comes after the simulation: 1 of 750 after 2 minutes forecast 25 hours."""
    clock, waits, counts = itertools.count(0, 30), iter([False] * 4 + [True]), itertools.count()
    event = SimpleNamespace(wait=lambda seconds: next(waits), set=lambda: None)
    monkeypatch.setattr(module.time, "monotonic", lambda: float(next(clock)))
    monkeypatch.setattr(module.threading, "Event", lambda: event)
    monkeypatch.setattr(
        module.threading, "Thread",
        lambda target, args, daemon: SimpleNamespace(start=lambda: None, join=lambda: target(*args)),
    )  # fmt: skip
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
