# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""The base of all configuration models."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, field_validator

MOST = 1e12
"""No setting is larger: nanoseconds of a quarter of an hour, cells of a continent. Kernels convert
settings to 64-bit integers after divisions by as little as a millimetre, which leaves room for
10^15."""

Resolution = Annotated[float, Field(ge=0.001, le=10.0)]
"""Side of a cell [m]: from the resolution of a lidar to the width of a corridor."""
Reach = Annotated[float, Field(gt=0, le=10_000.0)]
"""A range or a window [m], up to what survey lidars measure."""
Sigma = Annotated[float, Field(ge=1e-4, le=10.0)]
"""Standard deviation of a distance [m]; kernels are looked up to three of them away."""
MOST_BEAMS = 100_000
"""Beams of a scan: the finest lidars have 0.1 degrees, 3,600 in a turn; one message of as many
ranges takes 400 kB."""
Count = Annotated[int, Field(ge=1, le=1_000_000)]
"""A number of things that are kept in memory at once."""


class Stage(BaseModel):
    """Base of all configuration models."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
    )

    @field_validator("*")
    @classmethod
    def _within_bounds(cls, value: object) -> object:
        if isinstance(value, float) and abs(value) > MOST:
            raise ValueError(f"should lie between {-MOST:g} and {MOST:g}")
        if isinstance(value, int) and abs(value) >= 2**63:
            raise ValueError("should fit into 64 bits")
        return value
