"""The kernel against the plain path: stage by stage, as a whole, and the laws that sums must obey."""

from __future__ import annotations

import gc
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache

import msgspec
import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher
from numpy.typing import NDArray

from common.body import ROOT_DOFS, ROTATION, BodyModel
from common.camera import Intrinsics
from common.frame import SubjectFrame
from common.kinematics import dof_transforms, pose_vertices, retract
from common.settings import RefineSettings, preset
from coordinator.tracking.subject import isolate
from tests.support import plain_path
from tests.support.bodies import person, puppet
from tests.support.finite_differences import tangents
from worker.kernel import icp
from worker.kernel.observation import BLOCK, Observation, observe
from worker.kernel.packing import pack_observation, pack_parameters
from worker.kernel.solver.gauss_newton import SolverParameters, minimise, solve_ltl
from worker.kernel.solver.normal_equations import (
    NormalEquations,
    add_correspondences,
    make_equations,
    normal_equations,
    subtree_moments,
)
from worker.kernel.surface import order_vertices, pack_model, weights_first
from worker.kernel.visibility import update_visibility
from worker.kernel.warm_start import find_correspondences
from worker.kernel.weighting import accumulate_correspondences
from worker.kernel.workspace import Workspace, make_workspace

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Numbers = NDArray[np.uint32]

CAMERA = Intrinsics(200, 160, 200.0, 210.0, 98.7, 81.2)
TRUTH = np.array(
    [0.02, -0.03, 2.0, 0.1, 0.4, -0.1, 0.1, -0.2, 0.15, 0.3, 0.2, 0.4, -0.4, 0.5, 0.4, 0.2, -0.5, 0.03, 0.2]
)  # of the puppet
POINTS = 1500
PAPER, DEFAULT = preset("paper").refine, preset("default").refine
SETTINGS = {
    "paper": PAPER,
    "default": DEFAULT,
    "other noise along than across": msgspec.structs.replace(DEFAULT, noise_depth=0.015, noise_lateral=0.008),
    "free space, not robust": msgspec.structs.replace(PAPER, free_space_weight=0.7, noise_depth=0.004),
    "limits and rest": msgspec.structs.replace(
        PAPER, keep_limits=True, rest_weight=0.05, damping_share=0.01, outlier_distance=0.03
    ),
}


@cache
def subject(model: BodyModel | None = None) -> SubjectFrame:
    """The puppet in front of the camera, picked with padding to spare."""
    found = isolate(plain_path.render(model or puppet(), TRUTH, CAMERA), None, POINTS)
    assert found is not None
    assert len(found.picked) == POINTS
    return found


def starts(count: int) -> Array:
    """Poses (count, 19) around the truth, some of them out of limits."""
    rng = np.random.default_rng(0)
    spread = np.where(puppet().kinds == ROTATION, 0.3, 0.03)
    poses: Array = TRUTH + rng.normal(size=(count, len(TRUTH))) * spread
    return poses


def near() -> Array:
    """A pose (19,) so near the truth that all links have correspondences."""
    return TRUTH + np.where(puppet().kinds == ROTATION, 0.1, 0.01) * np.random.default_rng(1).normal(size=19)


def layout(model: BodyModel) -> Indices:
    """The model's vertex at each place of the kernel's layout."""
    return order_vertices(model)[0]


def dirty(workspace: Workspace) -> Workspace:
    """A workspace in which others were before."""
    for array in (
        workspace.weighted_targets,
        workspace.silhouette_points,
        workspace.silhouette_squared,
        *workspace.visibility,
        *workspace.search,
        *workspace.equations,
    ):
        array.fill(7)
    return workspace


def posed_in(model: BodyModel, pose: Array, settings: RefineSettings) -> tuple[Workspace, Array, Numbers]:
    """A workspace after steps 4a and 4b, its vertices (V, 3), and the visible ones."""
    skeleton, surface = pack_model(model)
    workspace = dirty(make_workspace(skeleton, surface, pack_observation(observe(subject()), settings)))
    visible = update_visibility(pose.copy(), skeleton, surface, workspace.transforms, workspace.visibility)
    return workspace, workspace.visibility.posed, visible


