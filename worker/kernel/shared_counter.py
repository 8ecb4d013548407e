"""A counter that several threads take numbers from, each number once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


@intrinsic
def take_next(_, counter):  # type: ignore[no-untyped-def]
    """The number in counter (1,) int64, which is one larger from then on for every thread."""
    return types.int64(counter), write_take_next


def write_take_next(context: Any, builder: Any, signature: Any, values: Sequence[Any]) -> Any:
    """The code of `take_next`."""
    counter = context.make_array(signature.args[0])(context, builder, values[0])
    return builder.atomic_rmw("add", counter.data, ir.IntType(64)(1), "monotonic")
