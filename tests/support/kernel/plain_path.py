"""The plain path: steps 4a-4d and 5 point by point in numpy and scipy, the oracle that the kernel must match.

Nothing is summed up before it must be: every correspondence has its three rows in the Jacobian matrix. A
vertex whose skin is shared by two links is drawn as a part of each, by its share, with its one residual.
"""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.body import ROOT_DOFS, ROTATION, BodyModel
from gepf.common.camera import Intrinsics, back_project, project
from gepf.common.frame import EMPTY, Frame, SubjectFrame, View
from gepf.common.kinematics import difference, dof_transforms, link_transforms, pose_vertices, retract
from gepf.common.kinematics.chain import motion_axes
from gepf.common.settings import RefineSettings
from gepf.worker.kernel.gauss_newton import CONVERGED
from gepf.worker.kernel.parameters import LIMIT_WEIGHT_M2, OUTLIER_DISTANCE_M, STEPS
from gepf.worker.kernel.visibility import NEAREST_M, PIXEL_M, TOLERANCE_M
from gepf.worker.kernel.workspace import LARGEST_SIDE_PX
from tests.support.bodies import moves

UNITS_PER_METRE = 10_000.0


@dataclass(frozen=True, slots=True, eq=False)
class Factors:
    """Model points (n, 3) at a pose (D,), each on one link, drawn to a target (n, 3) by a weight (n,)."""

    pose: Array
    points: Array
    links: Indices
    targets: Array
    weights: Array


def render(model: BodyModel, pose: Array, camera: Intrinsics, number: int = 0) -> Frame:
    """What a depth camera sees of a body."""
    vertices = pose_vertices(model, pose[None])[0]
    depth = rasterise(
        project(vertices, camera), vertices[:, 2], model.triangles, (camera.height, camera.width)
    )
    units = np.where(np.isfinite(depth), np.rint(depth * UNITS_PER_METRE), 0.0).astype(np.uint16)
    return Frame.of(View(number, number / 30.0, units, UNITS_PER_METRE, camera))


def rasterise(image: Array, z: Array, triangles: Indices, shape: tuple[int, int]) -> Array:
    """Nearest depth (H, W) of the triangles that face the camera, infinite where there is none."""
    buffer = np.full(shape, np.inf)
    drawn = triangles[facing(image, z, triangles)]
    corners = image[drawn]  # (T, 3, 2)
    first = np.ceil(corners.min(axis=1)).astype(int)
    extent = (np.floor(corners.max(axis=1)).astype(int) - first).max(axis=0, initial=-1)
    for offset in np.ndindex(*(extent + 1)):  # one pixel of all triangles at a time
        pixel = first + offset
        shares = barycentric(corners, pixel)
        covered = (shares.min(axis=1) >= -1e-9) & np.all((pixel >= 0) & (pixel < shape[::-1]), axis=1)
        depth = np.sum(shares * z[drawn], axis=1)
        np.minimum.at(buffer, tuple(pixel[covered].T[::-1]), depth[covered])
    return buffer


def barycentric(corners: Array, places: Indices) -> Array:
    """Shares (T, 3) of the corners (T, 3, 2) in places (T, 2)."""
    around = corners - places[:, None]
    following, last = np.roll(around, -1, axis=1), np.roll(around, -2, axis=1)
    areas = following[..., 0] * last[..., 1] - following[..., 1] * last[..., 0]
    return np.asarray(areas / areas.sum(axis=1, keepdims=True))