def correspondences(
    model: BodyModel, pose: Array, settings: RefineSettings
) -> tuple[Array, Indices, Array, Array]:
    """Vertices (V, 3) in a pose, and for each correspondence vertex (n,), target (n, 3), weight (n,)."""
    posed, visible = plain_path.visible_vertices(model, pose)
    points = plain_path.observed_points(subject())
    index, squared = plain_path.closest_points(points, posed[visible], settings)
    return posed, visible[index], points, plain_path.robust_weight(squared, settings)


def summed(model: BodyModel, factors: plain_path.Factors) -> tuple[Array, Array]:
    """Moments (L, 4, 4) and crosses (L, 4, 3) of factors."""
    x = np.column_stack([factors.points, np.ones(len(factors.points))])
    links = len(model.link_names)
    moments, crosses = np.zeros((links, 4, 4)), np.zeros((links, 4, 3))
    np.add.at(moments, factors.links, np.einsum("n,na,nb->nab", factors.weights, x, x))
    np.add.at(crosses, factors.links, np.einsum("n,na,nb->nab", factors.weights, x, factors.targets))
    return moments, crosses


def kernel_equations(
    model: BodyModel, factors: plain_path.Factors, pose: Array, metric: Array
) -> tuple[Array, Array]:
    """J^T J (D, D) and J^T r (D,) from the moments of factors, at a pose that the body has moved on to."""
    skeleton, _ = pack_model(model)
    equations = summed_up(model, factors)
    equations.reference[:], equations.moved[:] = (
        dof_transforms(model, p[None])[0] for p in (factors.pose, pose)
    )
    subtree_moments(skeleton, equations)
    normal_equations(skeleton, metric, equations)
    return equations.gram, equations.gradient


def summed_up(model: BodyModel, factors: plain_path.Factors) -> NormalEquations:
    """Buffers of equations with the sums of factors, used before."""
    equations = make_equations(len(model.dof_names), len(model.link_names))
    for array in equations:
        array.fill(7)
    equations.moments[:], equations.crosses[:] = summed(model, factors)
    return equations


def test_a_body_is_packed_whole() -> None:
    """The kernel's order keeps every vertex with its skin and every triangle with its corners."""
    model = person()
    skeleton, surface = pack_model(model)
    order = layout(model)
    drawn, expected = (body.vertices[body.triangles].reshape(-1, 9) for body in (surface, model))
    np.testing.assert_array_equal(np.unique(drawn, axis=0), np.unique(expected, axis=0))
    assert len(drawn) == len(expected)
    np.testing.assert_array_equal(surface.vertices, model.vertices[order])
    used = surface.skin_links.shape[1]  # of four: no vertex has more
    np.testing.assert_array_equal(surface.skin_links, model.skin_links[order, :used])
    np.testing.assert_array_equal(surface.skin_weights, model.skin_weights[order, :used])
    assert np.all(model.skin_weights[:, used:] == 0.0)
    assert [name for name, root in zip(model.dof_names, skeleton.root, strict=True) if root] == list(
        ROOT_DOFS
    )


def test_links_of_no_weight_come_last() -> None:
    """Wherever a vertex lists a link without weight, the others keep their order and their weights."""
    links = np.array([[4, 5, 6], [1, 2, 3], [7, 8, 9]])
    weights = np.array([[0.0, 0.4, 0.6], [1.0, 0.0, 0.0], [0.7, 0.0, 0.3]])
    found, shares = weights_first(links, weights)
    np.testing.assert_array_equal(shares, [[0.4, 0.6], [1.0, 0.0], [0.7, 0.3]])
    np.testing.assert_array_equal(found, [[5, 6], [1, 2], [7, 9]])


