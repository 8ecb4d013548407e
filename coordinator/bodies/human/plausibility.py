"""What cannot be a person, although the template fits it: furniture, an impossible place, a wrong scale."""

from __future__ import annotations

import msgspec
import numpy as np
from scipy.ndimage import generate_binary_structure, maximum_filter, minimum_filter

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.body import BodyModel
from gepf.common.camera import pixels_at
from gepf.common.frame import EMPTY, SubjectFrame, SubjectView
from gepf.common.kinematics import pose_vertices
from gepf.coordinator.bodies.family import FittedBody


class PersonLimits(msgspec.Struct, frozen=True):
    """What a person may be like. Shares of extents are of the stature."""

    min_extent_share: float = 0.35  #: of a person in a frame; else the depth scale is wrong
    min_part_share: float = 0.2  #: the same if a part is in view: head and shoulders
    max_extent_share: float = 1.6
    max_head_below_m: float = 0.2  #: of the head below the pelvis
    max_below_floor_m: float = 0.25  #: of the lowest joint
    max_above_floor_m: float = 0.8  #: the same; somebody may lie on a high bed
    min_shown_share: float = 0.75  #: agreeing share of head or legs: people have at least 0.79
    agrees_m: float = 0.06  #: largest distance in depth between the body and what shows it
    cell_share: float = 0.018  #: side of the cells that are drawn; vertices and triangles fill them


LIMITS = PersonLimits()
CROSS = generate_binary_structure(2, 1)  # a cell and its four neighbours
PARTS = {"head": ("head",), "legs": ("hip", "knee", "ankle")}  # and their joints


def reject(body: FittedBody, stature: float) -> str:
    """Why a fitted body is not a person; empty if it may be."""
    at = body.model.joint_names.index
    why = reject_points(body.points, stature, whole=not body.is_cut)
    if not (body.is_cut and body.in_view[at("head")]):  # a near trunk is as flat as furniture
        why = why or reject_planes(body.some_points, body.residual)
    why = why or reject_parts(body.model, body.pose, body.subject, stature)
    if body.heights is not None:
        rises = float(body.heights[at("head")] - body.heights[at("pelvis")])
        why = why or reject_position(rises, float(body.heights.min()))
    return why


def reject_points(points: Array, stature: float, *, whole: bool = True) -> str:
    """Why points (P, 3) are too far apart, or too close together, for a person of this stature; empty if not.

    A person who is not `whole`, but cut by the image or something nearer, may be smaller.
    """
    low, high = np.percentile(points, [1.0, 99.0], axis=0)
    span = float(np.max(high - low))
    least = LIMITS.min_extent_share if whole else LIMITS.min_part_share
    if least * stature <= span <= LIMITS.max_extent_share * stature:
        return ""
    size = f"{span:.1f} m" if span >= 1.0 else f"{100 * span:.0f} cm"
    return f"the observed points extend over {size}, unlike a person: is depth_scale right?"


def reject_planes(points: Array, residual: float) -> str:
    """Why a subject with points (P, 3) is not a person; empty if it may be.

    Furniture has large sides that are nearly flat. So two planes are nearer to its points than the body is.
    `residual` is their mean distance from the body's surface, metres.
    """
    if fit_two_planes(points) < residual:
        return "two planes fit the observed points better than a body: an object, not a person"
    return ""


def fit_two_planes(points: Array) -> float:
    """Mean distance of points (P, 3) from the nearer of two planes that fit them.

    The points are divided at their middle, across each of their principal axes. Then, alternately, a plane is
    fitted to each part, and each point is assigned to the nearer plane.
    """
    centred, found = points - points.mean(axis=0), list[float]()
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    products = (centred[:, :, None] * centred[:, None]).reshape(-1, 9)
    first = axes @ centred.T > 0.0  # (A, P) for each of the axes
    for _ in range(8):
        parts = np.concatenate([first, ~first]).astype(np.float64)
        counts = np.maximum(parts.sum(axis=1, keepdims=True), 1.0)
        means = parts @ centred / counts
        spreads = (parts @ products / counts).reshape(-1, 3, 3) - means[:, :, None] * means[:, None]
        normals = np.linalg.eigh(spreads)[1][:, :, 0]
        apart = np.abs(normals @ centred.T - np.sum(normals * means, axis=1, keepdims=True))
        near, far = np.split(apart, 2)
        found.append(float(np.minimum(near, far).mean(axis=1).min()))
        first = near <= far
    return min(found)


