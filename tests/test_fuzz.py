# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Damaged inputs of every kind end in a result or in a line: no traceback, no hang, no flood."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent / "fuzz"))

from harness import Failure, outcomes
from targets import targets

PER_KIND = 60
"""Eleven hundred inputs, half a minute; `tests/fuzz/harness.py` goes on from there."""


@pytest.mark.parametrize("kind", [target.name for target in targets()])
def test_damaged_inputs_end_in_a_result_or_a_line(kind: str) -> None:
    ended = list(outcomes(kind, range(PER_KIND)))
    assert [outcome for outcome in ended if isinstance(outcome, Failure)] == []
    assert "refused" in ended
