"""Bodies with a coarser surface, for candidates that are refined roughly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from common.body import BodyModel


def coarsen(model: BodyModel, cell_m: float) -> BodyModel:
    """The same body with one vertex for each link and cell: the one nearest the mean of the vertices there.

    Cells are cubes of the rest pose with sides of `cell_m`. Triangles with two corners in one cell go.
    """
    cells = np.column_stack([model.skin_links[:, 0], np.floor(model.vertices / cell_m).astype(np.int64)])
    cells -= cells.min(axis=0)
    number = np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1))
    _, cell, count = np.unique(number, return_inverse=True, return_counts=True)
    means = np.zeros((len(count), 3))
    np.add.at(means, cell, model.vertices)
    distance = np.linalg.norm(model.vertices - (means / count[:, None])[cell], axis=1)
    order = np.lexsort((distance, cell))
    kept = order[np.cumsum(count) - count]  # (cells,) the vertex of each cell
    triangles = cell[model.triangles]
    apart = np.all(triangles != np.roll(triangles, 1, axis=1), axis=1)
    return replace(
        model,
        vertices=model.vertices[kept],
        triangles=triangles[apart],
        skin_links=model.skin_links[kept],
        skin_weights=model.skin_weights[kept],
    )
