"""Refine particles by articulated ICP: steps 4a-4d, two or three times, and then step 5.

A particle's result depends on its own pose, the model, the observation and the settings; never on the
batch it came in.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.kinematics import chain
from common.refinement import Refined
from common.settings import RefineSettings
from worker.correspondence import closest_points
from worker.evidence import Evidence, Rules, lay_out_evidence, lay_out_rules
from worker.free_space import pull_into_silhouette
from worker.gauss_newton import add_correspondence, clamp, minimise
from worker.likelihood import robust_cost, robust_weight
from worker.observation import Observation
from worker.surface import Skeleton, Surface, lay_out
from worker.visibility import pose_surface, visible_vertices

Array = NDArray[np.float64]


def refine(
    model: BodyModel, observation: Observation, poses: NDArray[np.float64], settings: RefineSettings
) -> Refined:
    """Refine particles.

    Args:
        model: The body.
        observation: The frame's observed points, camera frame, metres.
        poses: Particles (N, D) before their descent, metres and radians.
        settings: How to refine.

    Returns:
        Poses (N, D), log likelihoods (N,) and mean residuals (N,) in metres, in the order given.
    """
    skeleton, surface = lay_out(model)
    evidence, rules = lay_out_evidence(observation, settings), lay_out_rules(settings)
    refined = np.array(poses, dtype=np.float64, order="C")  # kernels are compiled for one layout
    log_likelihood, residual = np.empty(len(poses)), np.empty(len(poses))
    for n in range(len(poses)):
        log_likelihood[n], residual[n] = refine_particle(refined[n], skeleton, surface, evidence, rules)
    return Refined(refined, log_likelihood, residual)


@numba.njit(cache=True, nogil=True)
def refine_particle(
    pose: Array, skeleton: Skeleton, surface: Surface, evidence: Evidence, rules: Rules
) -> tuple[float, float]:
    """Refine pose (D,) in place; gives its log likelihood and mean residual in metres."""
    metric = np.array([1.0, 1.0, rules.stretch * rules.stretch])
    if rules.keep_limits:
        clamp(skeleton, pose)
    for _ in range(rules.icp_iterations):
        posed, visible = look(pose, skeleton, surface)  # 4a, 4b
        if len(visible) == 0:
            break
        index, squared = correspond(posed, visible, evidence, rules)  # 4c
        moments, crosses = collect(skeleton, surface, posed, visible, index, squared, evidence, rules)
        minimise(
            skeleton,
            pose,
            moments,
            crosses,
            metric,
            rules.damping + rules.damping_share * evidence.count,
            rules.rest_weight * unexplained(squared, evidence, rules),
            rules.gauss_newton_iterations,
            rules.keep_limits,
        )  # 4d
    return assess(pose, skeleton, surface, evidence, rules)  # 5


@numba.njit(cache=True, nogil=True)
def look(pose: Array, skeleton: Skeleton, surface: Surface) -> tuple[Array, NDArray[np.int64]]:
    """Vertices (V, 3) in the pose, and the indices of those that are seen."""
    transforms = np.empty((len(pose) + 1, 3, 4))
    chain(skeleton.kinds, skeleton.parents, skeleton.axes, skeleton.points, pose, transforms)
    transforms[len(pose)] = np.eye(4)[:3]  # link_dofs of -1: what nothing moves
    t_links = transforms[skeleton.link_dofs]
    posed = np.empty_like(surface.vertices)
    pose_surface(surface.vertices, surface.skin_links, surface.skin_weights, t_links, posed)
    return posed, visible_vertices(posed, surface.triangles)


@numba.njit(cache=True, nogil=True)
def correspond(
    posed: Array, visible: NDArray[np.int64], evidence: Evidence, rules: Rules
) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """For each observed point its closest visible vertex, as a place in `visible`, and how far squared."""
    model = np.empty((len(visible), 3), dtype=np.float32)
    for m in range(len(visible)):
        model[m, 0], model[m, 1] = posed[visible[m], 0], posed[visible[m], 1]
        model[m, 2] = posed[visible[m], 2] * rules.stretch
    return closest_points(evidence.points, evidence.boxes, model)


@numba.njit(cache=True, nogil=True)
def collect(
    skeleton: Skeleton,
    surface: Surface,
    posed: Array,
    visible: NDArray[np.int64],
    index: NDArray[np.int32],
    squared: NDArray[np.float32],
    evidence: Evidence,
    rules: Rules,
) -> tuple[Array, Array]:
    """Moments (L, 4, 4) and crosses (L, 4, 3) of all correspondences, in the camera frame."""
    links = len(skeleton.link_dofs)
    moments, crosses = np.zeros((links, 4, 4)), np.zeros((links, 4, 3))
    mass, targets = np.zeros(len(visible)), np.zeros((len(visible), 3))
    for i in range(evidence.count):
        weight = robust_weight(squared[i], rules.outlier_squared)
        m = index[i]
        mass[m] += weight
        targets[m, 0] += weight * evidence.points[i, 0]
        targets[m, 1] += weight * evidence.points[i, 1]
        targets[m, 2] += weight * evidence.points[i, 2] / rules.stretch
    target = np.empty(3)
    pull = rules.free_space_weight * evidence.count / len(visible)
    for m in range(len(visible)):
        v = visible[m]
        if pull > 0.0:
            away = pull_into_silhouette(posed[v], evidence, target)
            if away > 0.0:
                weight = pull * robust_weight(away, rules.outlier_squared)
                mass[m] += weight
                for a in range(3):
                    targets[m, a] += weight * target[a]
        if mass[m] > 0.0:
            add_correspondence(
                moments,
                crosses,
                posed[v],
                surface.skin_links[v],
                surface.skin_weights[v],
                mass[m],
                targets[m],
            )
    return moments, crosses


@numba.njit(cache=True, nogil=True)
def unexplained(squared: NDArray[np.float32], evidence: Evidence, rules: Rules) -> int:
    """Number of observed points that are so far off that the robust kernel more than halves their weight."""
    count = 0
    for i in range(evidence.count):
        if robust_weight(squared[i], rules.outlier_squared) < 0.5:
            count += 1
    return count


@numba.njit(cache=True, nogil=True)
def assess(
    pose: Array, skeleton: Skeleton, surface: Surface, evidence: Evidence, rules: Rules
) -> tuple[float, float]:
    """Log likelihood of pose (D,), and mean distance of the observed points from the model in metres."""
    posed, visible = look(pose, skeleton, surface)
    if len(visible) == 0 or evidence.count == 0:
        return -np.inf, np.inf
    index, squared = correspond(posed, visible, evidence, rules)
    cost, residual = 0.0, 0.0
    for i in range(evidence.count):
        cost += robust_cost(squared[i], rules.outlier_squared)
        v = visible[index[i]]
        residual += np.sqrt(
            (evidence.points[i, 0] - posed[v, 0]) ** 2
            + (evidence.points[i, 1] - posed[v, 1]) ** 2
            + (evidence.points[i, 2] / rules.stretch - posed[v, 2]) ** 2
        )
    cost /= evidence.count
    if rules.free_space_weight > 0.0:
        cost += rules.free_space_weight * outside(posed, visible, evidence, rules)
    return -0.5 * cost * rules.likelihood_scale, residual / evidence.count


@numba.njit(cache=True, nogil=True)
def outside(posed: Array, visible: NDArray[np.int64], evidence: Evidence, rules: Rules) -> float:
    """Mean robust cost (m^2) of visible model points that lie where the camera saw nothing."""
    target = np.empty(3)
    cost = 0.0
    for m in range(len(visible)):
        away = pull_into_silhouette(posed[visible[m]], evidence, target)
        cost += robust_cost(away, rules.outlier_squared)
    return cost / len(visible)
