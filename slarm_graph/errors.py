# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Errors a user can mend, told in one line each: what, where, how to fix it."""

from __future__ import annotations

from collections.abc import Sequence

BRIEF = 60
"""Most characters that a message quotes of what it could not read: a line of a terminal holds 80,
and at twice as many the place and the remedy around the quotation are pushed out of sight."""


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


def brief(value: object, at_most: int = BRIEF) -> str:
    """Quote something for a message: one line, printable, never at length.

    Texts are taken as they are; everything else by its `repr`, of which long containers are not
    even written out.
    """
    if isinstance(value, (list, tuple, dict, set)) and len(value) > at_most:
        return f"{type(value).__name__} of {len(value)}"
    text = value[: 4 * at_most] if isinstance(value, str) else _repr(value)
    text = " ".join(text.split())
    text = "".join(c if c.isprintable() else "?" for c in text)
    return text if len(text) <= at_most else f"{text[: at_most - 3]}..."


MOST_LISTED = 8
"""Problems that one message lists; with more, the first ones are mended first anyway."""


def most(problems: Sequence[str]) -> tuple[str, ...]:
    """The first of several problems, with how many more there are."""
    told = [brief(problem, 400) for problem in problems[:MOST_LISTED]]
    if len(problems) > MOST_LISTED:
        told.append(f"and {len(problems) - MOST_LISTED} more problems")
    return tuple(told)


def _repr(value: object) -> str:
    """`repr` where it is short, for nested containers may hold each other a million times."""
    import reprlib

    short = reprlib.Repr()
    short.maxlevel, short.maxstring, short.maxother = 3, BRIEF, BRIEF
    try:
        return short.repr(value)
    except ValueError:  # whole numbers of thousands of digits have no decimal form
        return type(value).__name__