def reject_parts(model: BodyModel, pose: Array, subject: SubjectFrame, stature: float) -> str:
    """Why a pose (D,) cannot be a person: the frame contradicts the head or the legs; empty if it does not.

    A pose that hides all of the head or the legs behind the body itself is no evidence of a person.
    """
    surface, links = pose_vertices(model, pose[None])[0], model.skin_links[:, 0]
    surface = np.concatenate([surface, surface[model.triangles].mean(axis=1)])
    links = np.concatenate([links, links[model.triangles[:, 0]]])
    views = [agreeing_points(surface, view, LIMITS.cell_share * stature) for view in subject.views]
    drawn, agrees = (np.concatenate(each) for each in zip(*views, strict=True))
    for part, names in PARTS.items():
        joints = [n for n, joint in enumerate(model.joint_names) if joint.split("_")[-1] in names]
        mine = agrees[np.isin(links[drawn], model.joint_links[joints])]
        if np.sum(mine) <= LIMITS.min_shown_share * len(mine):
            return f"where the {part} of the body should be, there is something else: an object, not a person"
    return ""


def agreeing_points(surface: Array, view: SubjectView, cell_m: float) -> tuple[Indices, Mask]:
    """Some points (N,) of a surface (V, 3) that face a camera, and which of them agree with its image (N,).

    They are the nearest ones in each cell of the body's image. Its outline is left out: noise and clothes
    move it. Anything agrees with pixels that are hidden, unmeasured or outside of the image.
    """
    camera, places = view.image.intrinsics, view.image.to_camera(surface)
    ahead = np.flatnonzero(places[:, 2] > cell_m)
    x, y, z = places[ahead].T
    at = np.stack([camera.cy + camera.fy * y / z, camera.cx + camera.fx * x / z])  # rows, columns
    cells = np.floor(at / (cell_m * camera.fx / np.median(z))).astype(np.int64)
    row, column = cells - cells.min(axis=1, keepdims=True)
    image = np.full((row.max() + 1, column.max() + 1), np.inf)
    np.minimum.at(image, (row, column), z)
    low, high = (each(image, footprint=CROSS)[row, column] for each in (minimum_filter, maximum_filter))
    inner = np.flatnonzero((z == image[row, column]) & (z < low + LIMITS.agrees_m) & np.isfinite(high))
    row, column, inside = pixels_at(places[ahead[inner]], camera)
    left, top, right, bottom = view.extent
    empty = ~inside & (left <= column) & (column < right) & (top <= row) & (row < bottom)
    pixels, depth = (row[inside], column[inside]), np.zeros(len(inner))
    depth[inside] = view.image.depth[pixels] / view.image.depth_scale
    empty[inside] = (depth[inside] == 0.0) & (True if view.labels is None else view.labels[pixels] == EMPTY)
    return ahead[inner], ~empty & ((depth == 0.0) | (np.abs(depth - z[inner]) < LIMITS.agrees_m))


def reject_position(rises: float, lowest: float) -> str:
    """Why a body cannot be at its place; empty if it can.

    The head `rises` above the pelvis, and the `lowest` joint is above the floor, by so many metres.
    """
    if rises < -LIMITS.max_head_below_m:
        return "the body is upside down; if the camera is, use --rotate"
    if lowest < -LIMITS.max_below_floor_m:
        return f"the body reaches {-100 * lowest:.0f} cm below the floor"
    if lowest > LIMITS.max_above_floor_m:
        return f"the body floats {100 * lowest:.0f} cm above the floor"
    return ""
