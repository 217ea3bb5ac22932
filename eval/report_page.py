# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Pieces of a self-contained HTML page: sections, tables, interactive figures, pictures."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Sequence
from html import escape

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.offline import get_plotlyjs

from slarm_graph.files.maps import png_bytes

Cell = float | int | str | None

_SHORT = 32
"""Texts up to here stay on one line: a third of the page's width."""
_MANY_ROWS = 40
"""Tables that are longer than a screen get a scroll bar of their own."""
_COLORS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#f0e442", "#000000")
"""Okabe and Ito's, which colour-blind people can tell apart."""

_STYLE = """
:root { color-scheme: light; --ink: #1c2430; --soft: #5b6675; --line: #dfe4ea; --tint: #f5f7f9; }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 2rem 1.5rem 4rem; max-width: 78rem; background: #fff;
  color: var(--ink); font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; }
h1 { font-size: 1.7rem; margin: 0 0 .2rem; } h2 { font-size: 1.15rem; margin: 2.2rem 0 .6rem; }
p.lead { color: var(--soft); margin: 0 0 1rem; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .92rem; }
th, td { padding: .28rem .8rem .28rem 0; border-bottom: 1px solid var(--line); text-align: left;
  vertical-align: top; }
th { color: var(--soft); font-weight: 600; } td.number, th.number { text-align: right; }
.wide { overflow-x: auto; } .long { max-height: 36rem; overflow-y: auto; }
.short { white-space: nowrap; }
.gallery { display: grid; gap: 1rem;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 30rem), 1fr)); }
.gallery figure { margin: 0; } .gallery img { width: 100%; }
figcaption { color: var(--soft); font-size: .9rem; }
.facts { display: grid; grid-template-columns: repeat(auto-fit, minmax(8rem, 1fr)); gap: .7rem;
  margin: 1.2rem 0; }
.fact { background: var(--tint); border: 1px solid var(--line); border-radius: 8px;
  padding: .6rem .8rem; }
.fact b { display: block; font-size: 1.25rem; font-variant-numeric: tabular-nums; }
.fact span { color: var(--soft); font-size: .85rem; }
.pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(27rem, 1fr)); gap: 0 2rem; }
ul.notices { background: #fff8e6; border: 1px solid #f0dfae; border-radius: 8px; margin: 1rem 0;
  padding: .6rem 1rem .6rem 2rem; }
pre { background: var(--tint); border: 1px solid var(--line); border-radius: 8px; padding: .8rem;
  overflow-x: auto; font-size: .82rem; } summary { cursor: pointer; color: var(--soft); }
.bar { background: #4878a8; height: .7rem; border-radius: 3px; min-width: 2px; }
"""


def page(title: str, body: Iterable[str]) -> str:
    """Return a whole page that needs nothing besides itself; plotly's code is in it once."""
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style>"
        f"<script>{get_plotlyjs()}</script></head>\n<body>\n"
        + "\n".join(body)
        + "\n</body></html>\n"
    )


def heading(title: str, lead: str) -> str:
    """Return the page's title and one line below it."""
    return f'<h1>{escape(title)}</h1><p class="lead">{escape(lead)}</p>'


def section(title: str, *content: str) -> str:
    """Return a titled section; empty when it has no content."""
    inside = "\n".join(part for part in content if part)
    return f"<section><h2>{escape(title)}</h2>\n{inside}</section>" if inside else ""


def side_by_side(*content: str) -> str:
    """Put sections beside each other where there is room."""
    return f'<div class="pair">{"".join(content)}</div>'


def facts(pairs: Iterable[tuple[str, str]]) -> str:
    """Return the few numbers a reader looks for first: (value, what it is)."""
    boxes = (
        f'<div class="fact"><b>{escape(value)}</b><span>{escape(name)}</span></div>'
        for value, name in pairs
    )
    return f'<div class="facts">{"".join(boxes)}</div>'


def notices(texts: Sequence[str]) -> str:
    """Return what a user should know, as a highlighted list."""
    items = "".join(f"<li>{escape(text)}</li>" for text in texts)
    return f'<ul class="notices">{items}</ul>' if items else ""


