"""What each stage of a particle's descent costs."""

from __future__ import annotations

import time
from collections import Counter

import numpy as np

from benchmarks.costs.standing import Case
from common.kinematics.chain import forward_kinematics
from common.kinematics.manifold import clamp_to_limits
from common.settings import RefineSettings
from worker.kernel.correspondence import find_correspondences
from worker.kernel.gauss_newton import minimise, over_relax
from worker.kernel.icp import solver_parameters
from worker.kernel.likelihood import evaluate
from worker.kernel.observation import pack_observation
from worker.kernel.parameters import pack_parameters
from worker.kernel.surface import pack_model
from worker.kernel.visibility import pose_surface, repose_visible, visible_vertices
from worker.kernel.weighting import accumulate_correspondences
from worker.kernel.workspace import make_workspace

STAGES = ("pose", "visibility", "closest points", "moments", "solve", "likelihood")


class Clock:
    """Processor time, in milliseconds, from one lap to the next."""

    def __init__(self) -> None:
        self.spent: Counter[str] = Counter()
        self._since = time.process_time()

    def lap(self, stage: str) -> None:
        """Add the time since the last lap to a stage."""
        self.spent[stage] += 1e3 * (time.process_time() - self._since)  # type: ignore[assignment]
        self._since = time.process_time()


def stage_times(case: Case, settings: RefineSettings, rounds: int) -> dict[str, float]:
    """Median milliseconds of each stage, all ICP iterations together, as `refine_particle` takes them."""
    every = [descend(case, settings) for _ in range(1 + rounds)][1:]
    return {stage: float(np.median([spent[stage] for spent in every])) for stage in STAGES}


def descend(case: Case, settings: RefineSettings) -> Counter[str]:
    """One descent, stage by stage."""
    skeleton, surface = pack_model(case.model)
    packed, parameters = pack_observation(case.observation, settings), pack_parameters(settings)
    workspace = make_workspace(skeleton, surface, packed)
    pose, clock = case.start[0].copy(), Clock()
    solver = solver_parameters(parameters, packed.count)
    clamp_to_limits(skeleton.single, skeleton.limits, pose)
    last_count, visible, before = 0, workspace.visibility.visible, pose.copy()
    for k in range(parameters.icp_iterations):
        clock.lap("")
        if k % parameters.visibility_interval == 0:
            forward_kinematics(
                skeleton.kinds, skeleton.parents, skeleton.axes, skeleton.points, pose, workspace.transforms
            )
            pose_surface(surface, workspace.transforms, skeleton.link_dofs, workspace.visibility.posed)
            clock.lap("pose")
            visible = visible_vertices(workspace.visibility, surface.triangles)
            clock.lap("visibility")
        else:
            repose_visible(pose, visible, skeleton, surface, workspace.transforms, workspace.visibility)
            clock.lap("pose")
        before[:] = pose
        last_count = find_correspondences(visible, last_count, surface, packed, workspace)
        clock.lap("closest points")
        accumulate_correspondences(visible, skeleton, surface, packed, parameters, workspace)
        clock.lap("moments")
        minimise(skeleton, pose, workspace.transforms, solver, workspace.equations)
        if parameters.over_relaxation > 0.0 and k < parameters.icp_iterations - 1:
            over_relax(skeleton, before, parameters.over_relaxation, pose)
            clamp_to_limits(skeleton.single, skeleton.limits, pose)
        clock.lap("solve")
    evaluate(pose, last_count, skeleton, surface, packed, parameters, workspace)
    clock.lap("likelihood")
    return clock.spent
