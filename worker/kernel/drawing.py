"""Draws a row of a triangle with vector registers, which are as wide as nearly all triangles.

It uses LLVM's vector type. A loop over the few pixels of a row would be compiled to unpredictable branches.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from worker.kernel.vectors import DOUBLE, FLOAT, lanes_at, multiply_add, spread

LANES = 4  # pixels of a row
INSIDE = -1e-9  # smallest share of a corner, so that there are no gaps between triangles
DOUBLES, FLOATS = ir.VectorType(DOUBLE, LANES), ir.VectorType(FLOAT, LANES)


@intrinsic
def draw_row(  # type: ignore[no-untyped-def] # noqa: PLR0913 compiled code takes numbers
    _, buffer, row, column, x, y, bx, by, cx, cy, z, zb, zc
):
    """Lower buffer[row, column : column + LANES] to the depth of a triangle, if it covers a pixel's centre.

    buffer (H, W) is float32 and contains all these pixels. All else is float64: x and y lead from corner a to
    the first pixel, b and c from corner a to the other corners, divided by twice the triangle's area; z is
    the depth of corner a; zb and zc are the depths of the others minus z.
    """
    return types.void(buffer, row, column, x, y, bx, by, cx, cy, z, zb, zc), write_row


def write_row(context: Any, builder: Any, signature: Any, values: Sequence[Any]) -> Any:
    """Generate the code of `draw_row`."""

    def cross(ax: Any, ay: Any, bx: Any, by: Any) -> Any:
        return multiply_add(builder, ax, by, builder.fneg(builder.fmul(ay, bx)))

    buffer = context.make_array(signature.args[0])(context, builder, values[0])
    row, column = (context.cast(builder, values[k], signature.args[k], types.intp) for k in (1, 2))
    width = builder.extract_value(buffer.shape, 1)
    pixels = lanes_at(builder, buffer, builder.add(builder.mul(row, width), column), FLOATS)
    x, y, bx, by, cx, cy, z, zb, zc = (spread(builder, value, DOUBLES) for value in values[3:])
    x = builder.fadd(x, DOUBLES([float(lane) for lane in range(LANES)]))
    of_b, of_c = cross(x, y, cx, cy), cross(bx, by, x, y)
    of_a = builder.fsub(builder.fsub(DOUBLES([1.0] * LANES), of_b), of_c)
    depth = multiply_add(builder, of_c, zc, multiply_add(builder, of_b, zb, z))
    depth = builder.fptrunc(depth, FLOATS)
    behind = builder.load(pixels, align=4)
    nearer = builder.fcmp_ordered("<", depth, behind)
    for share in (of_a, of_b, of_c):
        nearer = builder.and_(nearer, builder.fcmp_ordered(">=", share, DOUBLES([INSIDE] * LANES)))
    builder.store(builder.select(nearer, depth, behind), pixels, align=4)
    return context.get_dummy_value()
