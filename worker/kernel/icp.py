"""Refine particles by articulated ICP: steps 4a-4d, two or three times, and then step 5.

Closest points hold the model back: iterations lead the same way with ever shorter steps. So preset `default`
goes twice as far in each iteration but the last, and looks once which points are visible.

A particle's result depends on its own pose, the model, the observation and the settings; never on the
batch it came in.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.bounds import LARGEST_POSE, check_work
from common.kinematics import carry_axes, chain
from common.refinement import Refined
from common.settings import RefineSettings
from worker.kernel.correspondence import Search, closest_again, closest_points, lay_out_search
from worker.kernel.evidence import Evidence, Rules, lay_out_evidence, lay_out_rules
from worker.kernel.free_space import pull_into_silhouette
from worker.kernel.gauss_newton import (
    Descent,
    Equations,
    add_correspondences,
    clamp,
    extend,
    lay_out_equations,
    minimise,
)
from worker.kernel.likelihood import robust_cost, robust_weight
from worker.kernel.observation import Observation
from worker.kernel.samples import Grid, Samples, lay_out_samples, sample
from worker.kernel.soft import Soft, lay_out_soft, mean_log_density, sample_distance, step_softly
from worker.kernel.surface import Skeleton, Surface, lay_out
from worker.kernel.visibility import View, lay_out_view, pose_some, pose_surface, visible_vertices

Array = NDArray[np.float64]
Numbers = NDArray[np.uint32]  # of vertices and links

AT_ONCE = 16  # particles, so that a worker hears of its end between them


class Room(NamedTuple):
    """What the descent of a particle works with, laid out once for a batch.

    Nothing passes from one particle to the next: all is written anew before it is read.
    """

    transforms: Array  # (D + 1, 3, 4), the last for what nothing moves
    pulls: Array  # (V, 4) what visible vertices are drawn to: weighted sum of points, and weight
    targets: Array  # (V, 3) where the silhouette draws visible vertices to
    away: Array  # (V,) and the square of how far
    sight: View
    search: Search
    equations: Equations
    samples: Samples
    soft: Soft


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

    Raises:
        ProtocolError: That much work would take for ever.
    """
    check_work(settings, poses.shape, observation.count, len(model.vertices))
    skeleton, surface = lay_out(model)
    evidence, rules = lay_out_evidence(observation, settings), lay_out_rules(settings)
    room = lay_out_room(skeleton, surface, evidence)
    before = np.array(poses, dtype=np.float64, order="C")  # kernels are compiled for one layout
    refined, log_likelihood, residual = before.copy(), np.empty(len(poses)), np.empty(len(poses))
    for first in range(0, len(poses), AT_ONCE):
        some = slice(first, first + AT_ONCE)
        refine_some(
            refined[some],
            skeleton,
            surface,
            evidence,
            rules,
            room,
            log_likelihood[some],
            residual[some],
        )
    give_up_flown(before, refined, log_likelihood, residual)
    return Refined(refined, log_likelihood, residual)


@numba.njit(cache=True, nogil=True)
def give_up_flown(before: Array, poses: Array, log_likelihood: Array, residual: Array) -> None:
    """Put poses (N, D) that their descent took beyond all numbers back to before; they explain nothing."""
    for n in range(len(poses)):
        computed = log_likelihood[n] < np.inf and not np.isnan(residual[n])
        for j in range(poses.shape[1]):
            computed &= abs(poses[n, j]) <= LARGEST_POSE
        if not computed:
            poses[n], log_likelihood[n], residual[n] = before[n], -np.inf, np.inf


def lay_out_room(skeleton: Skeleton, surface: Surface, evidence: Evidence) -> Room:
    """Room for particles of a body that are compared with an observation."""
    dofs, vertices = len(skeleton.parents), len(surface.vertices)
    return Room(
        np.tile(np.eye(4)[:3], (dofs + 1, 1, 1)),
        np.empty((vertices, 4)),
        np.empty((vertices, 3)),
        np.empty(vertices),
        lay_out_view(vertices),
        lay_out_search(evidence.points.shape[1], vertices, surface.leaves[-1] + 1),
        lay_out_equations(dofs, len(skeleton.link_dofs)),
        lay_out_samples(),
        lay_out_soft(dofs, len(skeleton.link_dofs)),
    )


