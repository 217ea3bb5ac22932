# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What is packaged is what is on disk, pins are plain, and the command starts light."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("slarm_graph", "frontends", "backends", "eval")
HEAVY = ("gtsam", "numba", "matplotlib", "cv2", "scipy", "plotly", "rosbags", "dask", "numpy")


def pyproject() -> dict:
    return tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_every_package_on_disk_is_in_the_wheel() -> None:
    on_disk = {
        path.parent.relative_to(ROOT)
        for room in ROOMS
        for path in (ROOT / room).rglob("__init__.py")
        if not any(part.is_symlink() for part in (path, *path.parents))
    }
    mapped = {Path(p) for p in pyproject()["tool"]["setuptools"]["package-dir"].values()}
    assert on_disk == mapped


@pytest.mark.parametrize("room", ROOMS[1:])
def test_rooms_are_relative_links_into_the_package(room: str) -> None:
    link = ROOT / "slarm_graph" / room
    assert link.is_symlink()
    assert link.readlink() == Path("..") / room


def test_package_data_ships_all_that_is_no_code() -> None:
    setuptools = pyproject()["tool"]["setuptools"]
    shipped = {
        path
        for package, patterns in setuptools["package-data"].items()
        for pattern in patterns
        for path in (ROOT / setuptools["package-dir"][package]).glob(pattern)
    }
    there = {
        path
        for room in ROOMS
        for path in (ROOT / room).rglob("*")
        if path.is_file() and path.suffix != ".py" and path.parent.name != "__pycache__"
    }
    assert shipped == there


def test_constraints_are_plain_pins_of_every_dependency() -> None:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pins = [line for line in lines if line and not line.startswith("#")]
    assert all(re.fullmatch(r"[a-z0-9.\-]+==[^\s;]+", pin) for pin in pins)
    pinned = {pin.partition("==")[0] for pin in pins}
    project = pyproject()["project"]
    wanted = [*project["dependencies"], *project["optional-dependencies"]["test"]]
    names = {re.split(r"[\[<>=~ ]", w)[0].lower().replace("_", "-") for w in wanted}
    assert names <= pinned


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys; from slarm_graph.app.cli import main; main(['--help']);"
        f"print([m for m in {HEAVY!r} if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
