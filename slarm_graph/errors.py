# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Errors a user can mend, told in one line each: what, where, how to fix it."""

from __future__ import annotations


class BadInput(ValueError):
    """The input or the usage is at fault (exit code 2).

    Parameters
    ----------
    *problems : str
        Most often one; everything that is wrong, where it can be known at once.
    """

    def __str__(self) -> str:
        """Join the problems."""
        return "; ".join(map(str, self.args))


class RunFailed(RuntimeError):
    """The job could not be finished although its input looked fine (exit code 1)."""
