# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Read damaged inputs in a child process with bounds on time and memory, and say how each ended.

`python tests/fuzz/harness.py --count 20000` looks for failures; one is repeated by its kind and
number: `--only "map yaml" --first 4711 --count 1`.
"""

from __future__ import annotations

import argparse
import logging
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parent.parent), str(Path(__file__).parent)]

LIMIT_S = 10.0
"""What takes longer hangs."""
LIMIT_BYTES = 1_000_000_000
"""Memory that reading may take beyond what the process has before."""
BATCH = 200
"""Inputs per child; a new one forgets what the earlier ones left."""


@dataclass(frozen=True, slots=True)
class Failure:
    """An input that ended in something else than a result or a line."""

    kind: str
    number: int
    what: str


class Hang(Exception):
    """Reading took too long."""


def numbers_of(kind: str, number: int) -> np.random.Generator:
    """The random numbers of one input: by kind and number, on every machine the same."""
    return np.random.default_rng([number, zlib.crc32(kind.encode())])


def outcomes(kind: str, numbers: Sequence[int]) -> Iterator[Failure | str]:
    """Read inputs in a child process; yields how each ended, a dead child as a failure."""
    context = get_context("fork")
    rest = list(numbers)
    while rest:
        ours, theirs = context.Pipe(duplex=False)
        child = context.Process(target=_read_all, args=(kind, rest[:BATCH], theirs))
        child.start()
        theirs.close()
        done = 0
        try:
            while done < len(rest[:BATCH]):
                yield ours.recv()
                done += 1
        except EOFError:
            child.join()
            yield Failure(kind, rest[done], f"the process died ({child.exitcode})")
            done += 1
        child.join()
        rest = rest[done:]


def _read_all(kind: str, numbers: Sequence[int], pipe: Connection) -> None:
    """Child: read one input after the other and report."""
    from mutations import mutated
    from targets import lay_out, targets

    logging.disable()
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    target = next(t for t in targets() if t.name == kind)
    signal.signal(signal.SIGALRM, _hang)
    used = int(Path("/proc/self/statm").read_text().split()[5]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_DATA, (used + LIMIT_BYTES,) * 2)
    with tempfile.TemporaryDirectory() as folder:
        for number in numbers:
            rng = numbers_of(kind, number)
            seed = target.seeds[int(rng.integers(len(target.seeds)))]
            path = lay_out(target, Path(folder), mutated(rng, seed, as_text=target.as_text))
            signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
            signal.signal(signal.SIGPROF, _hang)
            pipe.send(_outcome(kind, number, target.read, path))
            signal.setitimer(signal.ITIMER_PROF, 0)
    pipe.close()


def _hang(*_: object) -> None:
    raise Hang(f"more than {LIMIT_S:g} s")


def _outcome(kind: str, number: int, read: object, path: Path) -> Failure | str:
    from slarm_graph.errors import BadInput, RunFailed

    try:
        read(path)  # type: ignore[operator]
    except (BadInput, RunFailed) as error:
        lines = [str(part) for part in error.args]
        if any("\n" in line or len(line) > 2000 for line in lines) or not any(lines):
            return Failure(kind, number, f"not a line: {str(error)[:300]!r}")
        return "refused"
    except BaseException as error:
        frames = traceback.extract_tb(error.__traceback__)
        ours = [f for f in frames if "fuzz" not in f.filename and "packages" not in f.filename]
        place = (ours or frames)[-1]
        where = f"{Path(place.filename).name}:{place.lineno}"
        return Failure(kind, number, f"{type(error).__name__} at {where}: {str(error)[:200]}")
    return "read"


def run(count: int, first: int = 0, only: str = "") -> tuple[Counter[str], list[Failure]]:
    """Read so many damaged inputs, spread over the kinds; return how they ended."""
    from targets import targets

    kinds = [t.name for t in targets() if only in ("", t.name)]
    ended: Counter[str] = Counter()
    failures = []
    for kind in kinds:
        numbers = range(first, first + -(-count // len(kinds)))
        for outcome in outcomes(kind, numbers):
            failed = isinstance(outcome, Failure)
            ended["failed" if failed else str(outcome)] += 1
            if isinstance(outcome, Failure):
                failures.append(outcome)
    return ended, failures


def main() -> int:
    """Look for failures and print them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", default="")
    given = parser.parse_args()
    started = time.monotonic()
    ended, failures = run(given.count, given.first, given.only)
    for (kind, what), count in Counter((f.kind, f.what[:110]) for f in failures).most_common():
        number = next(f.number for f in failures if f.kind == kind and f.what[:110] == what)
        print(f"{count:5}  {kind} (first {number}): {what}")
    print(f"{sum(ended.values())} inputs in {time.monotonic() - started:.0f} s: {dict(ended)}")
    return int(bool(failures))


if __name__ == "__main__":
    sys.exit(main())
