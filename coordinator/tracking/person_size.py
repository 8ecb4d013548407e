"""The size of a tracked person: stature from head to soles in `tracked` frames, girth at each new stature.

If the first frame does not show head and soles, as of a person who sits, the first stature is that with which
the surface of the body is nearest to the points.

One camera hardly determines the girth, so it stays as detected, with the detected stature. Cameras on several
sides determine it sharply. At a wrong girth they contradict each other.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from scipy.spatial import cKDTree

from common.arrays import Array
from common.body import BodyModel, vertex_normals
from common.frame import SubjectFrame
from common.kinematics import joint_positions, pose_vertices
from common.refinement import Particles, Refined
from common.settings import RefineSettings
from coordinator.bodies.tracked import Bodies, Size
from coordinator.filters.belief import Belief
from coordinator.tracking.candidate_refinement import FEW_POINTS, ITERATIONS
from coordinator.tracking.estimate import MAX_HYPOTHESES
from coordinator.tracking.gating import RESIDUAL_M
from coordinator.tracking.observation import observed_points
from coordinator.tracking.refiner import Refiner, iterations
from coordinator.tracking.reporting import status_of
from coordinator.tracking.state import Start
from coordinator.tracking.stature import INTERVAL_S, StatureEstimate, head_to_ankle, measure_stature
from coordinator.tracking.track_management import TrackManagement

FIT_STEPS = np.array([0.94, 1.0, 1.06])  # factors of the detected stature, which is off by 3 to 11 %
GIRTH_STEPS = np.array([0.85, 1.0, 1.15])  # factors; a parabola through their likelihoods is off by 1 %


class PersonSize:
    """Estimates the size of a person from the detection on, if it is to be measured and is not known."""

    def __init__(
        self, bodies: Bodies, refiner: Refiner, estimate: StatureEstimate | None = None, *, measured: bool
    ) -> None:
        self._bodies, self._refiner = bodies, refiner
        self._measured = measured and bodies.people and not bodies.measures
        self.estimate = estimate  # None if the size is not estimated

    def begin(self, start: Start, belief: Belief, subject: SubjectFrame, rules: RefineSettings) -> Start:
        """Begin to estimate: the start with the stature of the first frame, from head to soles or fitted."""
        if not (self._measured and start.is_free):
            return start
        self.estimate = StatureEstimate()
        stature = self._shown(start, start.pose, subject) or self._fit_stature(start, belief, subject, rules)
        return self._fit_girth(start, stature, belief, subject, rules)

    def revise(
        self, start: Start, belief: Belief | None, subject: SubjectFrame | None, rules: RefineSettings
    ) -> Start:
        """The start with the size that is known by now."""
        if self.estimate is None or belief is None:
            return start
        return self._fit_girth(start, self.estimate.revise(start.size.stature), belief, subject, rules)

    def measure(
        self, start: Start, belief: Belief, management: TrackManagement, subject: SubjectFrame
    ) -> None:
        """Measure the stature in a frame, if one is due and the pose is settled."""
        time_s, poses, weights = subject.frame.time_s, belief.poses[:MAX_HYPOTHESES], belief.weights
        if self.estimate is None or 0.0 <= time_s - self.estimate.time_s < INTERVAL_S:
            return
        joints = joint_positions(start.model, poses)
        if status_of(management, weights[:MAX_HYPOTHESES], joints, joints[0], doubted=False) == "tracked":
            stature = self._shown(start, poses[0], subject)
            if stature is not None:
                self.estimate = self.estimate.add(stature, time_s)

    def _fit_girth(
        self,
        start: Start,
        stature: float,
        belief: Belief,
        subject: SubjectFrame | None,
        rules: RefineSettings,
    ) -> Start:
        """The start with another stature, and the likeliest girth if several cameras show the person."""
        size = start.size._replace(stature=stature)
        if stature == start.size.stature or subject is None or len(subject.views) == 1:
            return start.with_size(size, self._bodies)
        sizes = [size._replace(girth=girth) for girth in size.girth * GIRTH_STEPS]
        particles = Particles(belief.reported[None], iterations(rules, ITERATIONS), velocity=belief.velocity)
        refined = self._refine(start, sizes, subject, particles)
        step = best_step(GIRTH_STEPS, np.array([each.log_likelihood[0] for _, each in refined]))
        return start.with_size(size._replace(girth=float(size.girth * step)), self._bodies)

    def _fit_stature(
        self, start: Start, belief: Belief, subject: SubjectFrame, rules: RefineSettings
    ) -> float:
        """The stature (m) with which the surface of the body is nearest to the points of the first frame.

        There is no prior of the pose: it would prefer the stature with which the body is straightest.
        """
        sizes = [start.size._replace(stature=each) for each in start.size.stature * FIT_STEPS]
        settings = msgspec.structs.replace(iterations(rules, ITERATIONS), pose_deviation=0.0)
        refined = self._refine(start, sizes, subject, Particles(belief.reported[None], settings))
        points = observed_points(subject, FEW_POINTS)
        costs = np.array([surface_cost(model, each.poses[0], points) for model, each in refined])
        visible = np.isfinite([each.log_likelihood[0] for _, each in refined])
        return float(start.size.stature * best_step(FIT_STEPS, np.where(visible, -costs, -np.inf)))

    def _refine(
        self, start: Start, sizes: Sequence[Size], subject: SubjectFrame, particles: Particles
    ) -> list[tuple[BodyModel, Refined]]:
        """Bodies of these sizes, and the particles refined with each."""
        models = [self._bodies.tracked(size, start.values)[0] for size in sizes]
        sent = [self._refiner.submit(subject, model, particles) for model in models]
        return [(model, pending.result()) for model, pending in zip(models, sent, strict=True)]

    def _shown(self, start: Start, pose: Array, subject: SubjectFrame) -> float | None:
        """Stature in metres that a frame shows of the person in pose (D,); None if it does not show it."""
        straight = head_to_ankle(self._bodies.full(*start.size))
        return measure_stature(start.model, pose, straight, subject)


def best_step(steps: Array, values: Array) -> float:
    """The step at which the parabola through the values of three steps is largest, within their range."""
    if not np.isfinite(values).all():  # nothing is visible
        return float(steps[1])
    between = np.linspace(steps[0], steps[-1], 31)
    return float(between[np.polyval(np.polyfit(steps, values, 2), between).argmax()])


def surface_cost(model: BodyModel, pose: Array, points: Array) -> float:
    """Mean squared distance (m^2) of points (P, 3) from the surface of a body in pose (D,), truncated.

    Distances are measured from the tangent plane at the nearest vertex. Distances from the vertex itself
    would prefer small bodies, because their vertices are closer to each other.
    """
    vertices = pose_vertices(model, pose[None])[0]
    nearest = cKDTree(vertices).query(points)[1]
    normals = vertex_normals(vertices, model.triangles)[nearest]
    squares = np.sum((points - vertices[nearest]) * normals, axis=1) ** 2
    return float(np.minimum(squares, RESIDUAL_M**2).mean())
