"""Rows of four numbers in a vector register: sums over correspondences, and vertices where links carry them.

Written in the compiler's own vector type, so that a row is loaded, changed and stored at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from worker.kernel.vectors import DOUBLE, FINITE, INT, SIZE, lanes_at, spread

ROW = ir.VectorType(DOUBLE, 4)


@intrinsic
def add_products(  # type: ignore[no-untyped-def] # noqa: PLR0913 compiled code takes numbers
    _, sums, s, share, x, y, z, cx, cy, cz, w
):
    """Add share * X [w X; c] to the rows of sums[s], of X = [x, y, z, 1] and c = [cx, cy, cz].

    sums (L, 4, 8) float64, s an integer, all else float64.
    """
    return types.void(sums, s, share, x, y, z, cx, cy, cz, w), write_add_products


@intrinsic
def pose_lanes(  # type: ignore[no-untyped-def]
    _, columns, links, weights, vertices, v, posed
):
    """Fill posed[v] of (V, 3) with vertex v of (V, 3), blended over its links (V, K) by weights (V, K).

    columns (L, 4, 4) are those of the links' transforms. What has no weight is passed over.
    """
    return types.void(columns, links, weights, vertices, v, posed), write_pose


def write_add_products(context: Any, builder: Any, signature: Any, values: Sequence[Any]) -> Any:
    """The code of `add_products`."""
    s = context.cast(builder, values[1], signature.args[1], types.intp)
    sums = context.make_array(signature.args[0])(context, builder, values[0])
    point, weight = (*values[3:6], DOUBLE(1.0)), values[9]
    weighted = row_of(builder, [builder.fmul(value, weight, flags=FINITE) for value in point])
    pull = row_of(builder, values[6:10])
    for a, value in enumerate(point):
        here = spread(builder, builder.fmul(value, values[2], flags=FINITE), ROW)
        for place, added in ((8 * a, weighted), (8 * a + 4, pull)):
            row = lanes_at(builder, sums, builder.add(builder.mul(s, SIZE(32)), SIZE(place)), ROW)
            total = builder.fadd(
                builder.load(row, align=8), builder.fmul(here, added, flags=FINITE), flags=FINITE
            )
            builder.store(total, row, align=8)
    return context.get_dummy_value()


def write_pose(context: Any, builder: Any, signature: Any, values: Sequence[Any]) -> Any:
    """The code of `pose_lanes`."""
    v = context.cast(builder, values[4], signature.args[4], types.intp)
    columns, links, weights, vertices, posed = (
        context.make_array(signature.args[n])(context, builder, values[n]) for n in (0, 1, 2, 3, 5)
    )
    first, most = builder.mul(v, SIZE(3)), builder.extract_value(links.shape, 1)
    point = [
        spread(builder, builder.load(builder.gep(vertices.data, [builder.add(first, SIZE(axis))])), ROW)
        for axis in range(3)
    ]
    total = cgutils.alloca_once_value(builder, ROW([0.0] * 4))  # type: ignore[no-untyped-call]
    with cgutils.for_range(builder, most) as loop:
        place = builder.add(builder.mul(v, most), loop.index)
        weight = builder.load(builder.gep(weights.data, [place]))
        with builder.if_then(builder.fcmp_ordered(">", weight, DOUBLE(0.0))):
            link = builder.zext(builder.load(builder.gep(links.data, [place])), SIZE)
            column = [
                builder.load(
                    lanes_at(builder, columns, builder.add(builder.mul(link, SIZE(16)), SIZE(4 * n)), ROW),
                    align=8,
                )
                for n in range(4)
            ]
            moved = column[3]
            for turned, along in zip(column[:3], point, strict=True):
                moved = builder.fadd(moved, builder.fmul(turned, along, flags=FINITE), flags=FINITE)
            share = builder.fmul(spread(builder, weight, ROW), moved, flags=FINITE)
            builder.store(builder.fadd(builder.load(total), share, flags=FINITE), total)
    for axis in range(3):
        value = builder.extract_element(builder.load(total), INT(axis))
        builder.store(value, builder.gep(posed.data, [builder.add(first, SIZE(axis))]))
    return context.get_dummy_value()


def row_of(builder: Any, values: Sequence[Any]) -> Any:
    """Four values as lanes."""
    row = ir.Constant(ROW, ir.Undefined)
    for lane, value in enumerate(values):
        row = builder.insert_element(row, value, INT(lane))
    return row
