"""Common functions for code that uses LLVM's vector type."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

FLOAT, DOUBLE, INT, SIZE = ir.FloatType(), ir.DoubleType(), ir.IntType(32), ir.IntType(64)
FINITE = ("nsz", "nnan")  # everything is a number


def multiply_add(builder: Any, one: Any, other: Any, addend: Any) -> Any:
    """one * other + addend, rounded once. Explicit, because not every compiler would fuse the two."""
    lanes = one.type
    name = f"llvm.fma.v{lanes.count}f{32 if lanes.element == FLOAT else 64}"
    kind = ir.FunctionType(lanes, [lanes] * 3)
    return builder.call(builder.module.declare_intrinsic(name, fnty=kind), [one, other, addend])


def lanes_at(builder: Any, array: Any, place: Any, lanes: ir.VectorType) -> Any:
    """Pointer to a vector of elements from a place on."""
    return builder.bitcast(builder.gep(array.data, [place]), lanes.as_pointer())


def spread(builder: Any, value: Any, lanes: ir.VectorType) -> Any:
    """A vector with one value in every lane."""
    nothing = ir.Constant(lanes, ir.Undefined)
    alone = builder.insert_element(nothing, value, INT(0))
    return builder.shuffle_vector(alone, nothing, ir.VectorType(INT, lanes.count)([0] * lanes.count))


@intrinsic
def add_scaled(_, out, row, factor, values):  # type: ignore[no-untyped-def]
    """Add factor * values to a row of a contiguous float64 array.

    `values` is a tuple of as many floats as a row has, a power of 2; `row` counts over all axes but the last.
    """
    return types.void(out, row, factor, values), write_add_scaled


def write_add_scaled(context: Any, builder: Any, signature: Any, values: Sequence[Any]) -> Any:
    """Generate the code of `add_scaled`."""
    out = context.make_array(signature.args[0])(context, builder, values[0])
    row = context.cast(builder, values[1], signature.args[1], types.intp)
    lanes = ir.VectorType(DOUBLE, signature.args[3].count)
    addend = ir.Constant(lanes, ir.Undefined)
    for k in range(lanes.count):
        addend = builder.insert_element(addend, builder.extract_value(values[3], k), INT(k))
    place = lanes_at(builder, out, builder.mul(row, SIZE(lanes.count)), lanes)
    total = multiply_add(builder, spread(builder, values[2], lanes), addend, builder.load(place, align=8))
    builder.store(total, place, align=8)
    return context.get_dummy_value()
