# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Bicubic interpolation of a raster inside compiled loops, a row of four cells at once.

Most of a match's time goes here. LLVM does not find the four lanes by itself, so they are spelled
out as vectors; where a processor has none so wide, LLVM splits them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

_LANES = ir.VectorType(ir.DoubleType(), 4)
"""A row of the four cells that Keys' kernel reaches."""
_CUBIC = (-0.5, 1.5, -1.5, 0.5), (1.0, -2.5, 2.0, -0.5), (-0.5, 0.0, 0.5, 0.0), (0.0, 1.0, 0.0, 0.0)
"""Coefficients of the weights of four cells in a row, the highest power of the share first (Keys,
"Cubic Convolution Interpolation for Digital Image Processing", IEEE T-ASSP 29(6), 1981)."""
_SLOPE = tuple(
    tuple(power * c for c in row) for power, row in zip((3.0, 2.0, 1.0), _CUBIC, strict=False)
)
"""Of their derivatives."""


def _bicubic(_: Any, raster: Any, row: Any, col: Any, u: Any, v: Any) -> tuple[Any, Any]:
    tuple_of: Any = types.UniTuple
    tuple_type = tuple_of(types.float64, 3)
    return tuple_type(raster, types.int64, types.int64, types.float64, types.float64), _generated


def _generated(context: Any, builder: Any, signature: Any, given: Any) -> Any:
    """Value, and its slopes by column and row, from the cells around."""
    raster, row, col, u, v = given
    array = context.make_array(signature.args[0])(context, builder, raster)
    stride = builder.extract_value(array.strides, 0)
    wide, steep = _polynomial(builder, _CUBIC, u), _polynomial(builder, _SLOPE, u)
    high, climb = _polynomial(builder, _CUBIC, v), _polynomial(builder, _SLOPE, v)
    at = builder.bitcast(array.data, ir.IntType(8).as_pointer())
    values = slopes = ir.Constant(_LANES, [-0.0] * 4)
    for k in range(4):
        rows = builder.mul(builder.add(row, ir.Constant(row.type, k - 1)), stride)
        cols = builder.mul(builder.sub(col, ir.Constant(col.type, 1)), ir.Constant(col.type, 4))
        pointer = builder.gep(at, [builder.add(rows, cols)])
        cells = ir.VectorType(ir.FloatType(), 4)
        line = builder.load(builder.bitcast(pointer, cells.as_pointer()), align=4)
        line = builder.fpext(line, _LANES)
        values = builder.fadd(values, builder.fmul(_lane_of(builder, high, k), line))
        slopes = builder.fadd(slopes, builder.fmul(_lane_of(builder, climb, k), line))
    sums = [_dot(builder, wide, values), _dot(builder, steep, values), _dot(builder, wide, slopes)]
    return context.make_tuple(builder, signature.return_type, sums)


def _polynomial(builder: Any, coefficients: Any, share: Any) -> Any:
    """Four polynomials at a share by Horner's rule."""
    x = _everywhere(builder, share)
    total = ir.Constant(_LANES, list(coefficients[0]))
    for row in coefficients[1:]:
        total = builder.fadd(builder.fmul(total, x), ir.Constant(_LANES, list(row)))
    return total


def _everywhere(builder: Any, value: Any) -> Any:
    """Put a number into all four lanes."""
    one = builder.insert_element(ir.Constant(_LANES, ir.Undefined), value, _index(0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), 4), [0] * 4)
    return builder.shuffle_vector(one, one, zeros)


def _lane_of(builder: Any, vector: Any, lane: int) -> Any:
    """Put one lane into all four."""
    chosen = ir.Constant(ir.VectorType(ir.IntType(32), 4), [lane] * 4)
    return builder.shuffle_vector(vector, vector, chosen)


def _dot(builder: Any, a: Any, b: Any) -> Any:
    product = builder.fmul(a, b)
    one, two, three, four = (builder.extract_element(product, _index(k)) for k in range(4))
    return builder.fadd(builder.fadd(one, two), builder.fadd(three, four))


def _index(lane: int) -> Any:
    return ir.Constant(ir.IntType(32), lane)


bicubic = cast(
    Callable[[Any, int, int, float, float], tuple[float, float, float]], intrinsic(_bicubic)
)
"""Value, slope by column and slope by row of a float32 raster (rows, cols), its columns one after
the other, at shares (column, row) of a cell beyond (row, col), which has a cell before and two
after it; only for compiled code."""