@pytest.mark.parametrize("make", [puppet, person])
def test_posing_and_visibility_match(make: Callable[[], BodyModel]) -> None:
    """Steps 4a and 4b: vertices to 1e-12 m, and the very same ones visible."""
    model = make()
    poses = starts(3) if make is puppet else np.tile([0.1, 0.0, 2.5, *[0.3, -0.4] * 10, 0.2], (1, 1))
    for pose in poses:
        _, posed, seen = posed_in(model, pose, DEFAULT)
        expected, visible = plain_path.visible_vertices(model, pose)
        np.testing.assert_allclose(posed, expected[layout(model)], atol=1e-12)
        assert 100 < len(visible) < 0.6 * len(expected)
        np.testing.assert_array_equal(np.sort(layout(model)[seen]), visible)


@pytest.mark.parametrize("name", SETTINGS)
def test_correspondences_match(name: str) -> None:
    """Step 4c in the noise's metric: the same model points as scipy's tree finds, distances to 1e-6 m."""
    model, settings = puppet(), SETTINGS[name]
    pose = near()
    packed, parameters = pack_observation(observe(subject()), settings), pack_parameters(settings)
    workspace, posed, visible = posed_in(model, pose, settings)
    find_correspondences(visible, 0, pack_model(model)[1], packed, parameters, workspace)
    index, squared = workspace.search.closest, workspace.search.squared
    points = packed.points[:, :POINTS].T / np.array([1.0, 1.0, parameters.stretch])
    expected, apart = plain_path.closest_points(points, posed[visible], settings)
    np.testing.assert_allclose(np.sqrt(squared[:POINTS]), np.sqrt(apart), atol=1e-6)
    assert np.mean(index[:POINTS] == expected) > 0.999


@pytest.mark.parametrize("name", SETTINGS)
def test_moments_match(name: str) -> None:
    """What the kernel collects, free space and robust weights included, is the sum over the plain factors."""
    model, settings = puppet(), SETTINGS[name]
    pose = near()
    skeleton, surface = pack_model(model)
    packed, parameters = pack_observation(observe(subject()), settings), pack_parameters(settings)
    workspace, _, visible = posed_in(model, pose, settings)
    find_correspondences(visible, 0, surface, packed, parameters, workspace)
    unexplained = accumulate_correspondences(visible, skeleton, surface, packed, parameters, workspace)
    found = workspace.equations.moments, workspace.equations.crosses
    factors = plain_path.weigh_correspondences(
        model, pose, *plain_path.visible_vertices(model, pose), subject(), settings
    )
    assert len(factors.weights) > POINTS
    assert unexplained == factors.unexplained
    for total, expected in zip(found, summed(model, factors), strict=True):
        np.testing.assert_allclose(total, expected, rtol=1e-5, atol=1e-4)


def test_single_factors_sum_to_the_total() -> None:
    """Adding correspondences one by one gives what is collected at once."""
    model = puppet()
    posed, vertices, targets, weights = correspondences(model, near(), DEFAULT)
    _, surface = pack_model(model)
    place = np.argsort(layout(model)).astype(np.uint32)
    links = len(model.link_names)
    moments, crosses = np.zeros((links, 4, 4)), np.zeros((links, 4, 3))
    equations = make_equations(len(model.dof_names), links)
    for v, target, weight in zip(vertices, targets, weights, strict=True):
        weighted_targets = np.append(weight * target, weight)[None]
        add_correspondences(surface, place[v : v + 1], posed[layout(model)], weighted_targets, equations)
        one, cross = equations.moments, equations.crosses
        assert one[:, 3, 3].sum() == pytest.approx(weight)
        moments += one
        crosses += cross
    factors = plain_path.split_by_link(model, near(), posed, vertices, targets, weights)
    for total, expected in zip((moments, crosses), summed(model, factors), strict=True):
        np.testing.assert_allclose(total, expected, rtol=1e-10, atol=1e-10)
    assert np.count_nonzero(moments[:, 3, 3]) == links