@numba.njit(cache=True, nogil=True)
def refine_some(
    poses: Array,
    skeleton: Skeleton,
    surface: Surface,
    evidence: Evidence,
    rules: Rules,
    room: Room,
    log_likelihood: Array,
    residual: Array,
) -> None:
    """Refine poses (N, D) in place, one after another."""
    for n in range(len(poses)):
        log_likelihood[n], residual[n] = refine_particle(poses[n], skeleton, surface, evidence, rules, room)


@numba.njit(cache=True, nogil=True)
def refine_particle(
    pose: Array,
    skeleton: Skeleton,
    surface: Surface,
    evidence: Evidence,
    rules: Rules,
    room: Room,
) -> tuple[float, float]:
    """Refine pose (D,) in place; gives its log likelihood and mean residual in metres."""
    metric = np.array([1.0, 1.0, rules.stretch * rules.stretch])
    damping = rules.damping + rules.damping_share * evidence.count
    if rules.keep_limits:
        clamp(skeleton, pose)
    known, visible, before = 0, room.sight.visible, pose.copy()
    for k in range(rules.icp_iterations):
        if k % rules.look_every == 0:
            visible = look(pose, skeleton, surface, room)  # 4a, 4b
        else:
            follow(pose, visible, skeleton, surface, room)
        if len(visible) == 0:
            known = 0
            break
        before[:] = pose
        known = correspond(visible, known, surface, evidence, rules, room)  # 4c
        unexplained = collect(visible, skeleton, surface, evidence, rules, room)
        stiffness = rules.rest_weight * unexplained
        descent = Descent(metric, damping, stiffness, rules.gauss_newton_iterations, rules.keep_limits)
        minimise(skeleton, pose, descent, room.equations)  # 4d
        if rules.overstep > 0.0 and k < rules.icp_iterations - 1:
            extend(skeleton, before, rules.overstep, pose)
            if rules.keep_limits:
                clamp(skeleton, pose)
    if rules.soft:
        for _ in range(rules.icp_iterations):
            grid = look_at_samples(pose, skeleton, surface, rules, room)
            step_softly(pose, grid, skeleton, evidence, rules, room.soft, room.equations)
    return assess(pose, known, skeleton, surface, evidence, rules, room)  # 5


@numba.njit(cache=True, nogil=True)
def look_at_samples(pose: Array, skeleton: Skeleton, surface: Surface, rules: Rules, room: Room) -> Grid:
    """Samples of what is seen in the pose; room.equations has the axes of motion in it."""
    chain(skeleton.kinds, skeleton.parents, skeleton.axes, skeleton.points, pose, room.transforms)
    pose_surface(surface, room.transforms, skeleton.link_dofs, room.sight.posed)
    sums = room.equations
    carry_axes(
        skeleton.parents, skeleton.axes, skeleton.points, skeleton.balls, room.transforms, sums.w, sums.q
    )
    return sample(room.sight, surface, sample_distance(rules), room.samples)


@numba.njit(cache=True, nogil=True)
def look(pose: Array, skeleton: Skeleton, surface: Surface, room: Room) -> Numbers:
    """Indices of the vertices that are seen in the pose; where they are stays in room.sight.posed."""
    chain(skeleton.kinds, skeleton.parents, skeleton.axes, skeleton.points, pose, room.transforms)
    pose_surface(surface, room.transforms, skeleton.link_dofs, room.sight.posed)
    return visible_vertices(room.sight, surface.triangles)


@numba.njit(cache=True, nogil=True)
def follow(pose: Array, visible: Numbers, skeleton: Skeleton, surface: Surface, room: Room) -> None:
    """Move the vertices that were seen last to where they are in the pose, in room.sight.posed."""
    chain(skeleton.kinds, skeleton.parents, skeleton.axes, skeleton.points, pose, room.transforms)
    pose_some(visible, surface, room.transforms, skeleton.link_dofs, room.sight.posed)


