# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The documentation is true: its code is run as it stands, and its tables are complete."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml
from test_cli import CONTRACT, room_bag

import slarm_graph
from slarm_graph import OccupancyGrid, Trajectory, write_map, write_trajectory
from slarm_graph.app.cli import main
from slarm_graph.grid import GridGeometry

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
NOT_RUN = ("pip install ", "make ")


def blocks(page: Path) -> Iterator[tuple[str, str]]:
    """Language and content of every block of code that is to be run."""
    for language, code in re.findall(r"^```(\w+)\n(.*?)^```", page.read_text(), re.S | re.M):
        if language in ("python", "sh"):
            yield language, code


PAGES = [page for page in sorted(DOCS.glob("*.md")) if list(blocks(page))]


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the files that the pages speak of."""
    room_bag(tmp_path / "your.bag", 30)
    stamps = 100_000_000_000 + np.arange(30) * 100_000_000
    path = Trajectory(stamps, np.stack([0.05 * np.arange(30), np.zeros(30), np.zeros(30)], axis=1))
    occupied = np.zeros((30, 40), dtype=np.bool_)
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    grid = OccupancyGrid(GridGeometry(0.0, 0.0, 0.1, 30, 40), occupied, ~occupied)
    for name in ("truth", "estimate"):
        write_trajectory(tmp_path / f"{name}.tum", path)
        write_map(tmp_path / f"{name}.yaml", grid)
    write_map(tmp_path / "map.yaml", grid)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
@pytest.mark.usefixtures("desk")
def test_code_runs_as_it_stands(page: Path) -> None:
    names: dict[str, object] = {}
    for language, code in blocks(page):
        if language == "python":
            exec(compile(code, f"{page.name}", "exec"), names)
            continue
        for line in code.strip().splitlines():
            if line.startswith(NOT_RUN):
                continue
            program, *arguments = shlex.split(line)
            assert program == "slarm", line
            assert main(arguments) == 0, line


def test_every_output_has_its_line() -> None:
    text = (DOCS / "outputs.md").read_text()
    for name in CONTRACT:
        assert f"`{name}`" in text or f"`{name}/`" in text, name


def test_every_public_name_is_in_the_api_pages() -> None:
    text = "\n".join(page.read_text() for page in (DOCS / "api").glob("*.md"))
    documented = {line.rpartition(".")[2] for line in re.findall(r"^::: (\S+)", text, re.M)}
    settings = {name for name in slarm_graph.__all__ if name.endswith("Config")}
    assert set(slarm_graph.__all__) - settings - documented == {
        "Heartbeat",
        "PartName",
        "__version__",
    }


def test_every_page_is_in_the_menu() -> None:
    menu = yaml.dump(yaml.safe_load((ROOT / "mkdocs.yml").read_text())["nav"])
    for page in DOCS.rglob("*.md"):
        assert str(page.relative_to(DOCS)) in menu, page