@pytest.mark.parametrize("blended", [True, False])
@pytest.mark.parametrize("moved", [0.0, 0.2])
@pytest.mark.parametrize("along", [1.0, 0.25])
def test_normal_equations_match(blended: bool, moved: float, along: float) -> None:
    """From moments come the J^T J and J^T r that the whole Jacobian gives, in any metric, after moves too."""
    model = puppet(blended)
    start = near()
    settings = msgspec.structs.replace(PAPER, noise_depth=PAPER.noise_lateral / along)
    factors = plain_path.split_by_link(model, start, *correspondences(model, start, settings))
    pose = retract(model, start[None], np.full((1, len(start)), moved))[0]
    gram, gradient = kernel_equations(model, factors, pose, np.array([1.0, 1.0, along**2]))
    expected_gram, expected = plain_path.equations(model, factors, pose, settings)
    np.testing.assert_allclose(gram, expected_gram, rtol=1e-9, atol=1e-7)
    np.testing.assert_allclose(gradient, expected, rtol=1e-9, atol=1e-7)


@pytest.mark.parametrize("moved", [0.0, 0.2])
def test_the_gradient_is_that_of_the_cost(moved: float) -> None:
    """J^T r is the slope of half of Eq. 3's sum of squares, for every degree of freedom."""
    model = puppet(blended=False)
    start = near()
    _, vertices, targets, weights = correspondences(model, start, DEFAULT)
    factors = plain_path.split_by_link(
        model, start, pose_vertices(model, start[None])[0], vertices, targets, weights
    )
    pose = retract(model, start[None], np.full((1, len(start)), moved))[0]

    def cost(at: Array) -> Array:
        apart = pose_vertices(model, at[None])[0, vertices] - targets
        return np.asarray(0.5 * np.sum(weights[:, None] * apart**2))

    _, gradient = kernel_equations(model, factors, pose, np.ones(3))
    assert np.abs(gradient).min() > 1e-3
    np.testing.assert_allclose(gradient, tangents(model, pose, cost), rtol=1e-5, atol=1e-5)


def test_shared_skin_leaves_the_gradient_exact_and_steps_safe() -> None:
    """Of vertices that several links carry on: J^T r is exact at the pose of the search, J^T J no smaller."""
    model = puppet()
    start = near()
    posed, vertices, targets, weights = correspondences(model, start, DEFAULT)
    factors = plain_path.split_by_link(model, start, posed, vertices, targets, weights)
    rows = np.repeat(np.arange(len(vertices)), np.count_nonzero(model.skin_weights[vertices], axis=1))
    shares = factors.weights / weights[rows]
    assert np.mean(shares < 0.9) > 0.05

    def blend(at: Array) -> Array:
        mixed = np.zeros((len(vertices), 3))
        np.add.at(mixed, rows, shares[:, None] * plain_path.move_with_links(model, factors, at))
        return mixed

    def cost(at: Array) -> Array:
        return np.asarray(0.5 * np.sum(weights[:, None] * (blend(at) - targets) ** 2))

    gram, gradient = kernel_equations(model, factors, start, np.ones(3))
    np.testing.assert_allclose(gradient, tangents(model, start, cost), rtol=1e-5, atol=1e-5)
    matrix = tangents(model, start, blend)
    exact = np.einsum("n,nij,nik->jk", weights, matrix, matrix)
    assert np.linalg.eigvalsh(gram - exact).min() > -1e-4
    assert np.abs(gram - exact).max() < 0.1 * np.abs(exact).max()


def test_the_gram_matrix_is_exact_where_a_vertex_has_one_link() -> None:
    """J^T J is the product of the Jacobian of pose_vertices, taken by finite differences, with itself."""
    model = puppet(blended=False)
    start = near()
    posed, vertices, targets, weights = correspondences(model, start, DEFAULT)
    gram, _ = kernel_equations(
        model, plain_path.split_by_link(model, start, posed, vertices, targets, weights), start, np.ones(3)
    )
    matrix = tangents(model, start, lambda at: pose_vertices(model, at[None])[0, vertices])
    exact = np.einsum("n,nij,nik->jk", weights, matrix, matrix)
    np.testing.assert_allclose(gram, exact, rtol=1e-6, atol=1e-4)


