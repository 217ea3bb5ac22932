# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The command line `slarm`: runs a command, prints its errors, returns its exit code.

Everything heavy is imported inside the commands, so that `slarm --help` answers at once.
"""

from __future__ import annotations

import logging
import signal
import sys
from collections.abc import Sequence
from functools import cache
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from slarm_graph import __version__, parts
from slarm_graph.app.allocation import configure_allocator, disable_error_highlighting
from slarm_graph.app.child_process import exit_with_parent
from slarm_graph.app.ending import (
    BAD_INPUT,
    FAILED,
    INTERRUPTED,
    OK,
    end_unfinished,
    exit_after_signals,
)
from slarm_graph.app.options import POINT_OPTIONS
from slarm_graph.errors import BadInput, RunFailed


def _show_version(wanted: bool) -> None:
    if wanted:
        print(f"slarm-graph {__version__}")
        raise typer.Exit


def root(
    version: Annotated[
        bool,
        typer.Option("--version", help="Print the version.", callback=_show_version, is_eager=True),
    ] = False,
    debug: Annotated[
        bool,
        typer.Option(
            "--debug", help="Show the traceback of a failure; may be anywhere on the line."
        ),
    ] = False,
) -> None:
    """Take the options that hold for every command."""


class _Interrupted(Exception):
    """SIGINT or SIGTERM, which typer would turn into an exit code like any other."""


class _Commands(TyperGroup):
    """The group of all commands; passes an interrupt on to `main`."""

    def invoke(self, ctx: Any) -> Any:
        """Run a command."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as error:
            raise _Interrupted from error


@cache
def app() -> typer.Typer:
    """Build the application from all registered commands, those of other packages last."""
    made = typer.Typer(
        name="slarm",
        cls=_Commands,
        help="Simultaneous localization and radio mapping: a recording or a simulated world goes"
        " in; a trajectory, a geographic map, a radio map and a report come out.",
        epilog="Start with:  slarm demo   or   slarm run your.bag --ap X Y Z",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    made.callback()(root)
    for name in parts.registered("command"):
        command = _command(name)
        if isinstance(command, typer.Typer):
            made.add_typer(command, name=name)
        else:
            made.command(name)(command)
    return made


def _command(name: str) -> Any:
    """Load a command; one that cannot be loaded is replaced by one that reports why."""
    try:
        return parts.load("command", name)
    except BadInput as error:
        problem = str(error)

    def unusable() -> None:
        """Report the problem."""  # the help text is set below
        raise BadInput(problem)

    unusable.__doc__ = f"({problem})"
    return unusable


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code: 0, 1, 2 or 130."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in given
    _show_warnings()
    if arguments is None:
        exit_with_parent()
        configure_allocator()
        disable_error_highlighting()
        # Also where a shell that starts us in the background has interrupts ignored.
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.default_int_handler)
        exit_after_signals()
    try:
        code = app()(_joined_points([a for a in given if a != "--debug"]), standalone_mode=False)
    except (_Interrupted, KeyboardInterrupt, typer.Abort):
        lines = end_unfinished("interrupted", by_user=True)
        return _print_problems([*lines, "interrupted"], INTERRUPTED, debug)
    except Exception as error:
        list(end_unfinished(str(error), by_user=False))
        return _print_problems(*_problems(error), debug)
    return code if isinstance(code, int) else OK


def _problems(error: Exception) -> tuple[Sequence[object], int]:
    """Return the messages of an error, and the exit code."""
    if isinstance(error, BadInput):
        return error.args, BAD_INPUT
    if isinstance(error, RunFailed):
        return [str(error)], FAILED
    if hasattr(error, "format_message"):  # a usage error of typer's
        message = error.format_message().rstrip(".")
        return [message + _where_to_look(getattr(error, "ctx", None))], BAD_INPUT
    return [f"{type(error).__name__}: {error}"], FAILED


def _where_to_look(context: Any) -> str:
    """Name the help of the command that was wrongly used, under the program's own name."""
    if context is None:
        return ""
    program = len(context.find_root().command_path)
    return f"; see slarm{context.command_path[program:]} --help"


def _print_problems(problems: Sequence[object], code: int, debug: bool) -> int:
    """Print one line per problem, with `debug` the traceback too, and return the exit code."""
    if debug and code != INTERRUPTED:
        logging.getLogger(__name__).exception("")
        import traceback

        traceback.print_exc()
    for problem in map(str, problems):
        if problem:
            print(f"slarm: {' '.join(problem.split())}", file=sys.stderr)
    return code


def _joined_points(arguments: Sequence[str]) -> list[str]:
    """Join `--ap X Y Z` to one value: typer has no repeated options of several numbers."""
    joined: list[str] = []
    rest = list(arguments)
    while rest:
        word = rest.pop(0)
        joined.append(word)
        if word in POINT_OPTIONS:
            from slarm_graph.files.trajectories import is_number

            numbers: list[str] = []
            while rest and len(numbers) < 3 and is_number(rest[0]):
                numbers.append(rest.pop(0))
            if len(numbers) == 3:
                joined[-1] = f"{word}={' '.join(numbers)}"
            elif numbers or not (rest and _is_point(rest[0])):
                found = [
                    *numbers,
                    *(repr(other) for other in rest[:1] if not other.startswith("-")),
                ]
                problem = f"got {' '.join(found)}" if found else "got none"
                raise BadInput(f"{word} needs three numbers X Y Z [m], {problem}")
    return joined


def _is_point(text: str) -> bool:
    """Whether one word holds all three numbers, as in `--ap "1 2 3"`."""
    return len(text.replace(",", " ").split()) > 1


class _Warnings(logging.Handler):
    """Prints the package's warnings as plain lines; errors are printed by `main`."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print one line."""
        if record.levelno == logging.WARNING:
            print(f"slarm: {record.getMessage()}", file=sys.stderr)


def _show_warnings() -> None:
    logger = logging.getLogger("slarm_graph")
    if not any(isinstance(handler, _Warnings) for handler in logger.handlers):
        logger.addHandler(_Warnings(logging.WARNING))
    logger.propagate = False
