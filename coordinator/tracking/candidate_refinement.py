"""The stages of a search for a body: refinement of candidates, first on few points, then on all.

A search is a generator. It yields the requests of each stage once they are sent, and waits for their results
when it is resumed. So a caller can do other work meanwhile. A search that is dropped cancels its requests.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np

from gepf.common.arrays import Array, Mask
from gepf.common.body import BodyModel
from gepf.common.frame import SubjectFrame, SubjectView
from gepf.common.kinematics import joint_positions
from gepf.common.refinement import Particles
from gepf.common.settings import RefineSettings
from gepf.coordinator.bodies.family import Bodies, BodyFamily
from gepf.coordinator.bodies.tracked import coarsen
from gepf.coordinator.filters.exploration import layout_of
from gepf.coordinator.filters.priors import pose_prior
from gepf.coordinator.settings import SearchSettings, Settings
from gepf.coordinator.tracking.judgement import Gate, gate_pose
from gepf.coordinator.tracking.observation import camera_points, in_view, thin, unseen_dofs
from gepf.coordinator.tracking.pose_candidates import PoseCandidates, candidates_of, ordered
from gepf.coordinator.tracking.pose_library import rotation_to_optical_axis
from gepf.coordinator.tracking.refiner import Refiner, Request, Requests, with_closest_points, with_iterations
from gepf.coordinator.tracking.state import Start
from gepf.coordinator.tracking.truncation import TOP, truncated_sides


class Effort(NamedTuple):
    """How much a stage on few points refines, and how much it keeps."""

    iterations: int
    kept: int  # number of distinct candidates that it leaves


T = TypeVar("T")
Search = Generator[Requests, None, T]
"""A search, or some stages of it: yields the requests of each stage, and returns the result."""


class Shape(NamedTuple):
    """The shape of a tracked body."""

    coefficients: Array  # (S,)
    precision: Array  # (S, S)


@dataclass(frozen=True, eq=False)
class Query:
    """The frame in which a body is searched for, how it is refined there, and which shapes it may have."""

    subject: SubjectFrame
    settings: RefineSettings
    family: BodyFamily
    shapes: Array  # (K, S) shape coefficients with which the body is compared with the frame
    limits: SearchSettings
    roll: float | None = None  # rotation of the image that makes the body upright; None without an axis
    precision: Array | None = None  # (S, S) of the shape, if the body is known

    @cached_property
    def truncated(self) -> Mask:
        """Sides at which the largest view truncates the body; all false if any other view shows it whole."""
        if self.roll is None:
            return np.zeros(4, dtype=np.bool_)
        straight = [rotation_to_optical_axis(mean_point(view), self.roll) for view in self.subject.views]
        pairs = zip(self.subject.views, straight, strict=True)
        sides_of_views = [truncated_sides(view, turn, self.limits) for view, turn in pairs]
        return sides_of_views[0] & all(sides.any() for sides in sides_of_views)

    @cached_property
    def thinned_subject(self) -> SubjectFrame:
        """The frame with few points."""
        return thin(self.subject, self.limits.points)


class CandidateStages:
    """Refines candidates: poses of the body that is searched for, with its shape.

    `cell_m` is the cell size of the coarse surface used in the stages on few points.
    """

    def __init__(self, bodies: Bodies, refiner: Refiner, cell_m: float, settings: Settings) -> None:
        self._bodies, self._refiner, self._cell_m = bodies, refiner, cell_m
        self._settings, self._search_settings = settings, settings.search
        self._vertices = settings.filter.exploration.vertices
        self.rough = Effort(self._search_settings.rough_iterations, self._search_settings.rough_kept)
        self.fine = Effort(self._search_settings.iterations, self._search_settings.kept)
        self._mixed = Effort(self._search_settings.rough_iterations, self._search_settings.kept)

    @cached_property
    def coarse(self) -> BodyModel:
        """The body of candidates in the stages on few points."""
        return coarsen(self._bodies.searched, self._cell_m)

    def shortlist(self, query: Query, groups: Iterable[Array]) -> Search[PoseCandidates]:
        """The best distinct candidates after all stages on few points."""
        proposed = yield from self.on_few_points(query, groups, self.rough)
        best = yield from self.on_few_points(query, [proposed.poses], self.fine)
        best = yield from self.on_few_points(query, [best.poses, self._recombined(best)], self._mixed)
        if query.truncated.any():
            completed = self._completed(query, best)
            proposed = yield from self.on_few_points(query, [best.poses, completed], self.rough)
            best = yield from self.on_few_points(query, [proposed.poses], self.fine)
        return best

    def on_few_points(self, query: Query, groups: Iterable[Array], effort: Effort) -> Search[PoseCandidates]:
        """The best distinct candidates after one stage on few points, with a coarse surface."""
        model = self.coarse
        coarse_settings = with_iterations(with_closest_points(query.settings), effort.iterations)
        refined = yield from self._refine(
            query.thinned_subject, model, groups, coarse_settings, query.precision
        )
        if not query.truncated.any() or not len(refined.poses):
            return refined.distinct(model, effort.kept, self._search_settings.distinct_m)
        seen = in_view(query.subject, refined.joints)
        if not query.truncated[TOP] and (tops := seen[:, top_joint(query.family, model)]).any():
            refined, seen = refined.take(np.flatnonzero(tops)), seen[tops]
        return refined.distinct(model, effort.kept, self._search_settings.distinct_m, seen)

    def _recombined(self, best: PoseCandidates) -> Array:
        """The best candidates (N, D), each with one limb of another candidate.

        Limbs fit or fail independently of each other, so the correct limbs may be spread over several
        candidates.
        """
        limbs = [limb.dofs for limb in layout_of(self.coarse, self._vertices).limbs]
        poses = list[Array]()
        for pose in best.poses[: self._search_settings.recombined]:
            for other in best.poses:
                for limb in limbs:
                    mixed = pose.copy()
                    mixed[limb] = other[limb]
                    if np.any(mixed != pose):
                        poses.append(mixed)
        return np.array(poses).reshape(-1, best.poses.shape[1])

    def _completed(self, query: Query, best: PoseCandidates) -> Array:
        """Each candidate (N, D) with each shape, once in its pose and once with the unseen limbs at rest.

        The upper end of each body stays in place. A visible part fits a range of sizes
        and gives no information about the other limbs.
        """
        model, poses = self.coarse, list[Array]()
        for pose, joints in zip(best.poses, best.joints, strict=True):
            unseen = unseen_dofs(model, in_view(query.subject, joints)) & model.moves
            unseen[model.root] = False
            at_rest = np.where(unseen, 0.0, pose)
            for shape in query.shapes:
                for limbs in (pose, at_rest):
                    poses.append(with_top_at(query.family, model, with_shape_of(limbs, shape), joints))
        return np.array(poses)

    def fit_shape(self, query: Query, candidates: PoseCandidates) -> Search[PoseCandidates]:
        """Refine the candidates on all points and the whole surface, which shows proportions and girth.

        The best candidate is also tried with other proportions.
        """
        best, count = candidates.poses[0], query.shapes.shape[1]
        tried = candidates.poses
        if count:
            sizes = query.family.alternatives(query.family.size_of(best[:count]))
            variants = [with_shape_of(best, self._bodies.shape_of(size)) for size in sizes]
            tried = np.concatenate([tried, *(pose[None] for pose in variants)])
        settings = with_iterations(query.settings, self._search_settings.iterations)
        return (yield from self._refine(query.subject, self._bodies.searched, [tried], settings))

    def as_tracked(
        self,
        subject: SubjectFrame,
        start: Start,
        poses: Array,
        settings: RefineSettings,
        shape: Shape | None = None,
    ) -> Search[tuple[PoseCandidates, Gate]]:
        """Convert poses (N, D) of the detected body to the tracked body and refine them.

        Degrees of freedom that are held keep the values of the start. The shape, too, is that of the start
        unless `shape` is given. Also returns the gate of the best candidate.
        """
        searched, model = self._bodies.searched, start.model
        taken = np.tile(start.pose, (len(poses), 1))
        for j, name in enumerate(model.dof_names):
            if name in searched.dof_names:
                taken[:, j] = poses[:, searched.dof(name)]
        if shape is not None:
            taken[:, : model.shape_count] = shape.coefficients
        last_settings = with_iterations(settings, self._search_settings.iterations // 2)
        groups = taken[::2], taken[1::2]  # two requests for two workers
        precision = None if shape is None else shape.precision
        refined = yield from self._refine(subject, model, groups, last_settings, precision)
        depth_log_likelihood = refined.depth_log_likelihood(model, subject)[0]
        return refined, gate_pose(depth_log_likelihood, refined.residual[0], settings, self._settings.gating)

    def _refine(
        self,
        subject: SubjectFrame,
        model: BodyModel,
        groups: Iterable[Array],
        settings: RefineSettings,
        precision: Array | None = None,
    ) -> Search[PoseCandidates]:
        """Refine poses of a body, in requests of limited duration.

        Each group (N, D) is sent as soon as it is known. `precision` (S, S) is that of the shape, if it is
        known.
        """
        poses_per_request = max(1, self._search_settings.request_iterations // (settings.icp_iterations + 1))
        sent = list[Request]()
        for poses in groups:
            for first in range(0, len(poses), poses_per_request):
                part = poses[first : first + poses_per_request]
                prior = pose_prior(model, settings, part, precision)
                particles = Particles(part, settings, spare=True, prior=prior)
                sent.append(self._refiner.submit(subject, model, particles))
        try:
            yield tuple(sent)
            refined, knows_shape = [request.result() for request in sent], precision is not None
            return ordered(
                [candidates_of(model, part, subject, settings, knows_shape=knows_shape) for part in refined]
            )
        finally:
            for request in sent:
                request.cancel()


def with_shape_of(pose: Array, shape: Array) -> Array:
    """A pose (D,) with other shape coefficients (S,)."""
    return np.concatenate([shape, pose[len(shape) :]])


def top_joint(family: BodyFamily, model: BodyModel) -> int:
    """The index of the joint at the upper end of an upright body; its family must have an axis."""
    assert family.axis is not None
    return model.joint_names.index(family.axis[1])


def with_top_at(family: BodyFamily, model: BodyModel, pose: Array, joints: Array) -> Array:
    """A pose (D,), moved so that the upper end of the body is where joints (J, 3) have it."""
    after, top = pose.copy(), top_joint(family, model)
    after[model.root[:3]] += joints[top] - joint_positions(model, pose[None])[0, top]
    return after


def mean_point(view: SubjectView) -> Array:
    """The mean (3,) of the observed points of one camera, in its own frame, metres."""
    return np.asarray(camera_points(view).mean(axis=0))
