# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Mutation run: break the code in small ways and count how often a test notices.

    python benchmarks/mutants.py [--per-room 20] [--seed 0] [--rooms radio,recovery,...]

A mutant is one change in the source: a comparison or sign turned round, a constant altered, a
boundary off by one, a condition negated, a call's result dropped. Mutants are drawn by chance, as
many per room; each is tested, in a copy of the tree, by the test files nearest to its file among
the imports (`chosen_tests.py`). It counts as killed when one of their tests fails that passes
without it, or when they take ten times as long as without. Prints the survivors and writes
`mutants.csv`.
"""

from __future__ import annotations

import argparse
import csv
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

from chosen_tests import tests_of
from mutations import Mutant, mutants_in, mutated

ROOT = Path(__file__).resolve().parents[1]

ROOMS: dict[str, str] = {
    "backends": "backends",
    "scans": "frontends/scans",
    "radio": "slarm_graph/radio",
    "recovery": "slarm_graph/recovery",
    "exploration": "slarm_graph/exploration",
    "consistency": "slarm_graph/consistency",
    "eval": "eval",
    "files": "slarm_graph/files",
}
"""Folder of every room."""
PATIENCE_S = 900.0
"""Most tests of a mutant take less than a minute; a machine with other work ten times that."""


class Workbench:
    """A copy of the tree in which mutants are tested.

    Parameters
    ----------
    work : Path
        Empty, or left by an earlier run: then nothing is compiled anew.
    """

    def __init__(self, work: Path) -> None:
        self.tree = work / "tree"
        self._cache = work / "numba"
        self._kept = work / "original.py"
        self._sound: dict[str, bool] = {}
        ignore = shutil.ignore_patterns(".git", ".venv", "__pycache__", "runs", ".*cache")
        shutil.rmtree(self.tree, ignore_errors=True)
        shutil.copytree(ROOT, self.tree, symlinks=True, ignore=ignore)
        if (ROOT.parent / "shared").exists() and not (work / "shared").exists():
            (work / "shared").symlink_to((ROOT.parent / "shared").resolve())

    def kills(self, mutant: Mutant) -> bool:
        """Whether a test fails with a mutant that passes without it."""
        tests, left_out = tests_of(self.tree, mutant.path), list[str]()
        while tests:
            failed = self._failed_with(mutant, [*tests, *left_out])
            if failed is None:
                return self._in_time(tests)
            if not failed or self._passes(failed):
                return bool(failed)
            left_out.append(f"--deselect={failed}")
        return False

    def _failed_with(self, mutant: Mutant, words: list[str]) -> str | None:
        """Return the first test that fails with a mutant, or empty; None when it took too long."""
        path = self.tree / mutant.path
        shutil.copy2(path, self._kept)
        cache = self._cache_for(mutant)
        path.write_text(mutated(path.read_text("utf-8"), mutant), encoding="utf-8")
        try:
            return self._first_failed(words, cache)
        except subprocess.TimeoutExpired:
            return None
        finally:
            shutil.copy2(self._kept, path)
            if cache != self._cache:
                shutil.rmtree(cache, ignore_errors=True)

    def _cache_for(self, mutant: Mutant) -> Path:
        """Return a copy of numba's cache where the mutant's file has kernels, kept by its date."""
        if "@kernel" not in (self.tree / mutant.path).read_text("utf-8"):
            return self._cache
        cache = self._cache.with_name("numba_of_mutant")
        self._cache.mkdir(exist_ok=True)
        shutil.copytree(self._cache, cache)
        return cache

    def _passes(self, test: str) -> bool:
        """Whether a test passes without any mutant."""
        if test not in self._sound:
            self._sound[test] = not self._first_failed([test], self._cache)
        return self._sound[test]

    def _in_time(self, tests: list[str]) -> bool:
        began = time.monotonic()
        self._first_failed(tests, self._cache)
        return 10.0 * (time.monotonic() - began) < PATIENCE_S

    def _first_failed(self, words: list[str], cache: Path) -> str:
        """Run tests to the first that fails; returns its id, or that of a file that does not load.

        Raises
        ------
        subprocess.TimeoutExpired
        """
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-rfE", "--tb=no"]
        command += ["-p", "no:benchmark", "-p", "no:cacheprovider", *words]
        env = {**os.environ, "PYTHONPATH": str(self.tree), "NUMBA_CACHE_DIR": str(cache)}
        done = subprocess.run(
            command,
            cwd=self.tree,
            env=env,
            capture_output=True,
            timeout=PATIENCE_S,
            text=True,
            check=False,
        )
        if done.returncode == 0:
            return ""
        found = re.search(r"^(?:FAILED|ERROR) (.*?)(?: - .*)?$", done.stdout, re.MULTILINE)
        return found.group(1) if found else words[0]


def run_room(bench: Workbench, room: str, count: int, seed: int) -> list[tuple[Mutant, bool]]:
    """Draw mutants of a room and return each with whether it was killed."""
    files = sorted((bench.tree / ROOMS[room]).rglob("*.py"))
    every = [mutant for path in files for mutant in mutants_in(room, path, bench.tree)]
    found = []
    for mutant in random.Random(seed).sample(every, min(count, len(every))):
        killed = bench.kills(mutant)
        found.append((mutant, killed))
        word = "killed" if killed else "SURVIVED"
        place = f"{mutant.path}:{mutant.line}"
        print(f"{word:8} {mutant.kind:9} {place}: {mutant.source}", flush=True)
    return found


def write_table(path: Path, results: Iterable[tuple[Mutant, bool]]) -> None:
    """Write a line for every mutant."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(("room", "file", "line", "kind", "killed", "source"))
        for m, killed in results:
            writer.writerow((m.room, m.path, m.line, m.kind, int(killed), m.source))


def main() -> int:
    """Run, print the score per room, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--per-room", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--work", type=Path, help="Keep the copy of the tree here.")
    parser.add_argument("--rooms", default=",".join(ROOMS))
    parser.add_argument("--out", type=Path, default=Path("mutants.csv"))
    options = parser.parse_args()
    results = []
    with tempfile.TemporaryDirectory() as scratch:
        bench = Workbench((options.work or Path(scratch)).resolve())
        for room in options.rooms.split(","):
            mine = run_room(bench, room, options.per_room, options.seed)
            results += mine
            print(f"{room}: {sum(killed for _, killed in mine)} of {len(mine)} killed", flush=True)
    write_table(options.out, results)
    share = sum(killed for _, killed in results) / max(len(results), 1)
    print(f"{share:.1%} of {len(results)} mutants killed")
    return 0 if share >= 0.85 else 1


if __name__ == "__main__":
    sys.exit(main())