@numba.njit(cache=True, nogil=True)
def correspond(
    visible: Numbers, known: int, surface: Surface, evidence: Evidence, rules: Rules, room: Room
) -> int:
    """For each observed point its closest visible vertex, as a place in `visible`, and how far squared.

    They stay in room.search.closest and .squared. `known` is what the particle's last search gave, which is
    where this one begins; 0 for the first.
    """
    search, leaves = room.search, lay_out_leaves(visible, surface, rules, room)
    if known == 0:
        closest_points(evidence.points, evidence.blocks, evidence.tiles, leaves, search)
    else:
        if not are_same(search.known[:known], visible):
            carry_over(search.known[:known], visible, search.carried, search.closest)
        closest_again(evidence.points, evidence.tiles, leaves, search)
    search.known[: len(visible)] = visible
    return len(visible)


@numba.njit(cache=True, nogil=True)
def are_same(some: Numbers, others: Numbers) -> bool:
    """Whether these are the same vertices."""
    differences = np.uint32(0)
    for m in range(min(len(some), len(others))):
        differences |= some[m] ^ others[m]
    return len(some) == len(others) and differences == 0


@numba.njit(cache=True, nogil=True)
def lay_out_leaves(visible: Numbers, surface: Surface, rules: Rules, room: Room) -> int:
    """Fill room.search.model with the visible vertices, and .starts; gives the number of leaves."""
    model, starts, posed, leaf_of = room.search.model, room.search.starts, room.sight.posed, surface.leaves
    leaves, leaf = 0, -1
    for m in range(len(visible)):
        v = visible[m]
        model[m, 0], model[m, 1], model[m, 2] = posed[v, 0], posed[v, 1], posed[v, 2] * rules.stretch
        if leaf_of[v] != leaf:
            leaf = leaf_of[v]
            starts[leaves] = m
            leaves += 1
    starts[leaves] = len(visible)
    return leaves


@numba.njit(cache=True, nogil=True)
def carry_over(before: Numbers, visible: Numbers, carried: Numbers, closest: Numbers) -> None:
    """Turn places in `before` into those in `visible` of the same vertices, or else of the next in order."""
    place = 0
    for m in range(len(before)):
        while place < len(visible) - 1 and visible[place] < before[m]:
            place += 1
        carried[m] = place
    for i in range(len(closest)):
        closest[i] = carried[closest[i]]


@numba.njit(cache=True, nogil=True)
def collect(
    visible: Numbers, skeleton: Skeleton, surface: Surface, evidence: Evidence, rules: Rules, room: Room
) -> int:
    """Sum up all correspondences in room.equations, in the camera frame; gives how many points are far off.

    Far off is where the robust kernel more than halves a point's weight.
    """
    unexplained = add_points(len(visible), evidence, rules, room.search, room.pulls)
    if rules.free_space_weight > 0.0:
        add_silhouette(visible, skeleton, surface, evidence, rules, room)
    add_correspondences(surface, visible, room.sight.posed, room.pulls, room.equations)
    return unexplained


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_points(visible: int, evidence: Evidence, rules: Rules, search: Search, pulls: Array) -> int:
    """Fill pulls with the observed points' part; gives the number of those that are far off."""
    shrink, points, closest, weights = 1.0 / rules.stretch, evidence.points, search.closest, search.weights
    unexplained = weigh(search.squared, evidence.count, rules.outlier_squared, weights)
    pulls[:visible] = 0.0
    for i in range(evidence.count):
        weight, m = weights[i], closest[i]
        pulls[m, 0] += weight * points[0, i]
        pulls[m, 1] += weight * points[1, i]
        pulls[m, 2] += weight * points[2, i] * shrink
        pulls[m, 3] += weight
    return unexplained


