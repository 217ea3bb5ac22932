# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Progress off a terminal: a line now and then with count, rate, time left and heartbeat."""

from __future__ import annotations

import io
import re

import pytest

from slarm_graph.app import progress as module
from slarm_graph.app.progress import Bar, Lines, shown


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
    with shown() as progress:
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
