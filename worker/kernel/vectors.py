"""The compiler's own vector type: what code that is written in it shares."""

from __future__ import annotations

from typing import Any

from llvmlite import ir

FLOAT, DOUBLE, INT, SIZE = ir.FloatType(), ir.DoubleType(), ir.IntType(32), ir.IntType(64)
FINITE = ("nsz", "nnan")  # everything is a number


def multiply_add(builder: Any, one: Any, other: Any, addend: Any) -> Any:
    """one * other + addend, rounded once: said so, as a compiler that may choose does not always choose alike."""
    lanes = one.type
    name = f"llvm.fma.v{lanes.count}f{32 if lanes.element == FLOAT else 64}"
    kind = ir.FunctionType(lanes, [lanes] * 3)
    return builder.call(builder.module.declare_intrinsic(name, fnty=kind), [one, other, addend])


def lanes_at(builder: Any, array: Any, place: Any, lanes: ir.VectorType) -> Any:
    """Pointer to as many elements from a place on as there are lanes."""
    return builder.bitcast(builder.gep(array.data, [place]), lanes.as_pointer())


def spread(builder: Any, value: Any, lanes: ir.VectorType) -> Any:
    """One value in every lane."""
    nothing = ir.Constant(lanes, ir.Undefined)
    alone = builder.insert_element(nothing, value, INT(0))
    return builder.shuffle_vector(alone, nothing, ir.VectorType(INT, lanes.count)([0] * lanes.count))
