"""Gaps between the points of sparse depth, as of depth registered to a larger colour image, or a cloud.

A morphological closing of nearness with a window of 3 x 3 fills gaps of up to two pixels, and moves no
outline: a gap gets the depth of a surface around it, at an outline that of the farther one.

Sparse points are those of a lattice, so along rows or columns their steps have two lengths that follow each
other, such as 1 and 2 pixels, or 2 and 3. Pixels that are missing because of noise differ: if each fails by
itself, the lengths have a geometric distribution, and n(1) n(3) = n(2)^2; if neighbours fail together,
n(1) n(3) is larger.
"""

from __future__ import annotations

from collections.abc import Iterable

import msgspec
import numpy as np
from numpy.typing import NDArray


class SparseDepth(msgspec.Struct, frozen=True):
    """When depth is called sparse."""

    min_gap_share: float = 0.25  #: closed gaps for each measured pixel; gaps of cameras are few, or large
    max_ratio: float = 0.5  #: n(1) n(3) / n(2)^2 of steps in a lattice: 0 without noise, 1 by chance
    min_pixels: int = 100  #: measured ones


SPARSE = SparseDepth()
NOWHERE = np.uint16(np.iinfo(np.uint16).max)


def close_gaps(depth: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Depth (H, W), 0 for none, with gaps of up to two pixels filled; measured depth is not changed."""
    nearness = (NOWHERE - depth) * (depth > 0)
    closed = over_neighbours(np.minimum, over_neighbours(np.maximum, nearness))
    return np.where((depth == 0) & (closed > 0), NOWHERE - closed, depth)


def over_neighbours(combine: np.ufunc, values: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """The maximum or minimum (H, W) of each pixel and its eight neighbours."""
    rows = values.copy()
    combine(rows[1:], values[:-1], out=rows[1:])
    combine(rows[:-1], values[1:], out=rows[:-1])
    found = rows.copy()
    combine(found[:, 1:], rows[:, :-1], out=found[:, 1:])
    combine(found[:, :-1], rows[:, 1:], out=found[:, :-1])
    return found


def is_sparse(images: Iterable[NDArray[np.uint16]], *, of_points: bool = False) -> bool:
    """Whether depth (H, W) of some frames consists of points with narrow gaps in between.

    They are points of a lattice, or known to be `of_points`, wherever these are.
    """
    measured = closed = 0
    steps = np.zeros((2, 3))  # along rows and along columns, of 1, 2 and 3 pixels
    for depth in images:
        before = int(np.count_nonzero(depth))
        measured, closed = measured + before, closed + int(np.count_nonzero(close_gaps(depth))) - before
        steps += [count_steps(depth > 0), count_steps(depth.T > 0)]
    is_regular = bool((steps[:, 0] * steps[:, 2] <= SPARSE.max_ratio * steps[:, 1] ** 2).any())
    has_gaps = measured >= SPARSE.min_pixels and closed > SPARSE.min_gap_share * measured
    return has_gaps and (of_points or is_regular)


def count_steps(measured: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Number (3,) of steps of 1, 2 and 3 pixels from a measured pixel (H, W) to the next one in its row."""
    rows, columns = np.nonzero(measured)
    steps = np.diff(columns)[np.diff(rows) == 0]
    return np.bincount(steps[steps <= 3], minlength=4)[1:]
