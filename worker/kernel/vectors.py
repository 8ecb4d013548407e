"""Common functions for code that uses LLVM's vector type."""

from __future__ import annotations

from typing import Any

from llvmlite import ir

FLOAT, DOUBLE, INT, SIZE = ir.FloatType(), ir.DoubleType(), ir.IntType(32), ir.IntType(64)
FINITE = ("nsz", "nnan")  # everything is a number


def multiply_add(builder: Any, one: Any, other: Any, addend: Any) -> Any:
    """one * other + addend, rounded once. It is explicit because the choice of a compiler can vary."""
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
