# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Progress off a terminal: a line now and then with count, rate, time left and heartbeat."""

from __future__ import annotations

import io
import re

import pytest

from slarm_graph.app import progress as module
from slarm_graph.app.progress import Bar, Lines, Pace, show_progress


class Clock:
    """A clock that is set by hand [s]."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def monotonic(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(module, "time", clock)
    return clock


def test_one_line_every_ten_seconds(clock: Clock) -> None:
    stream = io.StringIO()
    lines = Lines(stream)
    lines.start("slam", 400)
    for _ in range(250):
        clock.now_s += 0.125
        lines.advance()
    assert stream.getvalue().splitlines() == [
        "slam: 80 of 400 (20%), 8/s, 40 s left (10 s so far)",
        "slam: 160 of 400 (40%), 8/s, 30 s left (20 s so far)",
        "slam: 240 of 400 (60%), 8/s, 20 s left (30 s so far)",
    ]


def paced(clock: Clock, seconds: list[float], total: int | None) -> list[str]:
    """What is told after each of the steps that took so long."""
    pace, told = Pace(total), []
    for each in seconds:
        clock.now_s += each
        pace.advance()
        told.append(pace.words())
    return told


@pytest.mark.parametrize("slow", [(1,), (1, 2, 3, 4), (1, 2, 3, 11), (2, 9, 40)])
def test_what_compiles_at_first_makes_no_hours(clock: Clock, slow: tuple[int, ...]) -> None:
    """Steps of 0.125 s, but some of a minute: what is told as left is what will be."""
    total = 800
    steps = [60.0 if done in slow else 0.125 for done in range(1, total + 1)]
    for done, words in enumerate(paced(clock, steps, total)[:700], 1):
        left = re.search(r", ([0-9]+) s left", words)
        assert left or done < 8 * max(slow) + 16
        to_come_s = sum(steps[done:])
        assert left is None or int(left.group(1)) <= 1.01 * to_come_s + 1.0


def test_a_step_that_is_still_going_is_no_rate(clock: Clock) -> None:
    """What a heartbeat tells meanwhile, too."""
    stream = io.StringIO()
    lines = Lines(stream)
    lines.start("slam", 400)
    for _ in range(20):
        clock.now_s += 0.25
        lines.advance()
    clock.now_s += 60.0
    lines.say("compiling")
    assert stream.getvalue() == "slam: 20 of 400 (5%) compiling\n"


def test_a_steady_rate_is_told_as_it_is(clock: Clock) -> None:
    told = paced(clock, [0.5] * 60, 60)
    assert told[0] == "1 of 60 (2%)"
    assert told[39] == "40 of 60 (67%), 2/s, 10 s left"
    assert told[-1] == "60 of 60 (100%), 2/s, 0 s left"


def test_of_few_long_steps_the_time_left_is_told_after_the_third(clock: Clock) -> None:
    assert paced(clock, [90.0, 20.0, 20.0], 4) == [
        "1 of 4 (25%)",
        "2 of 4 (50%)",
        "3 of 4 (75%), 0.05/s, 20 s left",
    ]


def test_where_the_end_is_unknown_only_the_rate_is_told(clock: Clock) -> None:
    told = paced(clock, [4.0] + [0.25] * 40, None)
    assert told[3] == "4"
    assert told[-1] == "41, 4/s"


def test_a_heartbeat_is_a_sign_of_life_in_long_steps(clock: Clock) -> None:
    stream = io.StringIO()
    lines = Lines(stream)
    lines.start("optimisation")
    for second in range(0, 30, 4):
        clock.now_s = float(second)
        lines.say(f"iteration {second}")
    assert stream.getvalue().splitlines() == [
        "optimisation: iteration 12",
        "optimisation: iteration 24",
    ]


def test_the_right_kind_for_where_it_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    with show_progress() as progress:
        assert isinstance(progress, Lines)
    assert capsys.readouterr().err == ""


def test_the_bar_counts_rates_and_ends(capsys: pytest.CaptureFixture[str]) -> None:
    bar = Bar()
    bar.start("slam", 3)
    for _ in range(3):
        bar.advance()
    bar.say("closing a loop")
    bar.close()
    assert not re.search("Traceback", capsys.readouterr().err)
