# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What the pages take from the code: tables of metrics, parts and settings, and drawn equations."""

from __future__ import annotations

import html
import io
import re
from collections.abc import Callable
from typing import Any

from slarm_graph import parts
from slarm_graph.config import RunConfig
from slarm_graph.eval.metric_table import kinds
from slarm_graph.files.config_text import config_yaml


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Fill in the tables, and draw every `$$ ... $$` on a line of its own."""
    for mark, made in MADE.items():
        if mark in markdown:
            markdown = markdown.replace(mark, made())
    return re.sub(r"^\$\$ (.+) \$\$$", lambda m: equation(m[1]), markdown, flags=re.MULTILINE)


def equation(text: str) -> str:
    """Draw an equation as SVG, so that pages need nothing from elsewhere."""
    from matplotlib import rc_context
    from matplotlib.mathtext import math_to_image

    svg = io.StringIO()
    with rc_context({"svg.fonttype": "path", "mathtext.fontset": "cm", "svg.hashsalt": "slarm"}):
        math_to_image(f"${text}$", svg, format="svg", dpi=72)
    drawn = svg.getvalue().partition("<svg")
    body = " ".join((drawn[1] + drawn[2]).split())
    label = html.escape(text, quote=True)
    return f'<p class="equation" role="img" aria-label="{label}">{body}</p>'


def metric_table() -> str:
    """Every metric: key, unit, which way is better, where it applies, how it is computed."""
    rows = ((f"`{k.name}`", k.title, k.unit, k.better, k.applies, k.how) for k in kinds().values())
    return table(("key", "metric", "unit", "better", "where", "how"), rows)


def part_table() -> str:
    """Every registered part of the kinds that can be chosen."""
    rows = (
        (kind, f"`{status.name}`", status.summary)
        for kind in parts.KINDS
        if kind != "command"
        for status in parts.statuses(kind)
    )
    return table(("kind", "name", "what it is"), rows)


def kind_table() -> str:
    """Every kind of part: entry-point group, and where the built-in ones are listed."""
    rows = ((k.name, f"`{k.group}`", f"`{k.room}.BUILT_IN`") for k in parts.KINDS.values())
    return table(("kind", "entry-point group", "table of those that come along"), rows)


def command_table() -> str:
    """Every command and the first line of its help."""
    rows = ((f"`slarm {s.name}`", s.summary) for s in parts.statuses("command"))
    return table(("command", "what it does"), rows)


def table(columns: tuple[str, ...], rows: Any) -> str:
    """Write a Markdown table."""
    lines = [columns, ("---",) * len(columns), *rows]
    return "\n".join(f"| {' | '.join(w.replace('|', '&#124;') for w in line)} |" for line in lines)


def settings() -> str:
    """All settings with defaults, meaning, unit and allowed values."""
    return f"```yaml\n{config_yaml(RunConfig(), comments=True)}```"


MADE: dict[str, Callable[[], str]] = {
    "{{ metrics }}": metric_table,
    "{{ parts }}": part_table,
    "{{ kinds }}": kind_table,
    "{{ commands }}": command_table,
    "{{ settings }}": settings,
}
