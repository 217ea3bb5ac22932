# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The example plug-ins, installed for the time of a test as pip would, without its minutes."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from slarm_graph import parts
from slarm_graph.app import cli
from slarm_graph.eval import metric_parts, metric_table

PLUGINS = Path(__file__).resolve().parents[1] / "examples" / "plugins"


def install(site: Path, plugins: Path = PLUGINS) -> None:
    """Lay down what pip would: the modules, and the metadata with their entry points."""
    for project in sorted(plugins.glob("*/pyproject.toml")):
        about = tomllib.loads(project.read_text())["project"]
        for module in project.parent.glob("*.py"):
            (site / module.name).write_text(module.read_text())
        metadata = site / f"{about['name'].replace('-', '_')}-{about['version']}.dist-info"
        metadata.mkdir()
        (metadata / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {about['name']}\nVersion: {about['version']}\n"
        )
        lines = [
            line
            for group, entries in about["entry-points"].items()
            for line in (f"[{group}]", *(f"{name} = {at}" for name, at in entries.items()))
        ]
        (metadata / "entry_points.txt").write_text("\n".join(lines) + "\n")


@contextmanager
def on_the_path(site: Path) -> Iterator[None]:
    """Let Python find what is installed in a folder, and forget it afterwards."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(site))
        forget()
        yield
    forget()


def forget() -> None:
    """Drop what is remembered of registered parts."""
    for kept in (parts._added, cli.app, metric_parts.parts, metric_table.kinds):
        kept.cache_clear()
