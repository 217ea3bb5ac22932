# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The schema of a world's YAML file: boundary, walls, boxes, polygons, access points."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from slarm_graph.config import Stage

MAX_M = 100_000.0
"""Largest coordinate and longest side [m]: at a cell of 0.05 m, float32 coordinates
still tell neighbouring cells apart."""
MAX_SOLIDS = 5_000
"""Solids of a world, wall pieces counted one by one; a simulated scan and the truth of the map look
at all of them, so that twice as many take twice as long."""


def _finite(value: float) -> float:
    if not math.isfinite(value) or abs(value) > MAX_M:
        raise ValueError(f"must be a finite number of at most {MAX_M:g}")
    return value


Number = Annotated[float, AfterValidator(_finite)]
Length = Annotated[float, Field(ge=0.001), AfterValidator(_finite)]
Name = Annotated[str, Field(max_length=80)]
Point = tuple[Number, Number]
Size = tuple[Length, Length]


class WallModel(Stage):
    """A centre line with a thickness, or a closed rectangle given by its outer size."""

    name: Name = "wall"
    line_m: tuple[Point, ...] | None = None
    closed: bool = False
    center_m: Point | None = None
    size_m: Size | None = None
    heading_deg: Number = 0.0
    thickness_m: Length
    height_m: Length

    @model_validator(mode="after")
    def _one_form(self) -> WallModel:
        rectangle = self.center_m is not None and self.size_m is not None
        if rectangle == (self.line_m is not None):
            raise ValueError("needs either line_m, or center_m and size_m")
        if self.line_m is not None and len(self.line_m) < (3 if self.closed else 2):
            raise ValueError("line_m needs at least 2 points, 3 when closed")
        if self.size_m is not None and 2 * self.thickness_m >= min(self.size_m):
            raise ValueError("thickness_m leaves no inside; use a box")
        return self


class BoxModel(Stage):
    """A solid rectangle with a height."""

    name: Name = "box"
    center_m: Point
    size_m: Size
    heading_deg: Number = 0.0
    height_m: Length


class PolygonModel(Stage):
    """A solid simple polygon with a height."""

    name: Name = "polygon"
    corners_m: tuple[Point, ...] = Field(min_length=3)
    height_m: Length


class AccessPointModel(Stage):
    """Position, power and frequency of an access point."""

    name: Name
    x_m: Number
    y_m: Number
    z_m: Number
    power_dbm: Number = 20.0
    frequency_hz: float = Field(default=3.5e9, gt=0, le=1e12)


class StartModel(Stage):
    """Start pose of the robot."""

    x_m: Number
    y_m: Number
    heading_deg: Number = 0.0


class WorldModel(Stage):
    """The whole file."""

    name: Name
    ceiling_m: Length
    boundary_m: tuple[Point, ...] = Field(min_length=3)
    start: StartModel
    access_points: tuple[AccessPointModel, ...] = ()
    walls: tuple[WallModel, ...] = ()
    boxes: tuple[BoxModel, ...] = ()
    polygons: tuple[PolygonModel, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _not_too_many(cls, content: object) -> object:
        """Limit the number of solids before they are validated."""
        if isinstance(content, dict):
            parts = (content.get(key) for key in ("walls", "boxes", "polygons"))
            count = sum(_pieces(part) for part in parts)
            if count > MAX_SOLIDS:
                raise ValueError(f"{count} solids; a world has at most {MAX_SOLIDS}")
        return content


def _pieces(part: object) -> int:
    """Return the number of solids of a list in the file: a wall has one per piece of its line."""
    if not isinstance(part, list):
        return 0
    lines = [item.get("line_m") for item in part if isinstance(item, dict)]
    return len(part) + sum(len(line) for line in lines if isinstance(line, list))
