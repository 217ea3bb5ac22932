# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What the command line tells a user beside the result."""

from __future__ import annotations

import pytest

from slarm_graph.app.cli_output import show_notices


def test_a_warning_is_called_so_and_not_a_note(capsys: pytest.CaptureFixture[str]) -> None:
    show_notices(["warning: a bag is cut", "two finds agree"])
    assert capsys.readouterr().err == "warning: a bag is cut\nnote: two finds agree\n"
