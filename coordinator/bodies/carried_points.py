"""Points that move with the surface of a link if the shape of a body changes."""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array, Indices


def carry(
    points: Array, links: Indices, vertices: Array, skin_links: Indices, count: int = 12
) -> tuple[Indices, Array]:
    """Vertices (K, W) of links (K,), and the shares (K, W) by which they sum up to points (K, 3) at rest.

    W is `count`, the number of vertices of a link that carry a point.

    The shares are the smallest possible, so a point moves with the surface of its link if the shape changes.
    """
    carriers, shares = list[Indices](), list[Array]()
    for point, link in zip(points, links, strict=True):
        mine = np.flatnonzero(skin_links[:, 0] == link)
        carriers.append(mine[np.linspace(0, len(mine) - 1, count).round().astype(np.int64)])
        corners = np.column_stack([vertices[carriers[-1]], np.ones(count)])
        share = np.linalg.lstsq(corners.T, np.append(point, 1.0), rcond=None)[0]
        shares.append(share / share.sum())
    return np.array(carriers), np.array(shares)
