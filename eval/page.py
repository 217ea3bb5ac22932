# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Self-contained HTML pages: sections of facts, tables and interactive figures, by one template."""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any, ClassVar

import jinja2
import numpy as np
import plotly.graph_objects as go
from markupsafe import Markup
from numpy.typing import NDArray
from plotly.offline import get_plotlyjs

from slarm_graph.files.maps import png_bytes

Cell = float | int | str | None

COLORS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#f0e442", "#777777")
"""Colours of Okabe and Ito, which suit colour-blind people; grey for their black, which would be
invisible on a dark page."""


_PLOTLYS = str.maketrans({c: f"&#{ord(c)};" for c in "%{$"})


@dataclass(frozen=True, slots=True)
class Facts:
    """Key figures: (value, label)."""

    kind: ClassVar[str] = "facts"
    pairs: Sequence[tuple[str, str]]


@dataclass(frozen=True, slots=True)
class Notices:
    """Notices and warnings for the user."""

    kind: ClassVar[str] = "notices"
    texts: Sequence[str]


@dataclass(frozen=True, slots=True)
class Paragraph:
    """A paragraph."""

    kind: ClassVar[str] = "words"
    text: str


@dataclass(frozen=True, slots=True)
class Code:
    """Preformatted text."""

    kind: ClassVar[str] = "code"
    text: str


@dataclass(frozen=True, slots=True)
class PageTable:
    """A table; columns of numbers are right-aligned.

    Parameters
    ----------
    columns : sequence of str
    rows : sequence of sequence of float, int, str or None
    best : frozenset of (int, int)
        Row and column of the cells in bold.
    right_from : int, optional
        Right-align all columns from there on.
    grouped : bool
        Group rows with equal first cells under that cell as heading; the next column stays in place
        when a narrow page is scrolled.
    """

    kind: ClassVar[str] = "table"
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    best: frozenset[tuple[int, int]] = frozenset()
    right_from: int | None = None
    grouped: bool = False

    @property
    def shown(self) -> list[list[str]]:
        """The formatted cells."""
        return [[shown(value) for value in row] for row in self.rows]

    @property
    def right(self) -> list[bool]:
        """Which columns are right-aligned."""
        if self.right_from is not None:
            return [index >= self.right_from for index in range(len(self.columns))]
        return [
            any(isinstance(row[i], (int, float)) for row in self.rows)
            and all(isinstance(row[i], (int, float)) or row[i] is None for row in self.rows)
            for i in range(len(self.columns))
        ]


@dataclass(frozen=True, slots=True)
class Bars:
    """A bar chart: (name, amount, text)."""

    kind: ClassVar[str] = "bars"
    rows: Sequence[tuple[str, float, str]]

    @property
    def shown(self) -> list[tuple[str, str, str]]:
        """Names, widths in percent of the largest, texts."""
        largest = max((amount for _, amount, _ in self.rows), default=0.0) or 1.0
        return [(name, f"{100.0 * amount / largest:.1f}", text) for name, amount, text in self.rows]


@dataclass(frozen=True, slots=True)
class Figure:
    """An interactive figure.

    Parameters
    ----------
    content : plotly Figure
    words : str
        Alternative text.
    height_px : int
        Height of figures without aspect.
    aspect : float
        Height over width of a map; 0 for other figures.
    """

    kind: ClassVar[str] = "figure"
    content: go.Figure
    words: str
    height_px: int = 380
    aspect: float = 0.0

    @property
    def json(self) -> Markup:
        """The figure as JSON, escaped for its HTML element."""
        self.content.update_layout(colorway=COLORS, template="none")
        text = str(self.content.to_json())
        return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))


@dataclass(frozen=True, slots=True)
class Gallery:
    """PNG pictures side by side: (caption, content)."""

    kind: ClassVar[str] = "gallery"
    pictures: Sequence[tuple[str, bytes]]

    @property
    def shown(self) -> list[tuple[str, str]]:
        """Captions and data URIs."""
        return [(caption, _png_uri(data)) for caption, data in self.pictures]


@dataclass(frozen=True, slots=True)
class LinkList:
    """LinkList: (name, place relative to the page)."""

    kind: ClassVar[str] = "links"
    targets: Sequence[tuple[str, str]]


@dataclass(frozen=True, slots=True)
class Details:
    """Blocks that unfold on a click."""

    kind: ClassVar[str] = "folded"
    title: str
    blocks: Sequence[Block]


Block = (
    Facts | Notices | Paragraph | Code | PageTable | Bars | Figure | Gallery | LinkList | Details
)


@dataclass(frozen=True, slots=True)
class Section:
    """A titled part of the page; left out where it has no blocks."""

    title: str
    blocks: Sequence[Block] = field(default_factory=tuple)


def page(title: str, lead: str, blocks: Sequence[Block], sections: Sequence[Section]) -> str:
    """Return a self-contained HTML page.

    Parameters
    ----------
    title, lead : str
    blocks : sequence of Block
        Above the first section.
    sections : sequence of Section
    """
    return _template().render(
        title=title,
        lead=lead,
        blocks=blocks,
        sections=sections,
        plotly_js=Markup(get_plotlyjs()),
        number=map(str, count()),
    )


@cache
def _template() -> jinja2.Template:
    here = jinja2.FileSystemLoader(Path(__file__).parent)
    return jinja2.Environment(loader=here, autoescape=True).get_template("page.html.j2")


def shown(value: Cell) -> str:
    """Format a value: four digits, a dash for a missing one."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "-"
    if isinstance(value, float):
        if value.is_integer() and abs(value) < 1e9:
            return f"{value:.0f}"
        # Four digits are enough for a measure, not for a stamp; from 9999.5 they have an exponent.
        return f"{value:.3f}" if abs(value) >= 9999.5 else f"{value:.4g}"
    return str(value)


def plain(name: str) -> str:
    """Escape a name so that plotly shows it as text: no tags, formats or mathematics."""
    return html.escape(name).translate(_PLOTLYS)


def png_uri(image: NDArray[np.uint8]) -> str:
    """Return an image (rows, cols) or (rows, cols, 3) RGB, top row first, as a data URI."""
    return _png_uri(png_bytes(image))


def _png_uri(content: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(content).decode()


def single(values: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
    """Halve the page's size: single precision is far below a pixel."""
    return np.asarray(values, dtype=np.float32)
