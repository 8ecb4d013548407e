"""The log posterior of poses near one, written down once: what the descent climbs and what a weight is.

Of a frame's points p_i, a body in a pose with vertices x_v and its prior,

    hard:  -1/2 (mean_i rho(|p_i - x_c(i)|^2) + w mean_v e_v rho(|f_v|^2) + prior) / T^2
    soft:  N (mean_i log(sum_k a_k g(p_i - x_k) + e) - 1/2 prior / s^2)

Held still about a pose are what belongs together and what is seen there: the closest visible vertex c(i) of
each point, or the samples x_k around it, each for the same solid angle; the visible vertices v, how surely
(e_v) each is in free space, and the pixel of the outline from which it is f_v away. A weight is the value at
the pose where they are taken; the descent's right side is its slope there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.body import ROOT_DOFS, BodyModel
from common.frame import SubjectFrame
from common.kinematics import difference, link_transforms, pose_vertices, retract
from common.settings import RefineSettings
from tests.support.kernel import plain_path
from worker.kernel.parameters import FREE_SPACE_WEIGHT, pack_parameters
from worker.kernel.priors import LIMIT_SHARE
from worker.kernel.soft import OUTLIER_DENSITY, SampleGrid, sample_radius

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

STEP = 1e-6  # radians and metres


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """The samples around each point (P, K): which link carries them, where on it, and their areas."""

    links: Indices  # (P, K)
    at_rest: Array  # (P, K, 3)
    angles: Array  # (P, K) solid angles that they stand for; 0 where there is none


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """What is held still about a pose."""

    model: BodyModel
    settings: RefineSettings
    points: Array  # (P, 3)
    closest: Indices  # (P,) vertices
    visible: Indices  # (Q,) vertices
    rays: Array  # (Q, 2) of the outline's nearest pixels, for each metre of depth
    free: Array  # (Q,) how surely each of them is in free space
    samples: Samples | None  # of soft correspondences


def hold(
    model: BodyModel,
    pose: Array,
    subject: SubjectFrame,
    settings: RefineSettings,
    grid: SampleGrid | None = None,
) -> Held:
    """What is seen and what belongs together at a pose (D,); with a grid of samples of it, softly."""
    posed, visible = plain_path.visible_vertices(model, pose)
    points, camera = plain_path.observed_points(subject), subject.frame.intrinsics
    index, _ = plain_path.closest_points(points, posed[visible], settings)
    facing = plain_path.is_measurable(model, pose, posed)[visible]
    outline, free = plain_path.nearest_outline(posed[visible], facing, subject)
    rays = (outline - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    samples = None if grid is None else take_samples(model, pose, points, settings, grid)
    return Held(model, settings, points, visible[index], visible, rays, free, samples)


def take_samples(
    model: BodyModel, pose: Array, points: Array, settings: RefineSettings, grid: SampleGrid
) -> Samples:
    """The samples of a grid, taken at a pose (D,), around the ray of each point (P, 3)."""
    radius = sample_radius(pack_parameters(settings))
    rays = points[:, :2] / points[:, 2:]
    middle = np.floor(grid.focal * rays - (grid.left, grid.top) + 0.5).astype(int)
    around = np.arange(-radius, radius + 1)
    window = np.stack(np.meshgrid(around, around, indexing="xy"), axis=-1).reshape(-1, 2)
    size = np.array(grid.depth.shape[::-1])
    inside = np.all((middle >= radius) & (middle < size - radius), axis=1)
    place = np.where(inside[:, None, None], middle[:, None] + window, 0)  # (P, K, 2)
    z = grid.depth[place[..., 1], place[..., 0]].astype(np.float64)
    links = grid.links[place[..., 1], place[..., 0]].astype(np.int64)
    there = np.isfinite(z)
    z, links = np.where(there, z, 1.0), np.where(there, links, 0)
    x, y = (place[..., a] + edge for a, edge in enumerate((grid.left, grid.top)))
    at = np.stack([x * z / grid.focal, y * z / grid.focal, z], axis=-1)
    carriers = link_transforms(model, pose[None])[0][links]
    at_rest = np.einsum("pkba,pkb->pka", carriers[..., :3], at - carriers[..., 3])
    return Samples(links, at_rest, there / grid.focal**2)


def log_posterior(held: Held, poses: Array) -> Array:
    """The log posterior (N,) of poses (N, D)."""
    settings = held.settings
    prior = prior_costs(held, poses)
    if held.samples is not None:
        density = log_density(held, held.samples, poses).mean(axis=1)
        return np.asarray(settings.independent_points * (density - 0.5 * prior / settings.noise_lateral**2))
    posed = pose_vertices(held.model, poses)
    cost = point_cost(held, posed) + free_space_cost(held, posed) + prior
    return np.asarray(-0.5 * cost / settings.likelihood_scale**2)


def point_cost(held: Held, posed: Array) -> Array:
    """Mean robust cost (N,) of the points, in the metric of the noise, for surfaces (N, V, 3)."""
    settings = held.settings
    metric = np.array([1.0, 1.0, settings.noise_lateral / settings.noise_depth])
    squared = np.sum(((posed[:, held.closest] - held.points) * metric) ** 2, axis=-1)
    return np.asarray(plain_path.robust_cost(squared, settings).mean(axis=1))


def free_space_cost(held: Held, posed: Array) -> Array:
    """Mean robust cost (N,) of visible vertices that lie where the camera saw nothing, times its weight."""
    seen = posed[:, held.visible]
    off = held.rays * seen[..., 2:] - seen[..., :2]
    cost = plain_path.robust_cost(np.sum(off**2, axis=-1), held.settings) * held.free
    weight = FREE_SPACE_WEIGHT if held.settings.sensor == "camera" else 0.0
    return np.asarray(weight * cost.mean(axis=1))


def prior_costs(held: Held, poses: Array) -> Array:
    """What poses (N, D) cost for each point, whatever is observed: far from rest, or balls out of limits."""
    model, settings = held.model, held.settings
    away = difference(model, np.zeros_like(poses), poses)
    away[:, [name in ROOT_DOFS for name in model.dof_names]] = 0.0
    stiffness = 0.0 if held.samples is not None else plain_path.rest_weight(settings)
    cost = stiffness * np.sum((away / model.rest_spreads) ** 2, axis=1)
    excess = poses - np.clip(poses, *model.limits.T)
    for start in model.balls:
        counts = np.abs(np.cos(poses[:, start + 1])) > 0.3
        cost += LIMIT_SHARE * counts * np.sum(excess[:, start : start + 3] ** 2, axis=1)
    return np.asarray(cost)


def log_density(held: Held, samples: Samples, poses: Array) -> Array:
    """Log p(p_i) (N, P) of the points, the samples carried along by their links."""
    noise = held.settings.noise_lateral, held.settings.noise_depth
    found = np.empty((len(poses), len(held.points)))
    for n, transforms in enumerate(link_transforms(held.model, poses)):
        carriers = transforms[samples.links]
        at = np.einsum("pkab,pkb->pka", carriers[..., :3], samples.at_rest) + carriers[..., 3]
        rays = held.points[:, None, :2] / held.points[:, None, 2:]
        across = np.sum((rays * at[..., 2:] - at[..., :2]) ** 2, axis=-1) / noise[0] ** 2
        along = (held.points[:, None, 2] - at[..., 2]) ** 2 / noise[1] ** 2
        areas = samples.angles * (at[..., 2] / noise[0]) ** 2
        each = areas / (2.0 * np.pi) * np.exp(-0.5 * (across + along))
        found[n] = np.log(each.sum(axis=1) + OUTLIER_DENSITY)
    return found


def slope(held: Held, pose: Array) -> Array:
    """Its derivative (D,) by every degree of freedom's step from a pose (D,), by finite differences."""
    steps = STEP * np.eye(len(pose))
    sides = [retract(held.model, np.tile(pose, (len(pose), 1)), way) for way in (steps, -steps)]
    ahead, behind = np.split(log_posterior(held, np.concatenate(sides)), 2)
    return np.asarray((ahead - behind) / (2.0 * STEP))
