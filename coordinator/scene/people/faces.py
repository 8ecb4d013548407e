"""Flat faces of furniture that hang together with a person in depth.

Any plane cuts a person, but the points near it are spread over all of the noise's margin; those of a face
lie close about it. Planes are sought as floor and walls are, in (x/z, y/z, 1/z).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from common.camera import Intrinsics
from coordinator.scene.people.components import Component, components
from coordinator.scene.room.planes import inverse_margin, plane_inverse, refit, sample
from coordinator.scene.view import SceneView

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ACROSS = 320  # pixels of a picture's width that are looked at
CLOSE = 0.5  # margins of noise, about a plane, within which most of a face's points lie
SHALLOW = 0.035  # metres: where what lies close may be farther off, a trunk is as flat as a face
LEAST_FACE = 0.08  # square metres by which more of it lies close than farther off
LEAST_SHARE = 0.5  # of what is near, the same: of a face 0.8 and more, of a curved surface 0.4 at the most
TRIES = 8  # planes that are looked at
ALIKE = 0.05  # of planes that are looked at but once
AROUND, LEAST_AROUND = 9, 0.3  # pixels a side, and the least share of what is near, as above
CELL, STEP = 10, 5  # pixels: sides of the squares that planes are first fitted to, and from one to the next
FILLED = 0.75  # least share of a square that is the part's
FEWEST = 60  # points
SAMPLED = 1_500  # points that planes are compared by
RIDGE = 1e-9  # of squares whose points lie in a line


def flat_faces(view: SceneView, part: Component) -> Mask:
    """Pixels (H, W) of a part's flat faces; none where the noise is as deep as a trunk."""
    flat = np.zeros(view.depth.shape, dtype=np.bool_)
    if CLOSE * float(np.median(view.noise.margin(part.points[:, 2]))) <= SHALLOW:
        every = max(1, view.camera.width // ACROSS)
        faces = faces_in(thinned(view, part, every), part.inside[::every, ::every])
        rows, columns = part.inside.shape
        whole = faces.repeat(every, axis=0).repeat(every, axis=1)[:rows, :columns]
        flat[part.top : part.top + rows, part.left : part.left + columns] = whole & part.inside
    return flat


def thinned(view: SceneView, part: Component, every: int) -> SceneView:
    """Each so-manieth pixel of the window in which a part is."""
    height, width = part.inside.shape
    depth = view.depth[part.top : part.top + height : every, part.left : part.left + width : every]
    crop, (rows, columns) = view.camera.crop(part.left, part.top, width, height), depth.shape
    camera = Intrinsics(columns, rows, crop.fx / every, crop.fy / every, crop.cx / every, crop.cy / every)
    return replace(view, depth=np.ascontiguousarray(depth), camera=camera, background=np.zeros_like(depth))


def faces_in(view: SceneView, mask: Mask) -> Mask:
    """Which pixels (H, W) of a mask are flat faces'."""
    rays = sample(np.where(mask, view.depth, np.float32(0.0)), view.camera, stride=1)
    margin = inverse_margin(rays, view.noise)
    seen = rays[:, 2] ** -2.0 / (view.camera.fx * view.camera.fy)
    planes, left = local_planes(mask, rays), np.ones(len(rays), dtype=np.bool_)
    for _ in range(TRIES):
        best = most_close(planes, rays[left], margin[left], seen[left])
        if best is None:
            break
        plane = refit(best, rays[left], view.noise, (CLOSE, CLOSE))
        off, area = distances(plane, rays, margin), seen * np.linalg.norm(plane) / rays[:, 2]
        face = large_patches(view, mask, left & (off < 1.0), closeness(off), area)
        left &= ~face
        planes = planes if face.any() else planes[~np.isclose(planes @ best, best @ best, rtol=ALIKE)]
    flat = np.zeros_like(mask)
    flat[mask] = ~left
    return flat


def local_planes(mask: Mask, rays: Array) -> Array:
    """Planes (S, 3) through what fills small squares of a mask (H, W), by least squares."""
    number = np.full(mask.shape, -1)
    number[mask] = np.arange(len(rays))
    height, width = mask.shape
    planes = []
    for top in range(0, height - CELL + 1, STEP):
        for left in range(0, width - CELL + 1, STEP):
            cell = number[top : top + CELL, left : left + CELL]
            on = rays[cell[cell >= 0]]
            if len(on) >= FILLED * CELL * CELL:
                planes.append(fit(on))
    return np.array(planes).reshape(-1, 3)


def fit(rays: Array) -> Array:
    """The plane (3,) through points (P, 3) by least squares."""
    flat = np.column_stack([rays[:, :2], np.ones(len(rays))])
    moments, pull = np.einsum("pi,pj->ij", flat, flat), np.einsum("pi,p->i", flat, rays[:, 2])
    plane: Array = np.linalg.solve(moments + RIDGE * np.eye(3), pull)
    return plane


def distances(plane: Array, rays: Array, margin: Array) -> Array:
    """Of points (P, 3) from a plane, in margins of noise."""
    off: Array = np.abs(plane_inverse(plane, rays) - rays[:, 2]) / margin
    return off


def most_close(planes: Array, rays: Array, margin: Array, seen: Array) -> Array | None:
    """Of planes (S, 3) that about which most points (P, 3) lie close; None if there is no face's worth."""
    if not len(planes) or len(rays) < FEWEST:
        return None
    every = -(-len(rays) // SAMPLED)
    rays, margin, seen = rays[::every], margin[::every], every * seen[::every]
    off = np.abs(rays[:, :2] @ planes[:, :2].T + planes[:, 2] - rays[:, 2:]) / margin[:, None]
    close = np.einsum("p,ps->s", seen, closeness(off))
    close[close < LEAST_SHARE * np.einsum("p,ps->s", seen, (off < 1.0).astype(np.float64))] = 0.0
    best: Array = planes[close.argmax()]
    return best if close.max() > 0.5 * LEAST_FACE else None


def closeness(off: Array) -> Array:
    """1 close about a plane, -1 farther off and 0 beyond the noise, for distances in margins."""
    return (off < CLOSE).astype(np.float64) - ((off >= CLOSE) & (off < 2.0 * CLOSE))


def large_patches(view: SceneView, mask: Mask, near: Mask, close: Array, area: Array) -> Mask:
    """Of a mask's pixels (P,) near a plane those of patches of which enough square metres lie close.

    Without pixels around which as many lie farther off: there something else goes through the plane.

    Args:
        view: The frame in its scene.
        mask: The pixels (H, W).
        near: Which of them (P,) are near the plane.
        close: Their `closeness` (P,).
        area: Square metres (P,) of the plane that each of them shows.
    """
    patches, closes, areas = np.zeros_like(mask), np.zeros(mask.shape), np.zeros(mask.shape)
    patches[mask], closes[mask], areas[mask] = near, np.where(near, close, 0.0), area
    around = uniform_filter(closes, AROUND) / np.maximum(uniform_filter(patches.astype(float), AROUND), 1e-9)
    found = np.zeros_like(mask)
    for patch in components(view, patches):
        each = patch.mask(view)
        if (closes * areas)[each].sum() >= max(LEAST_FACE, LEAST_SHARE * areas[each].sum()):
            found |= each & (around > LEAST_AROUND)
    large: Mask = found[mask]
    return large
