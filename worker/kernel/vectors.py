"""The compiler's own vector type: what code that is written in it shares."""

from __future__ import annotations

from typing import Any

from llvmlite import ir

FLOAT, DOUBLE, INT, SIZE = ir.FloatType(), ir.DoubleType(), ir.IntType(32), ir.IntType(64)
FINITE = ("contract", "nsz", "nnan")  # a product and a sum may become one; everything is a number


def lanes_at(builder: Any, array: Any, place: Any, lanes: ir.VectorType) -> Any:
    """Pointer to as many elements from a place on as there are lanes."""
    return builder.bitcast(builder.gep(array.data, [place]), lanes.as_pointer())


def spread(builder: Any, value: Any, lanes: ir.VectorType) -> Any:
    """One value in every lane."""
    nothing = ir.Constant(lanes, ir.Undefined)
    alone = builder.insert_element(nothing, value, INT(0))
    return builder.shuffle_vector(alone, nothing, ir.VectorType(INT, lanes.count)([0] * lanes.count))
