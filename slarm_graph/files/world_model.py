# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""What the YAML file of a world may hold: a boundary, walls, boxes and polygons, access points."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from slarm_graph.config import Stage


def _finite(value: float) -> float:
    if not math.isfinite(value):
        raise ValueError("must be a finite number")
    return value


Number = Annotated[float, AfterValidator(_finite)]
Length = Annotated[float, Field(gt=0), AfterValidator(_finite)]
Point = tuple[Number, Number]
Size = tuple[Length, Length]


class WallModel(Stage):
    """A centre line with a thickness, or a closed rectangle given by its outer size."""

    name: str = "wall"
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
    """A rectangle filled up to its height."""

    name: str = "box"
    center_m: Point
    size_m: Size
    heading_deg: Number = 0.0
    height_m: Length


class PolygonModel(Stage):
    """A simple polygon filled up to its height."""

    name: str = "polygon"
    corners_m: tuple[Point, ...] = Field(min_length=3)
    height_m: Length


class AccessPointModel(Stage):
    """Where an access point hangs, and how it sends."""

    name: str
    x_m: Number
    y_m: Number
    z_m: Number
    power_dbm: Number = 20.0
    frequency_hz: Length = 3.5e9


class StartModel(Stage):
    """Where the robot starts."""

    x_m: Number
    y_m: Number
    heading_deg: Number = 0.0


class WorldModel(Stage):
    """The whole file."""

    name: str
    ceiling_m: Length
    boundary_m: tuple[Point, ...] = Field(min_length=3)
    start: StartModel
    access_points: tuple[AccessPointModel, ...] = ()
    walls: tuple[WallModel, ...] = ()
    boxes: tuple[BoxModel, ...] = ()
    polygons: tuple[PolygonModel, ...] = ()
