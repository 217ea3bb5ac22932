# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Accuracy of the present revision beside recorded figures: nothing may get worse unnoticed.

    python benchmarks/gate.py [FOLDER with <name>.bag and <name>.relations] [--record]

Runs every recording and the paper's room with `pose_graph` and `gmapping`, seed 0, and compares the
figures with `benchmarks/recorded.json`: times are none of its business. What is worse by more than
the tolerance fails; what is better by as much is told, to be recorded by `--record`. Recordings
that are not in the folder are skipped, by name.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from slarm_graph.eval.metric_table import kind_of

RECORDED = Path(__file__).with_name("recorded.json")
RECORDINGS = ("intel", "fr079", "mit-csail")
WORLDS = ("paper_room",)
BACKENDS = ("pose_graph", "gmapping")
FIGURES = {
    "recording": ("relations_translation_m", "relations_rotation_deg", "map_entropy_nat"),
    "world": ("accuracy", "gain_rmse_db", "coverage_accessible", "ate_rmse_m"),
}
TOLERANCE = 0.05
"""Share of a figure by which it may change: rounding moves it a little, faults move it far."""
FLOOR = 0.001
"""And at least by so much in its own unit: a millimetre, a thousandth of a dB or of all cells."""

Figures = dict[str, dict[str, float]]


@dataclass(frozen=True, slots=True)
class Difference:
    """A figure of a run, now and as recorded."""

    run: str
    name: str
    now: float
    recorded: float

    def verdict(self) -> str:
        """Say `worse`, `better` or `same`."""
        change = self.now - self.recorded
        if abs(change) <= max(TOLERANCE * abs(self.recorded), FLOOR):
            return "same"
        return "better" if (change > 0) == (kind_of(self.name).better == "more") else "worse"


def commands(folder: Path | None) -> Iterator[tuple[str, str, list[str]]]:
    """Yield name, kind and command line of every run that can be made."""
    for name in RECORDINGS:
        bag = folder / f"{name}.bag" if folder else Path(f"{name}.bag")
        if not bag.is_file():
            print(f"skipped: {name} ({bag} is not there)")
            continue
        for backend in BACKENDS:
            relations = ["--relations", str(bag.with_suffix(".relations"))]
            yield f"{name} {backend}", "recording", ["run", str(bag), "-b", backend, *relations]
    for name in WORLDS:
        for backend in BACKENDS:
            yield f"{name} {backend}", "world", ["explore", "--world", name, "-b", backend]


def measured(folder: Path | None) -> Figures:
    """Run everything and gather the figures."""
    found: Figures = {}
    with tempfile.TemporaryDirectory() as out:
        for run, kind, command in commands(folder):
            where = ["--seed", "0", "--out", out, "--name", run.replace(" ", "_")]
            slarm = [sys.executable, "-m", "slarm_graph", *command, *where]
            done = subprocess.run(slarm, capture_output=True, text=True, check=False)
            if done.returncode:
                raise SystemExit(f"{run}: {' '.join(slarm)} failed\n{done.stderr}")
            metrics = json.loads((Path(out) / where[-1] / "metrics.json").read_text())
            found[run] = {name: metrics[name]["value"] for name in FIGURES[kind]}
            told = ", ".join(f"{name} {value:.6g}" for name, value in found[run].items())
            print(f"{run}: {told}", flush=True)
    return found


def compared(now: Figures, recorded: Figures) -> list[Difference]:
    """Put every figure beside the recorded one."""
    return [
        Difference(run, name, value, recorded[run][name])
        for run, figures in now.items()
        for name, value in figures.items()
        if name in recorded.get(run, {})
    ]


def main() -> int:
    """Measure, and compare or record; 1 when something got worse."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--record", action="store_true", help="Make these the recorded figures.")
    given = parser.parse_args()
    recorded: Figures = json.loads(RECORDED.read_text()) if RECORDED.is_file() else {}
    now = measured(given.folder)
    differences = compared(now, recorded)
    for d in differences:
        if d.verdict() != "same":
            print(f"{d.verdict().upper()}: {d.run} {d.name} {d.recorded:.6g} -> {d.now:.6g}")
    if given.record:
        text = json.dumps(recorded | now, indent=2, sort_keys=True)
        RECORDED.write_text(text + "\n", encoding="utf-8")
        return 0
    worse = sum(d.verdict() == "worse" for d in differences)
    print(f"{len(differences)} figures compared, {worse} worse")
    return 1 if worse else 0


if __name__ == "__main__":
    sys.exit(main())