@numba.njit(cache=True, nogil=True, error_model="numpy")
def weigh(squared: NDArray[np.float32], count: int, scale_squared: float, weights: Array) -> int:
    """Fill weights (count,) of points by their squared distances; gives the number that are far off."""
    unexplained = 0
    for i in range(count):
        weights[i] = robust_weight(np.float64(squared[i]), scale_squared)
        unexplained += weights[i] < 0.5
    return unexplained


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_silhouette(
    visible: Numbers, skeleton: Skeleton, surface: Surface, evidence: Evidence, rules: Rules, room: Room
) -> None:
    """Add to room.pulls what draws visible vertices to where the camera saw something."""
    pulls, targets, away = room.pulls, room.targets, room.away
    look_for_silhouette(visible, skeleton, surface, evidence, room)
    pull = rules.free_space_weight * evidence.count / len(visible)
    for m in range(len(visible)):
        if away[m] > 0.0:
            weight = pull * robust_weight(away[m], rules.outlier_squared)
            for a in range(3):
                pulls[m, a] += weight * targets[m, a]
            pulls[m, 3] += weight


@numba.njit(cache=True, nogil=True)
def assess(
    pose: Array,
    known: int,
    skeleton: Skeleton,
    surface: Surface,
    evidence: Evidence,
    rules: Rules,
    room: Room,
) -> tuple[float, float]:
    """Log likelihood of pose (D,), and mean distance of the observed points from the model in metres.

    `known` is as in `correspond`. Where iterations share a look, the likelihood shares the last.
    """
    visible = room.search.known[:known]
    if known > 0 and rules.look_every > 1 and not rules.soft:
        follow(pose, visible, skeleton, surface, room)
    else:
        visible = look(pose, skeleton, surface, room)
    if len(visible) == 0 or evidence.count == 0:
        return -np.inf, np.inf
    correspond(visible, known, surface, evidence, rules, room)
    residual, nothing = mean_distance(evidence, rules, room.search), 0.0
    if rules.free_space_weight > 0.0:
        nothing = rules.free_space_weight * outside(visible, skeleton, surface, evidence, rules, room)
    if not rules.soft:
        cost = mean_cost(evidence, rules, room.search) + nothing
        return -0.5 * cost * rules.likelihood_scale, residual
    grid = sample(room.sight, surface, sample_distance(rules), room.samples)
    log_density = mean_log_density(grid, evidence, rules, room.soft)
    return rules.independent_points * (log_density - 0.5 * nothing / rules.noise_lateral**2), residual


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def mean_cost(evidence: Evidence, rules: Rules, search: Search) -> float:
    """Mean robust cost (m^2) of the observed points, in the metric of the noise."""
    cost, squared = 0.0, search.squared
    for i in range(evidence.count):
        cost += robust_cost(np.float64(squared[i]), rules.outlier_squared)
    return cost / evidence.count


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def mean_distance(evidence: Evidence, rules: Rules, search: Search) -> float:
    """Mean distance (m) of the observed points from their model points, depth unstretched.

    Where depth is stretched a lot the difference of large numbers may come out below zero.
    """
    total, excess = 0.0, 1.0 / rules.stretch**2 - 1.0
    for i in range(evidence.count):
        along = np.float64(evidence.points[2, i]) - search.model[search.closest[i], 2]
        total += np.sqrt(max(0.0, search.squared[i] + excess * along * along))
    return total / evidence.count


@numba.njit(cache=True, nogil=True, error_model="numpy")
def outside(
    visible: Numbers, skeleton: Skeleton, surface: Surface, evidence: Evidence, rules: Rules, room: Room
) -> float:
    """Mean robust cost (m^2) of visible model points that lie where the camera saw nothing."""
    away = room.away
    look_for_silhouette(visible, skeleton, surface, evidence, room)
    cost = 0.0
    for m in range(len(visible)):
        cost += robust_cost(away[m], rules.outlier_squared)
    return cost / len(visible)


@numba.njit(cache=True, nogil=True)
def look_for_silhouette(
    visible: Numbers, skeleton: Skeleton, surface: Surface, evidence: Evidence, room: Room
) -> None:
    """Fill room.targets and room.away: where the silhouette draws visible vertices to, and how far."""
    pull_into_silhouette(
        visible,
        surface,
        skeleton.link_dofs,
        room.transforms,
        room.sight.posed,
        evidence,
        room.targets,
        room.away,
    )
