# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Errors a user can mend, told in one line: what, where, how to fix it."""


class BadInput(ValueError):
    """The input or the usage is at fault (exit code 2)."""


class RunFailed(RuntimeError):
    """The job could not be finished although its input looked fine (exit code 1)."""
