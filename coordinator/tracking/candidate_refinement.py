"""The stages of a search for a body: refinement of candidates, first on few points, then with other sizes.

A search is a generator. It yields the requests of each stage once they are sent, and waits for their results
when it is resumed. So a caller can do other work meanwhile. A search that is dropped cancels its requests.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.body import BodyModel
from gepf.common.frame import SubjectFrame, SubjectView
from gepf.common.kinematics import joint_positions
from gepf.common.refinement import Particles
from gepf.common.settings import RefineSettings
from gepf.coordinator.bodies.family import Bodies, BodyFamily, BodySize
from gepf.coordinator.bodies.tracked import coarsen
from gepf.coordinator.filters.exploration import layout_of
from gepf.coordinator.filters.priors import pose_prior
from gepf.coordinator.settings import SearchSettings, Settings
from gepf.coordinator.tracking.field_of_view import TOP, in_view, out_of_reach, truncated_sides
from gepf.coordinator.tracking.gating import Gate, gate_pose
from gepf.coordinator.tracking.observation import camera_points, thin
from gepf.coordinator.tracking.pose_candidates import PoseCandidates, candidates_of, depth_likelihood, ordered
from gepf.coordinator.tracking.pose_library import look_straight
from gepf.coordinator.tracking.refiner import Pending, Refiner, Requests, iterations, with_closest_points
from gepf.coordinator.tracking.state import Start


class Effort(NamedTuple):
    """What a stage on few points does."""

    iterations: int
    kept: int  # number of distinct candidates that it leaves


T = TypeVar("T")
Search = Generator[Requests, None, T]
"""A search, or some stages of it: yields the requests of each stage, and returns the result."""

Group = tuple[Array, Indices]
"""Poses (N, D) that are refined together, and the indices (N,) of their bodies in a list of sizes."""


class Shape(NamedTuple):
    """The shape of a tracked body."""

    coefficients: Array  # (S,)
    precision: Array  # (S, S)


@dataclass(frozen=True, eq=False)
class Query:
    """The frame in which a body is searched for, how it is refined there, and what it may be."""

    subject: SubjectFrame
    settings: RefineSettings
    family: BodyFamily
    sizes: Sequence[BodySize]
    limits: SearchSettings
    roll: float | None = None  # rotation of the image that makes the body upright; None without an axis

    @cached_property
    def truncated(self) -> Mask:
        """Sides at which the largest view truncates the body; all false if any other view shows it whole."""
        if self.roll is None:
            return np.zeros(4, dtype=np.bool_)
        straight = [look_straight(middle_in(view), self.roll) for view in self.subject.views]
        pairs = zip(self.subject.views, straight, strict=True)
        sides_of_views = [truncated_sides(view, turn, self.limits) for view, turn in pairs]
        return sides_of_views[0] & all(sides.any() for sides in sides_of_views)

    def log_prior(
        self, candidates: PoseCandidates, sizes: Sequence[BodySize], names: tuple[str, ...]
    ) -> Array:
        """Log priors (N,) of candidates, given their size and the joints in view."""
        seen = in_view(self.subject, candidates.joints)
        return self.family.log_prior(names, np.array(sizes)[candidates.sizes], seen)

    @cached_property
    def thinned_subject(self) -> SubjectFrame:
        """The frame with few points."""
        return thin(self.subject, self.limits.points)


class CandidateStages:
    """Refines candidates of bodies of several sizes.

    `cell_m` is the cell size of the coarse surface used in the stages on few points.
    """

    def __init__(self, bodies: Bodies, refiner: Refiner, cell_m: float, settings: Settings) -> None:
        self._bodies, self._refiner, self._cell_m = bodies, refiner, cell_m
        self._settings, self._search = settings, settings.search
        self._vertices = settings.filter.exploration.vertices
        self.rough = Effort(self._search.rough_iterations, self._search.rough_kept)
        self.fine = Effort(self._search.iterations, self._search.kept)
        self._mixed = Effort(self._search.rough_iterations, self._search.kept)

    def coarse(self, size: BodySize) -> BodyModel:
        """The body of candidates of this size."""
        return coarsen(self._bodies.for_start(*size), self._cell_m)

    def shortlist(self, query: Query, groups: Iterable[Group]) -> Search[PoseCandidates]:
        """The best distinct candidates after all stages on few points."""
        proposed = yield from self.on_few_points(query, groups, self.rough)
        best = yield from self.on_few_points(query, [proposed.group], self.fine)
        best = yield from self.on_few_points(query, [best.group, self._recombined(query, best)], self._mixed)
        if query.truncated.any():
            proposed = yield from self.on_few_points(
                query, [best.group, self._completed(query, best)], self.rough
            )
            best = yield from self.on_few_points(query, [proposed.group], self.fine)
        return best

    def on_few_points(self, query: Query, groups: Iterable[Group], effort: Effort) -> Search[PoseCandidates]:
        """The best distinct candidates after one stage on few points, with a coarse surface."""
        models = [self.coarse(size) for size in query.sizes]
        closest = iterations(with_closest_points(query.settings), effort.iterations)
        refined = yield from self._refine(query.thinned_subject, models, groups, closest)
        model = models[0]
        if not query.truncated.any() or not len(refined.poses):
            return refined.distinct(model, effort.kept, self._search.distinct_m)
        refined = refined.likelier_by(query.log_prior(refined, query.sizes, model.joint_names))
        seen = in_view(query.subject, refined.joints)
        if not query.truncated[TOP] and (tops := seen[:, top_joint(query.family, model)]).any():
            refined, seen = refined.take(np.flatnonzero(tops)), seen[tops]
        return refined.distinct(model, effort.kept, self._search.distinct_m, seen)

    def _recombined(self, query: Query, best: PoseCandidates) -> Group:
        """Poses (N, D) and sizes (N,): the best candidates, each with one limb of another candidate.

        Limbs fit or fail independently of each other, so the right limbs may be spread over
        candidates.
        """
        limbs = [limb.dofs for limb in layout_of(self.coarse(query.sizes[0]), self._vertices).limbs]
        poses, size_indices = list[Array](), list[int]()
        for pose, size in zip(best.poses[: self._search.recombined], best.sizes, strict=False):
            for other in best.poses:
                for limb in limbs:
                    mixed = pose.copy()
                    mixed[limb] = other[limb]
                    if np.any(mixed != pose):
                        poses.append(mixed)
                        size_indices.append(size)
        return np.array(poses).reshape(-1, best.poses.shape[1]), np.array(size_indices, dtype=np.int64)

    def _completed(self, query: Query, best: PoseCandidates) -> Group:
        """Poses (N, D) and sizes (N,): candidates in every size, as they are and with unseen limbs at rest.

        The upper end of each body stays in place. A visible part fits a range of sizes
        and gives no information about the other limbs.
        """
        poses, size_indices = list[Array](), list[int]()
        for pose, size, joints in zip(best.poses, best.sizes, best.joints, strict=True):
            model = self.coarse(query.sizes[size])
            unseen = out_of_reach(model, in_view(query.subject, joints))
            unseen[model.root] = False
            at_rest = np.where(unseen, 0.0, pose)
            for n, other in enumerate(query.sizes):
                for limbs in (pose, at_rest):
                    poses.append(with_top_at(query.family, self.coarse(other), limbs, joints))
                    size_indices.append(n)
        return np.array(poses), np.array(size_indices)

    def fit_size(self, query: Query, candidates: PoseCandidates) -> Search[tuple[BodySize, Array]]:
        """The size and poses (N, D) that explain a frame best, at or between the candidates' sizes."""
        size, poses = query.sizes[candidates.sizes[0]], candidates.poses
        best = poses[:0]
        if len(query.sizes) == 1:
            return size, poses
        for sizes_after in query.family.size_stages:
            size, best = yield from self._choose_size(query, size, sizes_after(size), poses[0])
        if query.truncated.any():
            model = self._bodies.for_start(*size)
            pairs = zip(candidates.poses, candidates.joints, strict=True)
            poses = np.array([with_top_at(query.family, model, pose, joints) for pose, joints in pairs])
        return size, np.concatenate([best, poses])

    def as_tracked(
        self,
        subject: SubjectFrame,
        start: Start,
        poses: Array,
        settings: RefineSettings,
        shape: Shape | None = None,
    ) -> Search[tuple[PoseCandidates, Gate]]:
        """Convert poses (N, D) of the detected body to the tracked body and refine them.

        Degrees of freedom that are held keep the values of the start. The shape is that of the start, unless
        it is known. Also returns the gate of the best.
        """
        searched, model = self._bodies.for_start(*start.size), start.model
        taken = np.tile(start.pose, (len(poses), 1))
        if shape is not None:
            taken[:, : model.shape_count] = shape.coefficients
        for j, name in enumerate(model.dof_names):
            if name in searched.dof_names:
                taken[:, j] = poses[:, searched.dof(name)]
        last = iterations(settings, self._search.iterations // 2)
        groups = map(group_for_first_size, (taken[::2], taken[1::2]))  # two requests for two workers
        precision = None if shape is None else shape.precision
        refined = yield from self._refine(subject, [model], groups, last, precision)
        by_depth = depth_likelihood(refined.log_likelihood[0], model, refined.poses[0], subject, settings)
        return refined, gate_pose(by_depth, refined.residual[0], settings, self._settings.gating)

    def _choose_size(
        self, query: Query, present: BodySize, tried: Sequence[BodySize], pose: Array
    ) -> Search[tuple[BodySize, Array]]:
        """The likelihood-weighted mean of sizes, and the pose of the best: (1, D).

        If none is visible, the present size and the given pose.
        """
        family, models = query.family, [self._bodies.for_start(*size) for size in tried]
        poses = np.tile(pose, (len(tried), 1))
        if query.truncated.any():
            joints = joint_positions(self._bodies.for_start(*present), pose[None])[0]
            poses = np.array([with_top_at(family, model, pose, joints) for model in models])
        group = poses, np.arange(len(tried))
        settings = iterations(query.settings, self._search.iterations)
        refined = yield from self._refine(query.subject, models, [group], settings)
        if not refined.is_visible:
            return present, pose[None]
        likely = refined.log_likelihood
        if query.truncated.any():
            likely = likely + query.log_prior(refined, tried, models[0].joint_names)
        best = int(likely.argmax())
        size = family.mean_size(np.array(tried)[refined.sizes], np.exp(likely - likely[best]), best)
        return size, refined.poses[[best]]

    def _refine(
        self,
        subject: SubjectFrame,
        models: Sequence[BodyModel],
        groups: Iterable[Group],
        settings: RefineSettings,
        precision: Array | None = None,
    ) -> Search[PoseCandidates]:
        """Refine poses of these bodies, in requests of limited duration.

        Each group is sent as soon as it is known. `precision` (S, S) is that of the shape, if it is
        known.
        """
        poses_per_request = max(1, self._search.request_iterations // (settings.icp_iterations + 1))
        sent = list[tuple[int, Pending]]()
        for poses, size_indices in groups:
            for size in np.unique(size_indices).tolist():
                poses_of_size, model = poses[size_indices == size], models[size]
                for first in range(0, len(poses_of_size), poses_per_request):
                    part = poses_of_size[first : first + poses_per_request]
                    prior = pose_prior(model, settings, part[:, : model.shape_count], precision)
                    particles = Particles(part, settings, spare=True, prior=prior)
                    sent.append((size, self._refiner.submit(subject, models[size], particles)))
        try:
            yield tuple(pending for _, pending in sent)
            return ordered(
                [candidates_of(models[size], pending.result(), size, settings) for size, pending in sent]
            )
        finally:
            for _, pending in sent:
                pending.cancel()


def group_for_first_size(poses: Array) -> Group:
    """Poses (N, D) of the body of the first size."""
    return poses, np.zeros(len(poses), dtype=np.int64)


def top_joint(family: BodyFamily, model: BodyModel) -> int:
    """The index of the joint at the upper end of an upright body, of a family with an axis."""
    assert family.axis is not None
    return model.joint_names.index(family.axis[1])


def with_top_at(family: BodyFamily, model: BodyModel, pose: Array, joints: Array) -> Array:
    """A pose (D,) of a body of another size, moved so that its upper end is where joints (J, 3) have it."""
    after, top = pose.copy(), top_joint(family, model)
    after[model.root[:3]] += joints[top] - joint_positions(model, pose[None])[0, top]
    return after


def middle_in(view: SubjectView) -> Array:
    """The mean (3,) of the observed points of one camera, in its own frame, metres."""
    return np.asarray(camera_points(view).mean(axis=0))
