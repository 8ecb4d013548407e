"""Detects a body in a frame, in any pose and orientation.

Poses of a library that resemble the observed points are refined in stages, together with their shape: all of
them for a few iterations, the best distinct ones until they converge, then with all points and the whole
surface, because a coarse surface does not show a person's girth, and finally as the tracked body.

`CandidateStages` implements the stages.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property

import msgspec
import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import ROOT_DOFS, SHAPE, BodyModel, with_fixed_shape
from gepf.common.frame import SubjectFrame, SubjectView
from gepf.common.refinement import Particles
from gepf.common.settings import RefineSettings
from gepf.coordinator.bodies.family import Bodies, FittedBody
from gepf.coordinator.bodies.tracked import pose_by_name
from gepf.coordinator.filters.exploration import layout_of
from gepf.coordinator.filters.priors import pose_prior
from gepf.coordinator.scene.noise import SensorNoise, assume_noise
from gepf.coordinator.scene.planes import Planes
from gepf.coordinator.settings import Settings, preset
from gepf.coordinator.tracking.candidate_refinement import CandidateStages, Query, Search, Shape
from gepf.coordinator.tracking.judgement import gate_pose, max_distance_m
from gepf.coordinator.tracking.observation import camera_points, in_view, median_point, observed_points
from gepf.coordinator.tracking.pose_candidates import Detection, PoseCandidates, candidates_of, ordered
from gepf.coordinator.tracking.pose_library import PoseLibrary, at_quarter_turns, library_of, upright_rolls
from gepf.coordinator.tracking.refiner import Refiner, with_iterations
from gepf.coordinator.tracking.segmenter import UntrackedPerson
from gepf.coordinator.tracking.state import Start, start_at


class Detector:
    """Detects the tracked body: with any size at first, with its own size when it is redetected.

    Of the refinement settings, only the noise is the user's; all others are those of preset `default`.
    """

    def __init__(self, bodies: Bodies, refiner: Refiner, settings: Settings) -> None:
        self._bodies, self._family = bodies, bodies.family
        self._refiner, self._settings = refiner, settings
        self._refine_settings = msgspec.structs.replace(
            preset("default").refine,
            noise_depth=settings.refine.noise_depth,
            noise_lateral=settings.refine.noise_lateral,
        )
        degrees = (0, 90, 180, 270) if settings.rotate_deg is None else (settings.rotate_deg,)
        self._rolls = tuple(float(np.radians(roll)) for roll in degrees)
        self._flexible = settings.measure_person

    @cached_property
    def _library(self) -> PoseLibrary:
        return library_of(self._bodies, self._bodies.library_size, self._settings.search)

    @cached_property
    def _stages(self) -> CandidateStages:
        return CandidateStages(self._bodies, self._refiner, self._library.cell_m, self._settings)

    def prepare(self) -> None:
        """Build the pose library and the coarse body of the candidates."""
        _ = self._stages.coarse

    def detect(self, person: UntrackedPerson, noise: SensorNoise, planes: Planes) -> Search[Detection]:
        """Detect an unknown body in a frame, given the camera's noise and the planes of the room.

        The pixels that look like a body are searched first. If no body passes there, the subject and its
        alternatives are, and the mask in which a body explains the most pixels is used. In the alternatives,
        only the best poses so far and a few from the library, in the first orientation, are refined.
        """
        limits = self._settings.search
        rolls = upright_rolls(planes, self._rolls, limits.min_upright_share)
        settings = assume_noise(self._refine_settings, noise)
        shapes = np.array([self._bodies.shape_of(size) for size in self._bodies.sizes])
        query = Query(person.subject, settings, self._family, shapes, limits, self._first_roll(rolls))
        if person.body is not None:
            body_query = replace(query, subject=person.body)
            best = yield from self._stages.shortlist(body_query, self._match(body_query, rolls))
            detected = yield from self._detect(body_query, best, noise, planes)
            if detected.gate.passes:
                return detected
        best = yield from self._stages.shortlist(query, self._match(query, rolls))
        best_query = query
        for wider in person.alternatives:
            wider_query = replace(query, subject=wider)
            groups = best.poses, self._similar(wider_query, rolls[0], limits.further_candidates)
            refined = yield from self._stages.shortlist(wider_query, groups)
            if self._gain(wider_query, refined) > self._gain(best_query, best):
                best_query, best = wider_query, refined
        return (yield from self._detect(best_query, best, noise, planes))

    def _detect(
        self, query: Query, best: PoseCandidates, noise: SensorNoise, planes: Planes
    ) -> Search[Detection]:
        """Detect an unknown body: fit the candidates of the shortlist `best` to all points of a frame."""
        subject, settings = query.subject, query.settings
        fit = yield from self._stages.fit_shape(query, best)
        model = self._bodies.searched
        shape = fit.poses[0, : model.shape_count]
        if len(subject.views) > 1 and len(query.shapes) > 1:  # few of the candidates had this shape
            query = replace(query, shapes=shape[None])
            rolls = upright_rolls(planes, self._rolls, self._settings.search.min_upright_share)
            matched = self._match(query, rolls, fit.poses[0])
            fit = yield from self._stages.shortlist(query, matched)
        values = {
            name: value
            for name, value in pose_by_name(model, fit.poses[0]).items()
            if model.kinds[model.dof(name)] != SHAPE
        }
        size = self._family.size_of(shape) if len(shape) else self._bodies.usual_size
        start = start_at(values, self._bodies, size, noise, flexible=self._flexible)
        candidates, gate = yield from self._stages.as_tracked(subject, start, fit.poses, settings)
        if candidates.is_visible:
            gate = gate.rejected_for(self._family.implausible(fitted(query, start, candidates, planes)))
        return Detection(subject, start, candidates, gate)

    def redetect(
        self,
        subject: SubjectFrame,
        start: Start,
        settings: RefineSettings,
        last_pose: Array,
        precision: Array,
        *,
        lost: bool,
    ) -> Search[Detection]:
        """Redetect a known body anywhere, given the precision (S, S) of its shape.

        For an upright body that is not lost and has the same orientation as at the start, only that
        orientation is searched.
        """
        turn = subject.largest.image.T_camera_rig[:3, :3]
        start_roll = self._family.roll(start.model, start.pose, turn)
        first = start_roll or 0.0
        rolls = (first, *(roll for roll in self._rolls if roll != first))
        if not lost and start_roll is not None and self._family.roll(start.model, last_pose, turn) == first:
            rolls = rolls[:1]
        refine = msgspec.structs.replace(
            self._refine_settings, noise_depth=settings.noise_depth, noise_lateral=settings.noise_lateral
        )
        shape = Shape(last_pose[: start.model.shape_count], precision)
        values = {**start.values, **pose_by_name(start.model, last_pose)}
        model = self._bodies.searched
        present = np.array([values.get(name, 0.0) for name in model.dof_names])
        if model.shape_count and not len(shape.coefficients):  # a size that is not estimated
            present[: model.shape_count] = self._bodies.shape_of(start.size)
        query = Query(
            subject,
            refine,
            self._family,
            present[None, : model.shape_count],
            self._settings.search,
            self._first_roll(rolls),
            precision if len(precision) else None,
        )
        matched = self._match(query, rolls, present)
        proposed = yield from self._stages.on_few_points(query, matched, self._stages.rough)
        limbs = layout_of(model, self._settings.filter.exploration.vertices).limbs
        if len(subject.views) > 1 and limbs:  # several cameras reveal which single limb is wrong
            mixed = [proposed.poses]
            for limb in limbs:
                mixed.append(np.tile(present, (len(proposed.poses), 1)))
                mixed[-1][:, limb.dofs] = proposed.poses[:, limb.dofs]
            groups = [np.concatenate(mixed)]
            proposed = yield from self._stages.on_few_points(query, groups, self._stages.rough)
        best = yield from self._stages.on_few_points(query, [proposed.poses], self._stages.fine)
        candidates, gate = yield from self._stages.as_tracked(subject, start, best.poses, settings, shape)
        return Detection(subject, start, candidates, gate)

    def transfer(self, detection: Detection, current: SubjectFrame, settings: RefineSettings) -> Detection:
        """Refine the best candidate of a detection, and the best that faces the other way, in another frame.

        They are moved as the body has moved, and are refined and gated in the frame `current`.
        """
        if detection.subject is current:
            return detection
        model = detection.start.model
        search = self._settings.search
        best = detection.candidates.distinct(model, 1, search.distinct_m)
        poses = move_root(model, best.poses, median_point(current) - median_point(detection.subject))
        prior = pose_prior(model, settings, poses)
        particles = Particles(poses, with_iterations(settings, search.iterations), prior=prior)
        pending = self._refiner.submit(current, model, particles)
        candidates = ordered([candidates_of(model, pending.result(), current, settings)])
        if not candidates.is_visible:
            return detection
        depth_log_likelihood = candidates.depth_log_likelihood(model, current)[0]
        gate = gate_pose(depth_log_likelihood, candidates.residual[0], settings, self._settings.gating)
        return replace(detection, subject=current, candidates=candidates, gate=gate)

    def _match(self, query: Query, rolls: Sequence[float], last_pose: Array | None = None) -> Iterator[Array]:
        """Candidates (N, D): those of the first orientation, then all others.

        They are poses of the library that are similar to the observed points, and `last_pose` (D,), moved and
        rotated.
        """
        search = self._settings.search
        yield self._similar(query, rolls[0], search.candidates)
        further = [self._similar(query, roll, search.further_candidates) for roll in rolls[1:]]
        if last_pose is not None:
            model, shape = self._bodies.searched, query.shapes[0]
            body = with_fixed_shape(model, shape) if len(shape) else model
            T_rig_camera = query.subject.largest.image.T_rig_camera
            points = camera_points(query.subject.largest)
            cell_m, truncating_view = self._library.cell_m, self._truncating_view(query.subject)
            poses = at_quarter_turns(
                body, last_pose[len(shape) :], points, cell_m, search, T_rig_camera, truncating_view
            )
            further.append(np.column_stack([np.tile(shape, (len(poses), 1)), poses]))
        if further:
            yield np.concatenate(further)

    def _similar(self, query: Query, roll: float, count: int) -> Array:
        """Poses (N, D) of the library that are similar to the observed points."""
        library_length = self._family.length(self._bodies.library_size)
        scales = [self._length(shape) / library_length for shape in query.shapes]
        stride = 2 if query.truncated.any() else 1  # for a truncated body, all sizes are tried later
        points, T_rig_camera = camera_points(query.subject.largest), query.subject.largest.image.T_rig_camera
        view = self._truncating_view(query.subject)
        poses, scale_index = self._library.match(points, scales[::stride], roll, count, T_rig_camera, view)
        return np.column_stack([query.shapes[::stride][scale_index], poses])

    def _length(self, shape: Array) -> float:
        """A length that is proportional to the size of a body with this shape (S,)."""
        return self._family.length(self._family.size_of(shape) if len(shape) else self._bodies.usual_size)

    def _gain(self, query: Query, candidates: PoseCandidates) -> float:
        """Log-likelihood of a subject's pixels with the best candidate, minus that at the gate's limit."""
        allowed_m = max_distance_m(query.settings, self._settings.gating)
        log_likelihood_at_gate = -0.5 * (allowed_m / query.settings.likelihood_scale) ** 2
        log_likelihood = float(candidates.log_posterior[0] - candidates.log_prior[0])
        return query.subject.pixels * (log_likelihood - log_likelihood_at_gate)

    def _first_roll(self, rolls: Sequence[float]) -> float | None:
        """The first orientation; None for a body without an axis."""
        return None if self._family.axis is None else rolls[0]

    def _truncating_view(self, subject: SubjectFrame) -> SubjectView | None:
        """The view that may truncate the body; only bodies with an axis are compared in parts."""
        return None if self._family.axis is None else subject.largest


def fitted(query: Query, start: Start, candidates: PoseCandidates, planes: Planes) -> FittedBody:
    """The best candidate, and what the frame shows of it."""
    subject, joints = query.subject, candidates.joints[0]
    return FittedBody(
        model=start.model,
        size=start.size,
        pose=candidates.poses[0],
        joints=joints,
        in_view=in_view(subject, joints),
        residual=float(candidates.residual[0]),
        subject=subject,
        points=observed_points(subject),
        some_points=observed_points(subject, query.limits.points),
        is_cut=bool(query.truncated.any()),
        heights=planes.above(subject.largest.image.to_camera(joints)) if planes.has_floor else None,
    )


def move_root(model: BodyModel, poses: Array, motion_m: Array) -> Array:
    """Poses (N, D) with the root moved by `motion_m` (3,)."""
    after = poses.copy()
    for name, step in zip(ROOT_DOFS[:3], motion_m, strict=True):
        if name in model.dof_names:
            after[:, model.dof(name)] += step
    return after
