"""A time limit of training includes the steps that follow training."""

import time

from dmae.completion.training.time_limit import TimeLimit


def test_without_minutes_there_is_no_end():
    limit = TimeLimit(None)
    limit.reserve((lambda: time.sleep(10), 100))
    assert not limit.limited and limit.training() == limit.until() == float("inf")
    assert list(limit.while_left(range(3))) == [0, 1, 2]


def test_time_is_kept_for_what_follows_by_trying_it():
    limit = TimeLimit(1.0)
    limit.reserve((lambda: time.sleep(0.02), 100))
    assert 2 <= limit.closing < 10
    assert 45 < limit.training() < 58
    limit.reserve((lambda: time.sleep(0.02), 10**6))
    assert limit.closing == 0.35 * 60


def test_time_counts_from_the_beginning_of_the_command_and_of_earlier_runs():
    limit = TimeLimit(1.0, time.monotonic() - 50)
    assert 9 < limit.training() < 10.1
    assert TimeLimit(1.0).training(done=55) <= 5


def test_when_time_is_up_one_item_is_left():
    limit = TimeLimit(1.0, time.monotonic() - 100)
    assert list(limit.while_left(range(3))) == [0]
