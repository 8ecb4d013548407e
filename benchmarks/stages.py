"""What each stage of a particle's descent costs."""

from __future__ import annotations

import time
from collections import Counter

import numpy as np

from benchmarks.standing import Case
from common.kinematics import chain
from common.settings import RefineSettings
from worker.kernel.evidence import lay_out_evidence, lay_out_rules
from worker.kernel.gauss_newton import Descent, clamp, extend, minimise
from worker.kernel.icp import assess, collect, correspond, follow, lay_out_room
from worker.kernel.surface import lay_out
from worker.kernel.visibility import pose_surface, visible_vertices

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
    skeleton, surface = lay_out(case.model)
    evidence, rules = lay_out_evidence(case.observation, settings), lay_out_rules(settings)
    room = lay_out_room(skeleton, surface, evidence)
    pose, clock = case.start[0].copy(), Clock()
    metric = np.array([1.0, 1.0, rules.stretch**2])
    damping = rules.damping + rules.damping_share * evidence.count
    if rules.keep_limits:
        clamp(skeleton, pose)
    known, visible, before = 0, room.sight.visible, pose.copy()
    for k in range(rules.icp_iterations):
        clock.lap("")
        if k % rules.look_every == 0:
            chain(skeleton.kinds, skeleton.parents, skeleton.axes, skeleton.points, pose, room.transforms)
            pose_surface(surface, room.transforms, skeleton.link_dofs, room.sight.posed)
            clock.lap("pose")
            visible = visible_vertices(room.sight, surface.triangles)
            clock.lap("visibility")
        else:
            follow(pose, visible, skeleton, surface, room)
            clock.lap("pose")
        before[:] = pose
        known = correspond(visible, known, surface, evidence, rules, room)
        clock.lap("closest points")
        unexplained = collect(visible, skeleton, surface, evidence, rules, room)
        clock.lap("moments")
        stiffness = rules.rest_weight * unexplained
        descent = Descent(metric, damping, stiffness, rules.gauss_newton_iterations, rules.keep_limits)
        minimise(skeleton, pose, descent, room.equations)
        if rules.overstep > 0.0 and k < rules.icp_iterations - 1:
            extend(skeleton, before, rules.overstep, pose)
            if rules.keep_limits:
                clamp(skeleton, pose)
        clock.lap("solve")
    assess(pose, known, skeleton, surface, evidence, rules, room)
    clock.lap("likelihood")
    return clock.spent