def facing(image: Array, z: Array, triangles: Indices) -> Mask:
    """Which triangles (T,) in front of the camera show it their outside."""
    a, b, c = (image[triangles[:, i]] for i in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    clear: Mask = (area < 0.0) & (z[triangles].min(axis=1) > NEAREST_M)
    return clear


def visible_vertices(model: BodyModel, pose: Array) -> tuple[Array, Indices]:
    """Steps 4a and 4b: vertices (V, 3) in the pose, and the indices of those that are visible."""
    posed = pose_vertices(model, pose[None])[0]
    z = posed[:, 2]
    image = posed[:, :2] / np.maximum(z, NEAREST_M)[:, None] * z.mean() / PIXEL_M
    shown = facing(image, z, model.triangles)
    corner = np.floor(image.min(axis=0))
    size = np.minimum(np.ceil(image.max(axis=0)) - corner + 1, LARGEST_SIDE_PX).astype(int)
    buffer = rasterise(image - corner, z, model.triangles, (size[1], size[0]))
    front = np.unique(model.triangles[shown])
    pixels = np.floor(image[front] - corner + 0.5).astype(int)
    inside = np.all((pixels >= 0) & (pixels < size), axis=1)
    behind = buffer[tuple(np.clip(pixels, 0, size - 1).T[::-1])]
    return posed, front[~inside | (z[front] <= behind + TOLERANCE_M)]


def observed_points(subject: SubjectFrame) -> Array:
    """Points (P, 3) of the picked pixels, rounded as they are kept."""
    points = back_project(
        subject.largest.image.metres().astype(np.float64), subject.largest.image.intrinsics
    ).reshape(-1, 3)
    return points[subject.largest.picked].astype(np.float32).astype(np.float64)


def closest_points(points: Array, seen: Array, settings: RefineSettings) -> Indices:
    """For each observed point (P, 3) the closest of (Q, 3) in the metric of the noise."""
    metric = np.array([1.0, 1.0, settings.noise_lateral / settings.noise_depth])
    index: Indices = cKDTree(seen * metric).query(points * metric)[1]
    return index


def posed_normals(model: BodyModel, pose: Array) -> Array:
    """Normals (V, 3) of length 1 of the vertices, turned with their first link."""
    corners = model.vertices[model.triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    around = np.zeros_like(model.vertices)
    np.add.at(around, model.triangles.ravel(), np.repeat(across, 3, axis=0))
    transforms = np.concatenate([dof_transforms(model, pose[None])[0], np.eye(4)[None, :3]])
    turns = transforms[model.link_dofs[model.skin_links[:, 0]], :, :3]
    return np.asarray(np.einsum("vij,vj->vi", turns, around / np.linalg.norm(around, axis=1)[:, None]))


def disc_radii(model: BodyModel) -> Array:
    """Radii (V,) of the discs around the vertices: a third of each triangle belongs to a corner."""
    radii = np.zeros(len(model.vertices))
    for a, b, c in model.triangles:
        area = np.linalg.norm(
            np.cross(model.vertices[b] - model.vertices[a], model.vertices[c] - model.vertices[a])
        )
        radii[[a, b, c]] += area / 6.0
    return np.sqrt(radii / np.pi)


def surface_offsets(
    points: Array, vertices: Array, normals: Array, radii: Array, settings: RefineSettings
) -> Array:
    """Offsets (..., P, 3), in the metric of the noise, of points from discs around vertices (..., P, 3).

    Those of points outside of the surface are shorter along the normal, by the root of the weight.
    """
    metric = np.array([1.0, 1.0, settings.noise_lateral / settings.noise_depth])
    axes = normals / metric
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    offsets = (points - vertices) * metric
    across = np.sum(offsets * axes, axis=-1, keepdims=True) * axes
    aside = offsets - across
    within = radii[:, None] / np.maximum(np.linalg.norm(aside, axis=-1, keepdims=True), 1e-9)
    outside = np.sum(offsets * axes, axis=-1, keepdims=True) > 0.0
    scale = np.where(outside & (settings.sensor == "camera"), np.sqrt(settings.outside_weight), 1.0)
    return np.asarray(scale * across + aside - np.minimum(within, 1.0) * aside)


def robust_weight(squared: Array, settings: RefineSettings) -> Array:
    """Geman and McClure's weight, or 1."""
    scale = OUTLIER_DISTANCE_M**2 if settings.sensor == "camera" else 0.0
    return (scale / (scale + squared)) ** 2 if scale > 0.0 else np.ones_like(squared)


def robust_cost(squared: Array, settings: RefineSettings) -> Array:
    """Geman and McClure's cost, or the square."""
    scale = OUTLIER_DISTANCE_M**2 if settings.sensor == "camera" else 0.0
    return scale * squared / (scale + squared) if scale > 0.0 else squared


def is_measurable(model: BodyModel, pose: Array, posed: Array) -> Mask:
    """Which posed (V, 3) are on surfaces that the camera sees at less than 78 degrees from their normal."""
    along = np.sum(posed_normals(model, pose) * posed, axis=1)
    facing: Mask = np.abs(along) > np.cos(np.radians(78.0)) * np.linalg.norm(posed, axis=1)
    return facing


def nearest_outline(seen: Array, facing: Mask, subject: SubjectFrame) -> tuple[Array, Mask]:
    """Nearest pixel (column, row) of the outline to model points (Q, 3); which (Q,) are in free space."""
    camera, depth = subject.largest.image.intrinsics, subject.largest.image.depth
    left, top, right, bottom = subject.largest.extent
    pixels = project(seen, camera)
    cells = np.floor(pixels + 0.5).astype(int)
    viewed = np.all((cells >= (left, top)) & (cells < (right, bottom)), axis=1)
    inside = np.clip(cells, 0, np.array(depth.shape[::-1]) - 1)
    empty = depth == 0 if subject.largest.labels is None else subject.largest.labels == EMPTY
    nearest = distance_transform_edt(empty, return_distances=False, return_indices=True)
    outline = nearest[::-1, inside[:, 1], inside[:, 0]].T  # (Q, 2) column, row
    off = outline - pixels
    free = facing & viewed & np.any(np.abs(off) > 1.0, axis=1) & (seen[:, 2] > NEAREST_M)
    outside = np.any(cells != inside, axis=1)
    return outline, free & (outside | empty[inside[:, 1], inside[:, 0]])


def project_onto_silhouette(
    seen: Array, facing: Mask, subject: SubjectFrame, settings: RefineSettings
) -> tuple[Array, Array]:
    """The targets of model points (Q, 3) and the squared distances (Q,), 0 for those not in free space."""
    camera = subject.largest.image.intrinsics
    outline, free = nearest_outline(seen, facing, subject)
    rays = (outline - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    shift = np.column_stack([rays * seen[:, 2:] - seen[:, :2], np.zeros(len(seen))]) * free[:, None]
    along = np.sum(shift[:, :2] * rays, axis=1) / (settings.noise_lateral / settings.noise_depth) ** 2
    return seen + shift - along[:, None] * (0.0, 0.0, 1.0), np.sum(shift**2, axis=1)


def offsets_from_surface(
    model: BodyModel, pose: Array, posed: Array, visible: Indices, points: Array, settings: RefineSettings
) -> tuple[Indices, Array]:
    """Step 4c: the closest visible vertex (P,) of each point (P, 3), and the offset (P, 3) from its disc."""
    vertices = visible[closest_points(points, posed[visible], settings)]
    normals, radii = posed_normals(model, pose)[vertices], disc_radii(model)[vertices]
    return vertices, surface_offsets(points, posed[vertices], normals, radii, settings)


def weighted(settings: RefineSettings, outside_weight: float) -> RefineSettings:
    """The settings with another weight of points outside of the surface."""
    return msgspec.structs.replace(settings, outside_weight=outside_weight)


def weigh_correspondences(
    model: BodyModel,
    pose: Array,
    posed: Array,
    visible: Indices,
    subject: SubjectFrame,
    settings: RefineSettings,
) -> Factors:
    """All correspondences of the body in this pose, point by point."""
    points = observed_points(subject)
    vertices, offsets = offsets_from_surface(model, pose, posed, visible, points, settings)
    whole, gradients = (
        offsets_from_surface(model, pose, posed, visible, points, weighted(settings, weight))[1]
        for weight in (1.0, settings.outside_weight**2)
    )
    squared = np.sum(offsets**2, axis=1)
    share = squared / np.maximum(np.sum(whole**2, axis=1), 1e-30)
    weights = share * robust_weight(squared, settings)
    metric = (1.0, 1.0, settings.noise_lateral / settings.noise_depth)
    targets = posed[vertices] + gradients / share[:, None] / metric
    if settings.sensor == "camera":
        outline, away = project_onto_silhouette(
            posed[visible], is_measurable(model, pose, posed)[visible], subject, settings
        )
        pull = len(points) / len(visible) * robust_weight(away, settings)
        vertices = np.concatenate([vertices, visible[away > 0.0]])
        targets = np.concatenate([targets, outline[away > 0.0]])
        weights = np.concatenate([weights, pull[away > 0.0]])
    return split_by_link(model, pose, posed, vertices, targets, weights)


def split_by_link(
    model: BodyModel, pose: Array, posed: Array, vertices: Indices, targets: Array, weights: Array
) -> Factors:
    """Each correspondence once for every link that its vertex follows, with the residual of the blend.

    The point is where that link alone would carry the vertex; the target is moved along.
    """
    links, shares = model.skin_links[vertices], model.skin_weights[vertices]  # (n, K)
    row, column = np.nonzero(shares)
    link, blended = links[row, column], posed[vertices[row]]
    carriers = link_transforms(model, pose[None])[0][link]
    carried = np.einsum("nij,nj->ni", carriers[:, :, :3], model.vertices[vertices[row]]) + carriers[:, :, 3]
    return Factors(pose, carried, link, targets[row] + carried - blended, weights[row] * shares[row, column])


def move_with_links(model: BodyModel, factors: Factors, pose: Array) -> Array:
    """Where the factors' points (n, 3) are when the body has moved on to a pose (D,)."""
    still = np.eye(4)[None, :3]
    before, after = (
        np.concatenate([dof_transforms(model, p[None])[0], still])[model.link_dofs[factors.links]]
        for p in (factors.pose, pose)
    )
    rest = np.einsum("nji,nj->ni", before[:, :, :3], factors.points - before[:, :, 3])
    found: Array = np.einsum("nij,nj->ni", after[:, :, :3], rest) + after[:, :, 3]
    return found


def step_axes(model: BodyModel, poses: Array) -> tuple[Array, Array]:
    """Axes w and points q (N, D, 3) of relative motion in poses (N, D). Eq. 2."""
    w, q = np.empty((2, *poses.shape, 3))
    for n, transforms in enumerate(dof_transforms(model, poses)):
        motion_axes(model.parents, model.axes, model.points, model.balls, transforms, w[n], q[n])
    return w, q


def jacobian(model: BodyModel, factors: Factors, pose: Array, points: Array) -> Array:
    """J (3n, D) of the carried points (n, 3), Eq. 1 and 2, one point at a time."""
    w, q = (a[0] for a in step_axes(model, pose[None]))
    moved = moves(model)
    found = np.zeros((len(points), 3, len(pose)))
    for j in range(len(pose)):
        of_j = moved[j, factors.links]
        found[of_j, :, j] = np.cross(w[j], points[of_j] - q[j]) if model.kinds[j] == ROTATION else w[j]
    return found.reshape(-1, len(pose))


def equations(
    model: BodyModel, factors: Factors, pose: Array, settings: RefineSettings
) -> tuple[Array, Array]:
    """J^T J (D, D) and J^T r (D,) of Eq. 4 at a pose (D,), in the noise's metric."""
    points = move_with_links(model, factors, pose)
    matrix = jacobian(model, factors, pose, points)
    residual = (points - factors.targets).ravel()
    metric = np.array([1.0, 1.0, (settings.noise_lateral / settings.noise_depth) ** 2])
    weights = (factors.weights[:, None] * metric).ravel()
    return matrix.T @ (weights[:, None] * matrix), matrix.T @ (weights * residual)


def minimise(model: BodyModel, factors: Factors, count: int, settings: RefineSettings) -> Array:
    """Step 4d: the pose (D,) after Gauss-Newton steps on fixed correspondences."""
    pose = factors.pose.copy()
    for _ in range(STEPS[settings.descent].gauss_newton_iterations):
        gram, gradient = equations(model, factors, pose, settings)
        gram += np.eye(len(pose)) * (settings.damping + STEPS[settings.descent].damping_share * count)
        gram, gradient = add_rest_prior(model, pose, rest_weight(settings) * count, gram, gradient)
        gram, gradient = add_limit_prior(model, pose, LIMIT_WEIGHT_M2 * count, gram, gradient)
        free = ~active_limits(model, pose, gradient)
        step = np.zeros_like(pose)
        step[free] = np.linalg.solve(gram[np.ix_(free, free)], -gradient[free])
        pose = clamp_to_limits(model, retract(model, pose[None], step[None])[0])
        if np.abs(step).max() < CONVERGED:
            break
    return pose


def nats(settings: RefineSettings) -> float:
    """Twice the log posterior of a mean cost of one square metre."""
    soft = settings.independent_points / settings.noise_lateral**2
    return soft if settings.is_soft else settings.likelihood_scale**-2.0


def rest_weight(settings: RefineSettings) -> float:
    """Of a squared joint angle, for each point, so that the prior has its deviation in the likelihood."""
    known = settings.pose_deviation > 0.0
    return (settings.likelihood_scale / settings.pose_deviation) ** 2 if known else 0.0


def prior_costs(model: BodyModel, poses: Array, settings: RefineSettings) -> Array:
    """Prior cost of poses (N, D) per point: distance from rest, and balls beyond their limits."""
    away = difference(model, np.zeros_like(poses), poses)
    away[:, [name in ROOT_DOFS for name in model.dof_names]] = 0.0
    cost = rest_weight(settings) * np.sum((away / model.rest_spreads) ** 2, axis=1)
    excess = poses - np.clip(poses, *model.limits.T)
    for start in model.balls:
        counts = np.abs(np.cos(poses[:, start + 1])) > 0.3
        cost += LIMIT_WEIGHT_M2 * counts * np.sum(excess[:, start : start + 3] ** 2, axis=1)
    return np.asarray(cost)


def add_rest_prior(
    model: BodyModel, pose: Array, stiffness: float, gram: Array, gradient: Array
) -> tuple[Array, Array]:
    """Half the squared way from the rest pose in its spreads, the root's aside, added to the equations."""
    way = difference(model, np.zeros((1, len(pose))), pose[None])[0]
    joints = np.array([name not in ROOT_DOFS for name in model.dof_names], dtype=np.float64)
    drawn = stiffness * joints / model.rest_spreads**2
    return gram + np.diag(drawn), gradient + drawn * way


def add_limit_prior(
    model: BodyModel, pose: Array, stiffness: float, gram: Array, gradient: Array
) -> tuple[Array, Array]:
    """Half the squared excess of balls over their limits; angles change with a step as `retract` says."""
    gram, gradient, small = gram.copy(), gradient.copy(), 1e-6
    excess = pose - np.clip(pose, *model.limits.T)
    for start in model.balls:
        if abs(np.cos(pose[start + 1])) <= 0.3:
            continue
        steps = small * np.eye(len(pose))[start : start + 3]
        ahead, behind = (retract(model, np.tile(pose, (3, 1)), s) for s in (steps, -steps))
        ball = slice(start, start + 3)
        rates = (ahead - behind)[:, ball].T / (2.0 * small)  # angle by step
        outside = rates[excess[ball] != 0.0]
        gradient[ball] += stiffness * rates.T @ excess[ball]
        gram[ball, ball] += stiffness * outside.T @ outside
    return gram, gradient


def single(model: BodyModel) -> Mask:
    """Degrees of freedom (D,) that are no part of a ball."""
    found = np.ones(len(model.dof_names), dtype=bool)
    found[(model.balls[:, None] + np.arange(3)).ravel()] = False
    return found


def active_limits(model: BodyModel, pose: Array, gradient: Array) -> Mask:
    """Single axes (D,) at a limit that are pushed out of it."""
    low, high = model.limits.T
    pushed: Mask = ((pose <= low) & (gradient > 0.0)) | ((pose >= high) & (gradient < 0.0))
    return pushed & single(model)


def clamp_to_limits(model: BodyModel, pose: Array) -> Array:
    """The pose (D,) with single axes within their limits."""
    return np.where(single(model), np.clip(pose, *model.limits.T), pose)


def evaluate(
    model: BodyModel, pose: Array, subject: SubjectFrame, settings: RefineSettings
) -> tuple[float, float]:
    """Step 5: log posterior and mean residual, by what is visible in the pose."""
    posed, visible = visible_vertices(model, pose)
    points = observed_points(subject)
    if len(visible) == 0:
        return -np.inf, np.inf
    offsets = offsets_from_surface(model, pose, posed, visible, points, settings)[1]
    cost = robust_cost(np.sum(offsets**2, axis=1), settings).mean()
    measurable = is_measurable(model, pose, posed)[visible]
    _, away = project_onto_silhouette(posed[visible], measurable, subject, settings)
    if settings.sensor == "camera":
        cost += robust_cost(away, settings).mean()
    cost += prior_costs(model, pose[None], settings)[0]
    metric = (1.0, 1.0, settings.noise_lateral / settings.noise_depth)
    whole = offsets_from_surface(model, pose, posed, visible, points, weighted(settings, 1.0))[1]
    residual = np.linalg.norm(whole / metric, axis=1).mean()
    return float(-0.5 * cost / settings.likelihood_scale**2), float(residual)


def refine(
    model: BodyModel, subject: SubjectFrame, pose: Array, settings: RefineSettings
) -> tuple[Array, float, float]:
    """Steps 4a-4d for all iterations, and then step 5."""
    pose = clamp_to_limits(model, pose)
    visible = np.empty(0, dtype=np.int64)
    for k in range(settings.icp_iterations):
        posed, seen = visible_vertices(model, pose)
        visible = seen if k % STEPS[settings.descent].visibility_interval == 0 else visible
        if len(visible) == 0:
            break
        factors = weigh_correspondences(model, pose, posed, visible, subject, settings)
        moved = minimise(model, factors, len(subject.largest.picked), settings)
        settled = np.abs(moved - pose).max() < STEPS[settings.descent].settled
        if settled or k == settings.icp_iterations - 1:
            pose = moved
            break
        pose = over_relax(model, pose, moved, settings)
    return pose, *evaluate(model, pose, subject, settings)


def over_relax(model: BodyModel, before: Array, pose: Array, settings: RefineSettings) -> Array:
    """The pose (D,), extrapolated by the last motion if the descent is accelerated."""
    step = STEPS[settings.descent].over_relaxed * difference(model, before[None], pose[None])
    return clamp_to_limits(model, retract(model, pose[None], step)[0])