def table(columns: Sequence[str], rows: Sequence[Sequence[Cell]]) -> str:
    """Return a table; columns that hold only numbers are set to the right."""
    numeric = [
        any(isinstance(row[i], (int, float)) for row in rows)
        and all(isinstance(row[i], (int, float)) or row[i] is None for row in rows)
        for i in range(len(columns))
    ]
    head = "".join(_cell("th", name, right) for name, right in zip(columns, numeric, strict=True))
    body = "".join(
        "<tr>"
        + "".join(_cell("td", shown(v), right) for v, right in zip(row, numeric, strict=True))
        + "</tr>"
        for row in rows
    )
    inside = f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody>"
    looks = "wide long" if len(rows) > _MANY_ROWS else "wide"
    return f'<div class="{looks}"><table>{inside}</table></div>'


def _cell(tag: str, text: str, right: bool) -> str:
    looks = "number" if right else "short" if len(text) <= _SHORT else ""
    return f'<{tag} class="{looks}">{escape(text)}</{tag}>'


def shown(value: Cell) -> str:
    """Write a value for people: four digits, stamps in full, a dash for what is missing."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "-"
    if isinstance(value, float):
        if value.is_integer() and abs(value) < 1e9:
            return f"{value:.0f}"
        # Four digits are enough for a measure, not for a stamp.
        return f"{value:.3f}" if abs(value) >= 1e4 else f"{value:.4g}"
    return str(value)


def bars(rows: Sequence[tuple[str, float]], unit: str) -> str:
    """Return a table with a bar for every (name, amount)."""
    largest = max((amount for _, amount in rows), default=0.0) or 1.0
    body = "".join(
        f"<tr><td>{escape(name)}</td><td class=number>{amount:.2f} {escape(unit)}</td>"
        f'<td style="width:50%"><div class="bar" style="width:{100 * amount / largest:.1f}%">'
        "</div></td></tr>"
        for name, amount in rows
    )
    return f'<table style="width:100%"><tbody>{body}</tbody></table>' if rows else ""


def links(targets: Iterable[tuple[str, str]]) -> str:
    """Return a list of links: (what it is, where it is)."""
    items = "".join(f'<li><a href="{escape(to)}">{escape(name)}</a></li>' for name, to in targets)
    return f"<ul>{items}</ul>" if items else ""


def gallery(pictures: Iterable[tuple[str, bytes]]) -> str:
    """Return PNG pictures side by side: (caption, file content)."""
    items = (
        f'<figure><img alt="{escape(caption)}"'
        f' src="data:image/png;base64,{base64.b64encode(data).decode()}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
        for caption, data in pictures
    )
    inside = "".join(items)
    return f'<div class="gallery">{inside}</div>' if inside else ""


def folded(title: str, content: str) -> str:
    """Return content that opens on a click."""
    return f"<details><summary>{escape(title)}</summary>{content}</details>"


def code(text: str) -> str:
    """Return text as it is."""
    return f"<pre>{escape(text)}</pre>"


def figure(content: go.Figure, height_px: int = 620, ground: str = "white") -> str:
    """Return an interactive figure; `ground` is the colour behind what is plotted."""
    content.update_layout(
        height=height_px,
        margin={"l": 60, "r": 20, "t": 30, "b": 50},
        paper_bgcolor="white",
        plot_bgcolor=ground,
        font={"family": "system-ui, sans-serif", "size": 13},
        colorway=_COLORS,
        legend={"orientation": "h", "y": 1.06, "x": 0},
    )
    config = {"displaylogo": False, "responsive": True, "scrollZoom": True}
    return str(content.to_html(full_html=False, include_plotlyjs=False, config=config))


def png_uri(image: NDArray[np.uint8]) -> str:
    """Return an image (rows, cols) or (rows, cols, 3) RGB, top row first, as a data address."""
    return "data:image/png;base64," + base64.b64encode(png_bytes(image)).decode()
