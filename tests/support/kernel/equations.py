"""The kernel's terms at a pose: their costs and equations, all of them or some."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.spatial import cKDTree

from gepf.common.arrays import Array
from gepf.common.kinematics import pose_vertices
from gepf.common.refinement import Particles, PosePrior
from gepf.coordinator.filters.priors import pose_prior
from gepf.worker.kernel import terms
from gepf.worker.kernel.correspondence import find_correspondences
from gepf.worker.kernel.icp import pack_batch
from gepf.worker.kernel.link_sums import sum_by_link
from gepf.worker.kernel.normal_equations import fill_normal_equations
from gepf.worker.kernel.observation import observe, view_of
from gepf.worker.kernel.parameters import Weights
from gepf.worker.kernel.surface import order_vertices
from gepf.worker.kernel.visibility import draw, pose_body, visible_vertices
from gepf.worker.kernel.workspace import CameraView, make_workspaces, workspace_of
from tests.support.kernel.posterior import Held, PosteriorCase, hold


@dataclass(frozen=True, slots=True, eq=False)
class KernelAt:
    """The kernel at a pose (D,) of a case, with the mean (D,) of the prior."""

    of: PosteriorCase
    pose: Array
    mean: Array
    view: CameraView

    @classmethod
    def make(cls, of: PosteriorCase, pose: Array, prior: PosePrior | None = None) -> Self:
        """Pose the body and find correspondences; the prior is that of the rest pose if no other is given."""
        prior = prior or pose_prior(of.model, of.settings)
        batch = pack_batch(of.model, observe(of.subject), Particles(pose[None], of.settings, prior=prior))
        problem = batch.problem
        skeleton, surface, views = problem.skeleton, problem.surface, problem.views
        workspace = workspace_of(make_workspaces(skeleton, surface, views), views, 0)
        pose_body(pose, skeleton, surface, workspace)
        observed, visible = view_of(views, 0), visible_vertices(surface, workspace)
        find_correspondences(visible, surface, observed, problem.parameters.stretch, workspace)
        view = CameraView(visible, observed, problem.parameters.posterior, problem, workspace)
        return cls(of, pose, batch.means[0], view)

    def only(self, *names: str) -> KernelAt:
        """The same with some of the terms."""
        view, problem = self.view, self.view.problem
        weights = {name: weight * (name in names) for name, weight in view.weights._asdict().items()}
        stiffness = problem.parameters.limit_stiffness * ("limits" in names)
        problem = problem._replace(
            parameters=problem.parameters._replace(limit_stiffness=stiffness),
            precision=problem.precision * ("prior" in names),
        )
        return replace(self, view=view._replace(weights=Weights(**weights), problem=problem))

    def cost(self) -> float:
        """Sum of the costs of the terms."""
        of_pose = terms.cost_of_pose(self.pose, self.mean, self.view.problem)
        return float(terms.cost_of_points(self.view) + of_pose)

    def linearise(self) -> tuple[Array, Array]:
        """Their Gauss-Newton matrix (D, D) and gradient (D,)."""
        workspace = self.view.workspace
        workspace.targets[:], workspace.equations.links[:] = 0.0, 0.0
        terms.linearise_points(self.view)
        sum_by_link(self.view)
        return self.fill()

    def fill(self) -> tuple[Array, Array]:
        """Those of the linearised terms."""
        workspace, problem = self.view.workspace, self.view.problem
        equations = workspace.equations
        fill_normal_equations(self.pose, self.mean, problem, workspace)
        lower = np.tril(equations.gram)
        return lower + np.tril(lower, -1).T, equations.gradient.copy()

    def held(self) -> Held:
        """What the kernel holds at this pose, for the same in numpy; of equally close points the kernel's."""
        surface, drawn, workspace = self.view.problem.surface, None, self.view.workspace
        if self.of.settings.is_soft:
            drawn = draw(surface.triangles, True, workspace), surface
        held = hold(self.of.model, self.pose, self.of.subject, self.of.settings, drawn)
        order, closest = order_vertices(self.of.model)[0], held.closest.copy()
        (observed,) = observe(self.of.subject).views
        _, of_points = cKDTree(held.points).query(observed.points[: len(closest)])
        closest[of_points] = order[self.view.visible[workspace.search.closest[: len(closest)]]]
        same = replace(held, closest=closest)
        (posed,), stretch = pose_vertices(self.of.model, self.pose[None]), self.of.settings.stretch
        away, least = ((held.points - posed[each]) * (1.0, 1.0, stretch) for each in (closest, held.closest))
        np.testing.assert_allclose(
            np.linalg.norm(away, axis=1), np.linalg.norm(least, axis=1), rtol=1e-5, atol=1e-7
        )
        return same
