"""Compares a tile of observed points in vector registers with model points and boxes.

It uses LLVM's vector type. Loops over arrays would be compiled to code that loads and stores the result for
every model point, and loops with a test to code with unpredictable branches.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from gepf.worker.kernel.observation import TILE
from gepf.worker.kernel.vectors import FINITE, FLOAT, INT, SIZE, lanes_at, multiply_add, spread

BITS = ir.IntType(TILE)
FLOATS, INTS = ir.VectorType(FLOAT, TILE), ir.VectorType(INT, TILE)


@intrinsic
def search_lanes(  # type: ignore[no-untyped-def]
    _, points, first, model, start, stop, nearest, index
):
    """Reduce the squared distances of one tile to those of closer model points, from start to stop - 1.

    points (3, P) float32, with the tile from `first`; model (M, 3) float32; the results are nearest (P,)
    float32 and index (P,) uint32.
    """
    return types.void(points, first, model, start, stop, nearest, index), write_search


@intrinsic
def largest_of(_, nearest, first):  # type: ignore[no-untyped-def]
    """The largest squared distance of the tile from `first`; nearest (P,) as for `search_lanes`."""
    return types.float32(nearest, first), write_largest


@intrinsic
def boxes_within(_, one, k, boxes, first, bound):  # type: ignore[no-untyped-def]
    """Which of TILE columns of boxes (6, K) from `first` are nearer than sqrt(bound) to column k of `one`.

    One bit per column, the lowest for the first.
    """
    return types.int64(one, k, boxes, first, bound), write_boxes_within


@intrinsic
def lowest_bit(_, bits):  # type: ignore[no-untyped-def]
    """The index of the lowest set bit of an integer other than 0."""
    return types.int64(bits), write_lowest_bit


def write_search(context: Any, builder: Any, signature: Any, values: Sequence[Any]) -> Any:
    """Generate the code of `search_lanes`."""
    first, start, stop = (context.cast(builder, values[k], signature.args[k], types.intp) for k in (1, 3, 4))
    points, model, nearest, index = (
        context.make_array(signature.args[k])(context, builder, values[k]) for k in (0, 2, 5, 6)
    )
    count = builder.extract_value(points.shape, 1)
    rows = [first, builder.add(first, count), builder.add(first, builder.mul(count, SIZE(2)))]
    tile = [builder.load(lanes_at(builder, points, row, FLOATS), align=4) for row in rows]
    distance_at, index_at = lanes_at(builder, nearest, first, FLOATS), lanes_at(builder, index, first, INTS)
    distances = cgutils.alloca_once_value(builder, builder.load(distance_at, align=4))  # type: ignore[no-untyped-call]
    indices = cgutils.alloca_once_value(builder, builder.load(index_at, align=4))  # type: ignore[no-untyped-call]
    with cgutils.for_range_slice(builder, start, stop, SIZE(1), SIZE) as (m, _):
        found = squared_distances(builder, tile, model, m)
        best = builder.load(distances)
        closer = builder.fcmp_ordered("<", found, best, flags=FINITE)
        builder.store(builder.select(closer, found, best), distances)
        this = spread(builder, builder.trunc(m, INT), INTS)
        builder.store(builder.select(closer, this, builder.load(indices)), indices)
    builder.store(builder.load(distances), distance_at, align=4)
    builder.store(builder.load(indices), index_at, align=4)
    return context.get_dummy_value()


def write_largest(context: Any, builder: Any, signature: Any, values: Sequence[Any]) -> Any:
    """Generate the code of `largest_of`."""
    nearest = context.make_array(signature.args[0])(context, builder, values[0])
    first = context.cast(builder, values[1], signature.args[1], types.intp)
    return largest(builder, builder.load(lanes_at(builder, nearest, first, FLOATS), align=4))


def write_boxes_within(context: Any, builder: Any, signature: Any, values: Sequence[Any]) -> Any:
    """Generate the code of `boxes_within`."""
    k, first = (context.cast(builder, values[n], signature.args[n], types.intp) for n in (1, 3))
    bound = context.cast(builder, values[4], signature.args[4], types.float32)
    one, boxes = (context.make_array(signature.args[n])(context, builder, values[n]) for n in (0, 2))
    row = [spread(builder, builder.load(value), FLOATS) for value in column(builder, one, k)]
    many = [
        builder.load(builder.bitcast(place, FLOATS.as_pointer()), align=4)
        for place in column(builder, boxes, first)
    ]
    near = builder.fcmp_ordered(
        "<", squared_gaps(builder, row, many), spread(builder, bound, FLOATS), flags=FINITE
    )
    return builder.zext(builder.bitcast(near, BITS), SIZE)


def write_lowest_bit(_: Any, builder: Any, __: Any, values: Sequence[Any]) -> Any:
    """Generate the code of `lowest_bit`."""
    return builder.cttz(values[0], ir.IntType(1)(1))


def column(builder: Any, boxes: Any, k: Any) -> list[Any]:
    """Pointers to the six values of column k."""
    count = builder.extract_value(boxes.shape, 1)
    return [builder.gep(boxes.data, [builder.add(k, builder.mul(count, SIZE(a)))]) for a in range(6)]


def squared_gaps(builder: Any, one: Sequence[Any], other: Sequence[Any]) -> Any:
    """Squared distances of boxes, given by smallest and largest coordinates; 0 if they overlap."""
    total = FLOATS([0.0] * TILE)
    for low, high, other_low, other_high in zip(one[:3], one[3:], other[:3], other[3:], strict=True):
        below = builder.fsub(low, other_high, flags=FINITE)
        above = builder.fsub(other_low, high, flags=FINITE)
        gap = larger(builder, larger(builder, below, above), FLOATS([0.0] * TILE))
        total = multiply_add(builder, gap, gap, total)
    return total


def larger(builder: Any, one: Any, other: Any) -> Any:
    """The maximum of each lane."""
    return builder.select(builder.fcmp_ordered(">", one, other, flags=FINITE), one, other)


def squared_distances(builder: Any, tile: Sequence[Any], model: Any, m: Any) -> Any:
    """Squared distances of a tile (three vectors) from model point m."""
    total = FLOATS([0.0] * TILE)
    for axis, lanes in enumerate(tile):
        place = builder.add(builder.mul(m, SIZE(3)), SIZE(axis))
        value = spread(builder, builder.load(builder.gep(model.data, [place])), FLOATS)
        off = builder.fsub(lanes, value, flags=FINITE)
        total = multiply_add(builder, off, off, total)
    return total


def largest(builder: Any, lanes: Any) -> Any:
    """The maximum of all lanes, by repeated halving."""
    width = TILE // 2
    while width > 0:
        turned = INTS([(lane + width) % TILE for lane in range(TILE)])
        other = builder.shuffle_vector(lanes, ir.Constant(FLOATS, ir.Undefined), turned)
        lanes = larger(builder, lanes, other)
        width //= 2
    return builder.extract_element(lanes, INT(0))
