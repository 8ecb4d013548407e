"""Shape coefficients as degrees of freedom: transforms of reshaped links, and derivatives.

A coefficient moves each vertex of the rest pose along a direction of its own. The sums over the targets of a
link (`link_sums`) do not hold these directions. So the derivatives take the affine map from the rest pose to
the directions that fits the vertices of the link best, a *field*. The map is exact for a change of stature,
and nearly exact for a change of girth. The posed vertices themselves follow the true directions.

In a pose, a point that is at X at rest moves by the field of its link, turned with the link, and by the
*drift*: the motion of the link's rest frame, because the joints before it move apart.
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array, Indices
from gepf.common.body import ROTATION, BodyModel
from gepf.common.compiling import numba

RANK = 1e-6  # least singular value of a fit, relative to the largest: links may be flat


def fit_fields(model: BodyModel) -> Array:
    """Fields (L, S, 3, 4) of the links at rest, by least squares over their vertices and skin weights."""
    fields = np.zeros((len(model.link_names), model.shape_count, 3, 4))
    if not model.shape_count:
        return fields
    places = np.column_stack([model.vertices, np.ones(len(model.vertices))])
    for link in range(len(fields)):
        share = np.sqrt(np.sum(np.abs(model.skin_weights) * (model.skin_links == link), axis=1))[:, None]
        mine = share[:, 0] > 0.0
        for s, directions in enumerate(model.shape_vertices):
            if mine.any():
                fit = np.linalg.lstsq((share * places)[mine], (share * directions)[mine], rcond=RANK)
                fields[link, s] = fit[0].T
    return fields


@numba.njit(cache=True, nogil=True)
def shape_links(pose: Array, link_dofs: Indices, fields: Array, transforms: Array, out: Array) -> None:
    """Fill out (L, 3, 4) with the links' transforms (D + 1, 3, 4) after the change by fields (L, S, 3, 4)."""
    for link in range(len(link_dofs)):
        t = transforms[link_dofs[link]]
        out[link] = t
        for s in range(fields.shape[1]):
            field = fields[link, s]
            for a in range(3):
                for b in range(4):
                    out[link, a, b] += pose[s] * row_product(t, field, a, b)


@numba.njit(cache=True, nogil=True, inline="always")
def row_product(t: Array, field: Array, a: int, b: int) -> float:
    """Entry (a, b) of the product of the rotation in t (3, 4) and a field (3, 4)."""
    total: float = t[a, 0] * field[0, b] + t[a, 1] * field[1, b] + t[a, 2] * field[2, b]
    return total


@numba.njit(cache=True, nogil=True)
def fill_drifts(
    kinds: Indices, parents: Indices, directions: Array, transforms: Array, drifts: Array
) -> None:
    """Fill drifts (D + 1, S, 3): of the frame after each degree of freedom, per unit of each coefficient.

    transforms (D + 1, 3, 4) are T_rig_rest. A rotation from R_parent to R about a point p, which moves in its
    direction of `directions` (S, D, 3), adds (R_parent - R) p to the translation.
    """
    for j in range(len(parents) if drifts.shape[1] > 0 else 0):
        parent = parents[j]
        for s in range(drifts.shape[1]):
            for a in range(3):
                total = drifts[parent, s, a] if parent >= 0 else 0.0
                if kinds[j] == ROTATION:
                    for b in range(3):
                        before = transforms[parent, a, b] if parent >= 0 else (1.0 if a == b else 0.0)
                        total += (before - transforms[j, a, b]) * directions[s, j, b]
                drifts[j, s, a] = total


@numba.njit(cache=True, nogil=True)
def place_fields(t: Array, at_rest: Array, drifts: Array, out: Array) -> None:
    """Fill out (S, 3, 4) with a link's fields in the rig, for its T_rig_rest t and drifts (S, 3)."""
    for s in range(len(out)):
        field = at_rest[s]
        for a in range(3):
            for b in range(4):
                out[s, a, b] = row_product(t, field, a, b)
            out[s, a, 3] += drifts[s, a]
