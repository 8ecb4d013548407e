"""What a frame shows of a posed body's surface: vertex by vertex, through a coarse depth buffer."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.compiling import numba
from common.frame import EMPTY, SUBJECT, SubjectFrame
from common.kinematics import pose_vertices

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
States = NDArray[np.uint8]

AWAY, COVERED, SHOWN, NEARER, VIOLATED, UNKNOWN = range(6)
"""States of a vertex: it faces away; the body hides it; the frame shows it; something nearer is measured;
something farther is, or nothing is there; the frame does not say."""

CELL = 0.02  # metres of the depth buffer at the body's mean distance
LARGEST_SIDE = 256  # cells
BEHIND = 0.04  # metres behind the depth buffer up to which a vertex is in sight
CLOSE = 0.08  # metres between a vertex and the depth measured there, if it is the vertex that was measured
ASIDE = 0.03  # metres across within which it is looked for
CLOSEST = 0.1  # metres from the camera's plane


class Seen(NamedTuple):
    """A posed surface, and what of it a frame shows."""

    posed: Array  # (V, 3) metres, camera frame
    normals: Array  # (V, 3) of the length of each vertex' share of the surface, square metres
    facing: Array  # (V,) square metres of it across the line of sight; 0 where it faces away
    states: States  # (V,)
    off: Array  # (V,) from what is measured along the line of sight, in metres of the noise; 0 unless SHOWN


class Picture(NamedTuple):
    """A frame for compiled code."""

    depth: NDArray[np.uint16]  # (H, W)
    scale: float  # units per metre
    kinds: States  # (H, W)
    window: tuple[int, int, int, int]  # left, top, right, bottom of what the camera saw
    lens: tuple[float, float, float, float]  # fx, fy, cx, cy
    stretch: float


def see_surface(model: BodyModel, pose: Array, subject: SubjectFrame, stretch: float) -> Seen:
    """What a frame shows of the surface in pose (D,).

    Distances along the line of sight count in metres of the noise: `stretch`, the lateral over the depth
    noise, times what they are. So they mean the same whatever the camera.
    """
    posed = pose_vertices(model, pose[None])[0]
    count, camera = len(posed), subject.frame.intrinsics
    seen = Seen(
        posed, np.zeros((count, 3)), np.zeros(count), np.empty(count, dtype=np.uint8), np.zeros(count)
    )
    face(posed, model.triangles, seen.normals, seen.facing)
    kinds = subject.kinds
    if kinds is None:
        kinds = np.where(subject.frame.depth > 0, np.uint8(SUBJECT), np.uint8(EMPTY))
    lens = (camera.fx, camera.fy, camera.cx, camera.cy)
    picture = Picture(subject.frame.depth, subject.frame.depth_scale, kinds, subject.view, lens, stretch)
    compare(seen, model.triangles, picture)
    return seen


@numba.njit(cache=True, nogil=True)
def face(posed: Array, triangles: Indices, normals: Array, facing: Array) -> None:
    """Fill normals (V, 3) and facing (V,), zero before: each triangle gives a third to every corner."""
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ux, uy, uz = posed[b, 0] - posed[a, 0], posed[b, 1] - posed[a, 1], posed[b, 2] - posed[a, 2]
        vx, vy, vz = posed[c, 0] - posed[a, 0], posed[c, 1] - posed[a, 1], posed[c, 2] - posed[a, 2]
        nx, ny, nz = (uy * vz - uz * vy) / 6.0, (uz * vx - ux * vz) / 6.0, (ux * vy - uy * vx) / 6.0
        for corner in (a, b, c):
            normals[corner, 0] += nx
            normals[corner, 1] += ny
            normals[corner, 2] += nz
    for v in range(len(posed)):
        x, y, z = posed[v]
        away = normals[v, 0] * x + normals[v, 1] * y + normals[v, 2] * z
        facing[v] = max(0.0, -away / max(np.sqrt(x * x + y * y + z * z), CLOSEST))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def draw_depth(posed: Array, triangles: Indices, cells: Array) -> tuple[NDArray[np.float32], int, int, float]:
    """Nearest depth (H, W) of the surface in cells, infinite where it is not; left, top and cells a unit.

    Fills cells (V, 2) with the vertices' columns and rows in it.
    """
    focal = float(np.mean(posed[:, 2])) / CELL
    left = top = np.inf
    right = bottom = -np.inf
    for v in range(len(posed)):
        z = max(posed[v, 2], CLOSEST)
        column, row = focal * posed[v, 0] / z, focal * posed[v, 1] / z
        left, right, top, bottom = min(left, column), max(right, column), min(top, row), max(bottom, row)
        cells[v, 0], cells[v, 1] = column, row
    first, above = int(np.floor(left)), int(np.floor(top))
    width = max(1, min(LARGEST_SIDE, int(np.ceil(right)) - first + 1))
    height = max(1, min(LARGEST_SIDE, int(np.ceil(bottom)) - above + 1))
    for v in range(len(posed)):
        cells[v, 0] -= first
        cells[v, 1] -= above
    depth = np.full((height, width), np.float32(np.inf))
    draw_triangles(posed, cells, triangles, depth)
    return depth, first, above, focal


@numba.njit(cache=True, nogil=True, error_model="numpy")
def draw_triangles(posed: Array, cells: Array, triangles: Indices, depth: NDArray[np.float32]) -> None:
    """Draw all that faces the camera into depth (H, W), wherever it covers the middle of a cell.

    All in one function: what is called for each triangle counts references.
    """
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        za, zb, zc = posed[a, 2], posed[b, 2], posed[c, 2]
        ax, ay = cells[a, 0], cells[a, 1]
        bx, by = cells[b, 0] - ax, cells[b, 1] - ay
        cx, cy = cells[c, 0] - ax, cells[c, 1] - ay
        shown = bx * cy < by * cx  # counter-clockwise from outside, y points down
        if not shown or min(za, zb, zc) <= CLOSEST:
            continue
        first_column = max(0, int(np.ceil(ax + min(0.0, bx, cx))))
        last_column = min(depth.shape[1] - 1, int(np.floor(ax + max(0.0, bx, cx))))
        first_row = max(0, int(np.ceil(ay + min(0.0, by, cy))))
        last_row = min(depth.shape[0] - 1, int(np.floor(ay + max(0.0, by, cy))))
        if first_column > last_column or first_row > last_row:
            continue
        scale = 1.0 / (bx * cy - by * cx)
        for row in range(first_row, last_row + 1):
            for column in range(first_column, last_column + 1):
                x, y = column - ax, row - ay
                wb, wc = (x * cy - y * cx) * scale, (bx * y - by * x) * scale
                if min(wb, wc, 1.0 - wb - wc) >= -1e-9:
                    here = np.float32(za + wb * (zb - za) + wc * (zc - za))
                    depth[row, column] = min(depth[row, column], here)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def compare(seen: Seen, triangles: Indices, picture: Picture) -> None:
    """Fill the states (V,) and distances `off` (V,) of a posed surface."""
    cells = np.empty((len(seen.posed), 2))
    nearest, left, top, focal = draw_depth(seen.posed, triangles, cells)
    fx, fy, cx, cy = picture.lens
    left_edge, top_edge, right_edge, bottom_edge = picture.window
    scale, stretch = picture.scale, picture.stretch
    for v in range(len(seen.posed)):
        x, y, z = seen.posed[v]
        seen.off[v] = 0.0
        if seen.facing[v] <= 0.0 or z <= CLOSEST:
            seen.states[v] = AWAY
            continue
        column, row = int(np.floor(focal * x / z - left + 0.5)), int(np.floor(focal * y / z - top + 0.5))
        inside = 0 <= row < nearest.shape[0] and 0 <= column < nearest.shape[1]
        if inside and z > nearest[row, column] + BEHIND:
            seen.states[v] = COVERED
        else:
            u, w = cx + fx * x / z, cy + fy * y / z
            if left_edge <= np.floor(u + 0.5) < right_edge and top_edge <= np.floor(w + 0.5) < bottom_edge:
                state, off = look(u, w, z, fx * ASIDE / z, picture.depth, picture.kinds, scale, stretch)
                seen.states[v], seen.off[v] = state, off
            else:
                seen.states[v] = UNKNOWN


@numba.njit(cache=True, nogil=True, error_model="numpy")
def look(
    u: float,
    w: float,
    z: float,
    aside: float,
    depth: NDArray[np.uint16],
    kinds: States,
    scale: float,
    stretch: float,
) -> tuple[int, float]:
    """The state of a vertex in sight at pixel (u, w) and z metres, and its distance from what is measured.

    It is looked for in that pixel, and where it is not there in eight, so many pixels aside, around it.
    """
    column, row = int(np.floor(u + 0.5)), int(np.floor(w + 0.5))
    state, off = VIOLATED, np.inf
    if 0 <= row < kinds.shape[0] and 0 <= column < kinds.shape[1]:
        if kinds[row, column] == SUBJECT:
            off = float(depth[row, column] / scale - z) * stretch
            state = NEARER if off < 0.0 else VIOLATED
        elif kinds[row, column] != EMPTY:
            state = UNKNOWN
    if abs(off) > CLOSE:
        for k in range(9):
            r = int(np.floor(w + aside * (k // 3 - 1) + 0.5))
            c = int(np.floor(u + aside * (k % 3 - 1) + 0.5))
            if 0 <= r < kinds.shape[0] and 0 <= c < kinds.shape[1] and kinds[r, c] == SUBJECT:
                beside = float(depth[r, c] / scale - z) * stretch
                off = beside if abs(beside) < abs(off) else off
    return (SHOWN, off) if abs(off) <= CLOSE else (state, 0.0)
