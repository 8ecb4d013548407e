"""Draws a triangle into a square block of a depth image with vector registers; most triangles fit into one.

It uses LLVM's vector type. Loops over the few rows and pixels would be compiled to unpredictable branches.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from gepf.worker.kernel.vectors import FLOAT, INT, SIZE, lanes_at, multiply_add, spread

SIDE = 4  # pixels of a row and of a column of a block
INSIDE = -1e-6  # smallest share of a corner, so that there are no gaps between triangles
ROW, BLOCK = ir.VectorType(FLOAT, SIDE), ir.VectorType(FLOAT, SIDE * SIDE)


@intrinsic
def draw_block(  # type: ignore[no-untyped-def] # noqa: PLR0913 compiled code takes numbers
    _, buffer, row, column, x, y, bx, by, cx, cy, z, zb, zc
):
    """Lower the block of buffer at (row, column) to a triangle's depth, where it covers a pixel's centre.

    buffer (H, W) is float32 and contains all pixels of the block. All else is float64, and is rounded to
    float32: x and y lead from corner a to the first pixel, b and c to the other corners, divided by twice the
    triangle's area; z is the depth of corner a; zb and zc are the depths of the others minus z.
    """
    return types.void(buffer, row, column, x, y, bx, by, cx, cy, z, zb, zc), write_block


def write_block(context: Any, builder: Any, signature: Any, values: Sequence[Any]) -> Any:
    """Generate the code of `draw_block`."""

    def cross(ax: Any, ay: Any, bx: Any, by: Any) -> Any:
        return multiply_add(builder, ax, by, builder.fneg(builder.fmul(ay, bx)))

    buffer = context.make_array(signature.args[0])(context, builder, values[0])
    row, column = (context.cast(builder, values[k], signature.args[k], types.intp) for k in (1, 2))
    width = builder.extract_value(buffer.shape, 1)
    starts = [builder.add(builder.mul(builder.add(row, SIZE(k)), width), column) for k in range(SIDE)]
    rows = [lanes_at(builder, buffer, start, ROW) for start in starts]
    x, y, bx, by, cx, cy, z, zb, zc = (
        spread(builder, builder.fptrunc(value, FLOAT), BLOCK) for value in values[3:]
    )
    x = builder.fadd(x, BLOCK([float(lane % SIDE) for lane in range(BLOCK.count)]))
    y = builder.fadd(y, BLOCK([float(lane // SIDE) for lane in range(BLOCK.count)]))
    of_b, of_c = cross(x, y, cx, cy), cross(bx, by, x, y)
    of_a = builder.fsub(builder.fsub(BLOCK([1.0] * BLOCK.count), of_b), of_c)
    depth = multiply_add(builder, of_c, zc, multiply_add(builder, of_b, zb, z))
    behind = joined(builder, [builder.load(pixels, align=4) for pixels in rows])
    nearer = builder.fcmp_ordered("<", depth, behind)
    for share in (of_a, of_b, of_c):
        nearer = builder.and_(nearer, builder.fcmp_ordered(">=", share, BLOCK([INSIDE] * BLOCK.count)))
    block = builder.select(nearer, depth, behind)
    for k, pixels in enumerate(rows):
        builder.store(some_lanes(builder, block, block, range(k * SIDE, (k + 1) * SIDE)), pixels, align=4)
    return context.get_dummy_value()


def joined(builder: Any, rows: list[Any]) -> Any:
    """One vector of the lanes of several vectors, whose number is a power of 2."""
    while len(rows) > 1:
        lanes = range(2 * rows[0].type.count)
        rows = [some_lanes(builder, rows[k], rows[k + 1], lanes) for k in range(0, len(rows), 2)]
    return rows[0]


def some_lanes(builder: Any, one: Any, other: Any, lanes: Sequence[int]) -> Any:
    """A vector of some lanes of two vectors; lanes of the second are numbered after those of the first."""
    return builder.shuffle_vector(one, other, ir.VectorType(INT, len(lanes))(list(lanes)))