@pytest.mark.parametrize("name", SETTINGS)
def test_minimising_matches(name: str) -> None:
    """Step 4d on the same factors: damping, rest and limits included, the same pose to 1e-7."""
    model, settings = puppet(), SETTINGS[name]
    skeleton, _ = pack_model(model)
    for start in starts(2):
        start = plain_path.clamp_to_limits(model, start) if settings.keep_limits else start  # noqa: PLW2901
        factors = plain_path.weigh_correspondences(
            model, start, *plain_path.visible_vertices(model, start), subject(), settings
        )
        pose = start.copy()
        along = settings.noise_lateral / settings.noise_depth
        solver = SolverParameters(
            np.array([1.0, 1.0, along**2]),
            settings.damping + settings.damping_share * POINTS,
            settings.rest_weight * factors.unexplained,
            settings.gauss_newton_iterations,
            settings.keep_limits,
        )
        minimise(skeleton, pose, solver, summed_up(model, factors))
        assert np.abs(pose - start).max() > 0.05
        assert settings.rest_weight == 0.0 or factors.unexplained > 10
        np.testing.assert_allclose(pose, plain_path.minimise(model, factors, POINTS, settings), atol=1e-7)


def test_what_nothing_determines_stays() -> None:
    """Without damping: steps of a singular system are finite, solve it, and leave the undetermined alone."""
    jacobian = np.random.default_rng(0).normal(size=(3, 5)) * [1.0, 1.0, 0.0, 1.0, 1.0]
    gram, target = jacobian.T @ jacobian, jacobian.T @ np.array([0.3, -0.2, 0.1])
    step = target.copy()
    solve_ltl(np.arange(-1, 4), gram.copy(), step)
    assert step[2] == 0.0
    assert np.abs(step).max() < 100.0
    np.testing.assert_allclose(gram @ step, target, atol=1e-9)


@pytest.mark.parametrize("name", SETTINGS)
def test_refinement_matches(name: str) -> None:
    """The whole descent and its likelihood match to 1e-6, as a rule.

    Where two model points are equally close, single against double precision may choose another one, which
    moves a pose by a thousandth at the most.
    """
    model, settings = puppet(), SETTINGS[name]
    poses = starts(3)
    found = icp.refine(model, observe(subject()), poses, settings)
    expected = [plain_path.refine(model, subject(), pose, settings) for pose in poses]
    off = np.abs(found.poses - np.array([pose for pose, _, _ in expected])).max(axis=1)
    assert np.median(off) < 1e-6
    assert off.max() < 1e-3
    matching = off < 1e-6
    log_likelihood, residual = np.array([rest for _, *rest in expected]).T
    np.testing.assert_allclose(found.log_likelihood[matching], log_likelihood[matching], rtol=1e-5)
    np.testing.assert_allclose(found.residual[matching], residual[matching], rtol=1e-5)
    assert np.abs(found.poses - poses).max() > 0.1


def test_a_batch_is_its_particles_one_by_one() -> None:
    """Poses, likelihoods and residuals have the same bytes in any batch, in any order."""
    model, observation, poses = puppet(), observe(subject()), starts(5)
    together = icp.refine(model, observation, poses, DEFAULT)
    backward = icp.refine(model, observation, np.asfortranarray(poses[::-1]), DEFAULT)
    for n in range(len(poses)):
        alone = icp.refine(model, observation, poses[n : n + 1], DEFAULT)
        for field in ("poses", "log_likelihood", "residual"):
            mine = getattr(alone, field)[0].tobytes()
            assert getattr(together, field)[n].tobytes() == mine
            assert getattr(backward, field)[len(poses) - 1 - n].tobytes() == mine
    assert len(np.unique(together.log_likelihood)) == len(poses)


def test_what_was_refined_before_leaves_nothing_behind() -> None:
    """After other frames, settings and bodies, and in threads side by side, results have the same bytes."""
    asked = [
        (model, observation, starts(2), settings)
        for model in (puppet(), replace(puppet(), vertices=1.1 * puppet().vertices))
        for observation in (observe(subject()), observe_few())
        for settings in (DEFAULT, PAPER)
    ]

    def refine(which: int) -> bytes:
        found = icp.refine(*asked[which])
        return found.poses.tobytes() + found.log_likelihood.tobytes() + found.residual.tobytes()

    alone = [refine(which) for which in range(len(asked))]
    assert len(set(alone)) == len(alone)
    order = np.random.default_rng(0).integers(len(asked), size=40)
    with ThreadPoolExecutor(3) as threads:
        assert list(threads.map(refine, order)) == [alone[which] for which in order]


def test_without_iterations_poses_are_only_evaluated() -> None:
    """No ICP iteration: poses stay, within their limits, and are as likely as after a descent to them.

    That is, after one that looks anew what is visible wherever it comes.
    """
    model, observation = puppet(), observe(subject())
    looking = msgspec.structs.replace(DEFAULT, visibility_interval=1)
    refined = icp.refine(model, observation, starts(3), looking)
    assess = msgspec.structs.replace(looking, icp_iterations=0)
    assessed = icp.refine(model, observation, refined.poses, assess)
    np.testing.assert_array_equal(assessed.poses, refined.poses)
    np.testing.assert_array_equal(assessed.log_likelihood, refined.log_likelihood)
    np.testing.assert_array_equal(assessed.residual, refined.residual)


def test_what_is_asked_for_is_not_changed() -> None:
    """The poses of a request stay as they were, and need not be writable."""
    poses = starts(2)
    poses.setflags(write=False)
    refined = icp.refine(puppet(), observe(subject()), poses, DEFAULT)
    assert refined.poses.flags.writeable
    np.testing.assert_array_equal(poses, starts(2))


def test_padding_does_not_count() -> None:
    """Whatever stands in the observation beyond its count leaves every result as it is."""
    observation = observe(subject())
    assert len(observation.points) % BLOCK == 0
    assert observation.count == POINTS < len(observation.points)
    points = observation.points.copy()
    points[POINTS:] = points[:1] + np.float32(0.5)
    for settings in (PAPER, DEFAULT):
        one = icp.refine(puppet(), observation, starts(2), settings)
        other = icp.refine(puppet(), replace(observation, points=points), starts(2), settings)
        np.testing.assert_allclose(other.poses, one.poses, atol=1e-9)
        np.testing.assert_allclose(other.log_likelihood, one.log_likelihood, rtol=1e-9)
        np.testing.assert_allclose(other.residual, one.residual, rtol=1e-9)


def test_a_body_that_is_nowhere_in_sight_is_impossible() -> None:
    """Behind the camera nothing is visible: the pose stays, its likelihood is zero, its residual infinite."""
    behind = TRUTH.copy()
    behind[2] = -3.0
    model = puppet()
    model = replace(
        model, vertices=model.vertices - (model.skin_links[:, :1] == 0) * np.array([0.0, 0.0, 9.0])
    )
    found = icp.refine(model, observe(subject()), behind[None], PAPER)
    np.testing.assert_array_equal(found.poses[0], behind)
    assert found.log_likelihood[0] == -np.inf
    assert found.residual[0] == np.inf


def observe_few() -> Observation:
    """Another frame: fewer points and pixels."""
    found = isolate(plain_path.render(puppet(), TRUTH, Intrinsics(90, 80, 80.0, 80.0, 45.0, 40.0)), None, 70)
    assert found is not None
    return observe(found)


def test_nothing_compiles_in_mid_run() -> None:
    """After the first particle no kernel is compiled for other bodies, frames, batches or settings."""
    icp.refine(puppet(), observe(subject()), starts(1), PAPER)
    kernels = [
        k for k in gc.get_objects()
        if isinstance(k, Dispatcher) and k.py_func.__module__.partition(".")[0] in {"worker", "common"}
    ]  # fmt: skip
    before = {k.py_func.__qualname__: len(k.signatures) for k in kernels}
    assert len(before) > 20
    pose = np.zeros((2, len(person().dof_names)))
    pose[:, 2] = 2.0
    for settings in SETTINGS.values():
        icp.refine(person(), observe_few(), pose, settings)
    retract(person(), pose, pose)
    assert {k.py_func.__qualname__: len(k.signatures) for k in kernels} == before
    assert len(icp.refine_batch.signatures) == 1
