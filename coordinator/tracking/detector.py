"""Detects a body in a frame, in any pose and orientation.

Poses of a library that resemble the observed points are refined in stages: all of them for a few iterations,
the best distinct ones until they converge, the best one with bodies of several statures and proportions and
then of several girths, and the remaining ones as the tracked body. The first two stages use few points and a
coarse surface. The others use all points and the whole surface, because a coarse surface does not show the
girth.

A search is a generator that yields the requests of each stage when they are sent, and needs their results
when it goes on. So a caller can do other work meanwhile. A search that is dropped cancels its requests.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property

import msgspec
import numpy as np

from common.arrays import Array, Indices
from common.body import ROOT_DOFS, BodyModel
from common.frame import SubjectFrame
from common.refinement import Particles
from common.settings import RefineSettings, Settings, preset
from coordinator.bodies.human.measures import REFERENCE_STATURE
from coordinator.bodies.human.shape_space import shape_space
from coordinator.bodies.tracked import Bodies, Size, coarsen, pose_by_name
from coordinator.filters.exploration import layout_of
from coordinator.scene.planes import Planes
from coordinator.tracking.gating import (
    RESIDUAL_M,
    Gate,
    gate_pose,
    reject_parts,
    reject_planes,
    reject_points,
    reject_position,
)
from coordinator.tracking.observation import camera_points, middle_of, observed_points, thin, without_flat
from coordinator.tracking.pose_candidates import Candidates, Detection, candidates_of, ordered
from coordinator.tracking.pose_library import PoseLibrary, displaced, library_of, upright_rolls
from coordinator.tracking.refiner import Pending, Refiner, Stage, iterations, with_closest_points
from coordinator.tracking.sensor_noise import SensorNoise, assume_noise
from coordinator.tracking.state import Start, roll_of, start_at

STATURES_M = (0.82, 0.9, 0.98, 1.07, 1.16, 1.26, 1.38, 1.5, 1.62, 1.74, 1.86, 1.98)
STATURE_STEPS = np.array([0.91, 0.955, 1.0, 1.045, 1.09])  # factors of the best of these
GIRTHS = (0.9, 1.05, 1.2, 1.4)
MATURITIES = (0.0, 0.5, 1.0)  # of a small person: proportions of the mean child, halfway, of an adult
USUAL_GIRTH = GIRTHS[1]
CANDIDATES, FURTHER = 100, 15  # in the first orientation; in each other one, and for each wider mask
SURVIVORS, FINALISTS = 16, 4  # distinct candidates after the first stage, and after the second
FIRST_ITERATIONS, ITERATIONS = 3, 12  # of the first stage, and of the next; the last has half of these
FEW_POINTS = 1_000  # on which candidates are refined
VERTEX_SHARE = 0.009  # of stature: rms distance of a surface from the nearest vertex, 0.008 to 0.010
REQUEST_ITERATIONS = 150  # of ICP in one request: about 10 ms on one lane


Search = Generator[Stage, None, Detection]
"""A detection: yields each stage when it is sent, and returns the detection."""


class Detector:
    """Detects the tracked body: with any size at first, with its own size when it is redetected.

    Of the tracker's settings it uses the camera's noise and orientation.
    """

    def __init__(self, bodies: Bodies, refiner: Refiner, settings: Settings) -> None:
        self._bodies = bodies
        self._refiner = refiner
        self._refine = msgspec.structs.replace(
            preset("default").refine,
            noise_depth=settings.refine.noise_depth,
            noise_lateral=settings.refine.noise_lateral,
        )
        degrees = (0, 90, 180, 270) if settings.rotate_deg is None else (settings.rotate_deg,)
        self._rolls = tuple(float(np.radians(each)) for each in degrees)
        self._usual = bodies.measures or Size(REFERENCE_STATURE, USUAL_GIRTH)

    @cached_property
    def _library(self) -> PoseLibrary:
        return library_of(self._bodies, self._usual)

    def prepare(self) -> None:
        """Build the pose library and the bodies of candidates."""
        for size in self._sizes:
            self._coarse(*size)

    def detect(self, subject: SubjectFrame, noise: SensorNoise, planes: Planes) -> Search:
        """Detect an unknown body in a frame, given the camera's noise and the planes of the room.

        Of the masks of what may be the person's, the one is used in which a body explains most. In the wider
        ones, only the best poses so far and a few of the library, in the first orientation, are refined. If
        no body explains the frame, its largest flat part may be a seat. So the body is searched for again
        without its points.
        """
        settings, rolls = assume_noise(self._refine, noise), upright_rolls(planes, self._rolls)
        matched = self._match(subject, self._sizes, rolls)
        shown, best = subject, (yield from self._shortlist(subject, matched, settings, self._sizes))
        for wider in subject.wider:
            again = (best.poses, best.sizes), self._similar(wider, self._sizes, rolls[0], FURTHER)
            other = yield from self._shortlist(wider, again, settings, self._sizes)
            if gain(wider, other, settings) > gain(shown, best, settings):
                shown, best = wider, other
        found = yield from self._detect(shown, best, settings, noise, planes)
        if found.gate.passes or not self._bodies.people:
            return found
        if (clear := without_flat(subject)) is subject:
            return found
        matched = self._match(clear, self._sizes, rolls)
        best = yield from self._shortlist(clear, matched, settings, self._sizes)
        without = yield from self._detect(clear, best, settings, noise, planes)
        return without if without.gate.passes else found

    def _detect(
        self,
        subject: SubjectFrame,
        best: Candidates,
        settings: RefineSettings,
        noise: SensorNoise,
        planes: Planes,
    ) -> Search:
        """Detect an unknown body that explains all points of a frame, from its shortlist."""
        size, found = yield from self._select(subject, best, settings, self._sizes)
        if len(subject.views) > 1 and len(self._sizes) > 1:  # few of the candidates had this size
            matched = self._match(subject, [size], upright_rolls(planes, self._rolls), found[0])
            best = yield from self._shortlist(subject, matched, settings, [size])
            _, found = yield from self._select(subject, best, settings, [size])
        model = self._bodies.for_start(*size)
        start = start_at(pose_by_name(model, found[0]), self._bodies, size, noise)
        candidates, gate = yield from self._refine_tracked(subject, start, found, settings)
        if self._bodies.people:
            gate = gate.against(reject_points(subject, size.stature))
            some, between = observed_points(subject, FEW_POINTS), VERTEX_SHARE * size.stature
            gate = gate.against(reject_planes(some, candidates.residual[0], between))
            gate = gate.against(reject_parts(start.model, candidates.poses[0], subject, size.stature))
            if planes.has_floor:
                joints, names = subject.frame.to_camera(candidates.joints[0]), start.model.joint_names
                trunk = joints[names.index("head")] - joints[names.index("pelvis")]
                lowest = float(planes.above(joints).min())
                gate = gate.against(reject_position(float(trunk @ planes.up), lowest))
        return Detection(subject, start, candidates, gate)

    def redetect(
        self, subject: SubjectFrame, start: Start, rules: RefineSettings, last: Array, *, lost: bool
    ) -> Search:
        """Redetect a known body anywhere; `last` (D,) is its last pose.

        For a person who is not lost and has the same orientation as at the start, only that one is searched.
        """
        turn = subject.frame.T_camera_rig[:3, :3]
        first = roll_of(start.model, start.pose, turn)
        rolls = (first, *(roll for roll in self._rolls if roll != first))
        if not lost and self._bodies.people and roll_of(start.model, last, turn) == first:
            rolls = rolls[:1]
        settings = msgspec.structs.replace(
            self._refine, noise_depth=rules.noise_depth, noise_lateral=rules.noise_lateral
        )
        size = start.size
        values = {**start.values, **pose_by_name(start.model, last)}
        model = self._bodies.for_start(*size)
        known = np.array([values.get(name, 0.0) for name in model.dof_names])
        few, matched = thin(subject, FEW_POINTS), self._match(subject, [size], rolls, known)
        proposed = yield from self._refine_few(few, matched, settings, [size], first=True)
        limbs = layout_of(model).limbs
        if len(subject.views) > 1 and limbs:  # they show which limb is wrong
            mixed = [proposed.poses]
            for limb in limbs:
                mixed.append(np.tile(known, (len(proposed.poses), 1)))
                mixed[-1][:, limb.dofs] = proposed.poses[:, limb.dofs]
            group = np.concatenate(mixed), np.zeros(len(mixed) * len(proposed.poses), dtype=np.int64)
            proposed = yield from self._refine_few(few, [group], settings, [size], first=True)
        best = yield from self._refine_few(few, [(proposed.poses, proposed.sizes)], settings, [size])
        _, found = yield from self._select(subject, best, settings, [size])
        candidates, gate = yield from self._refine_tracked(subject, start, found, rules)
        return Detection(subject, start, candidates, gate)

    def transfer(self, detection: Detection, now: SubjectFrame, rules: RefineSettings) -> Detection:
        """The best of a detection, and the best that faces the other way, in the frame `now`.

        They are moved with the body and refined and gated there.
        """
        if detection.subject is now:
            return detection
        model = detection.start.model
        best = detection.candidates.distinct(model.joint_names, 1)
        poses = move_with_points(model, best.poses, detection.subject, now)
        pending = self._refiner.submit(now, model, Particles(poses, iterations(rules, ITERATIONS)))
        candidates = ordered([candidates_of(model, pending.result(), 0)])
        if not len(candidates.poses):  # none of them is visible
            return detection
        gate = gate_pose(candidates.log_likelihood[0], candidates.residual[0], rules)
        return Detection(now, replace(detection.start, pose=candidates.poses[0]), candidates, gate)

    @property
    def _sizes(self) -> list[Size]:
        """The sizes with which an unknown body is searched for."""
        known = self._bodies.measures
        return [known] if known else [Size(stature, USUAL_GIRTH) for stature in STATURES_M]

    def _coarse(self, *size: float) -> BodyModel:
        """The body of candidates of this size."""
        return coarsen(self._bodies.for_start(*size), self._library.cell_m)

    def _shortlist(
        self,
        subject: SubjectFrame,
        matched: Iterable[tuple[Array, Indices]],
        settings: RefineSettings,
        sizes: Sequence[Size],
    ) -> Generator[Stage, None, Candidates]:
        """The best distinct candidates of these sizes after the second stage, on a few points."""
        few = thin(subject, FEW_POINTS)
        proposed = yield from self._refine_few(few, matched, settings, sizes, first=True)
        return (yield from self._refine_few(few, [(proposed.poses, proposed.sizes)], settings, sizes))

    def _refine_few(
        self,
        few: SubjectFrame,
        groups: Iterable[tuple[Array, Indices]],
        settings: RefineSettings,
        sizes: Sequence[Size],
        *,
        first: bool = False,
    ) -> Generator[Stage, None, Candidates]:
        """The best distinct candidates of the first stage, or of the second, on a few points.

        Each of the groups has poses (N, D) and the places (N,) of their sizes in the list.
        """
        count, kept = (FIRST_ITERATIONS, SURVIVORS) if first else (ITERATIONS, FINALISTS)
        models = [self._coarse(*size) for size in sizes]
        closest = iterations(with_closest_points(settings), count)
        found = yield from self._refine_candidates(few, models, groups, closest)
        return found.distinct(models[0].joint_names, kept)

    def _select(
        self, subject: SubjectFrame, found: Candidates, settings: RefineSettings, sizes: Sequence[Size]
    ) -> Generator[Stage, None, tuple[Size, Array]]:
        """The size and poses (N, D) that explain a frame best, of these candidates' sizes or between them."""
        then = iterations(settings, ITERATIONS)
        size, poses = sizes[found.sizes[0]], found.poses
        if len(sizes) > 1:
            adult, statures = shape_space().statures[-1], size.stature * STATURE_STEPS
            tried = MATURITIES if size.stature <= adult else MATURITIES[:1]
            pairs = [(each, m) for m in tried for each in statures if m == 0.0 or each < adult]
            sizes = [Size(each, size.girth, maturity) for each, maturity in pairs]
            size, _ = yield from self._choose_size(subject, sizes, poses[0], then)
            girths = [size._replace(girth=girth) for girth in GIRTHS]
            size, best = yield from self._choose_size(subject, girths, poses[0], then)
            poses = np.concatenate([best, poses])
        return size, poses

    def _choose_size(
        self, subject: SubjectFrame, sizes: Sequence[Size], pose: Array, settings: RefineSettings
    ) -> Generator[Stage, None, tuple[Size, Array]]:
        """The likelihood-weighted mean of the sizes with the maturity of the best, and its pose: (1, D).

        The likelihood measures distances to the nearest vertex. Vertices of a larger body are farther apart,
        so the part of the distances that this causes is left out.
        """
        models = [self._bodies.for_start(*size) for size in sizes]
        group = np.tile(pose, (len(sizes), 1)), np.arange(len(sizes))
        found = yield from self._refine_candidates(subject, models, [group], settings)
        if not len(found.poses):  # none of them is visible
            return sizes[len(sizes) // 2], pose[None]
        measures = np.array(sizes)[found.sizes]
        between = VERTEX_SHARE * measures[:, 0] / settings.likelihood_scale
        likely = found.log_likelihood + 0.5 * between**2
        best = likely.argmax()
        weights = np.exp(likely - likely[best]) * (measures[:, 2] == measures[best, 2])
        return Size(*(weights @ measures / weights.sum()).round(2).tolist()), found.poses[[best]]

    def _match(
        self, subject: SubjectFrame, sizes: Sequence[Size], rolls: Sequence[float], last: Array | None = None
    ) -> Iterator[tuple[Array, Indices]]:
        """Candidates (N, D) and their sizes (N,): those of the first orientation, then all others.

        They are poses of the library that are similar to the observed points, and the last pose `last` (D,),
        moved and rotated.
        """
        yield self._similar(subject, sizes, rolls[0], CANDIDATES)
        others = [self._similar(subject, sizes, roll, FURTHER) for roll in rolls[1:]]
        if last is not None:
            model, placed = self._bodies.for_start(*sizes[0]), subject.frame.T_rig_camera
            poses = displaced(model, last, camera_points(subject), self._library.cell_m, placed)
            others.append((poses, np.zeros(len(poses), dtype=np.int64)))
        if others:
            poses, of = map(np.concatenate, zip(*others, strict=True))
            yield poses, of

    def _similar(
        self, subject: SubjectFrame, sizes: Sequence[Size], roll: float, count: int
    ) -> tuple[Array, Indices]:
        """Poses (N, D) of the library that are similar to the observed points, and their sizes (N,)."""
        scales = [size.stature / self._usual.stature if self._bodies.people else 1.0 for size in sizes]
        placed = subject.frame.T_rig_camera
        return self._library.match(camera_points(subject), scales, roll, count, placed)

    def _refine_tracked(
        self, subject: SubjectFrame, start: Start, poses: Array, settings: RefineSettings
    ) -> Generator[Stage, None, tuple[Candidates, Gate]]:
        """Convert poses (N, D) of the detected body to the tracked body and refine them; held values stay.

        Also returns the gate of the best.
        """
        searched, model = self._bodies.for_start(*start.size), start.model
        taken = np.tile(start.pose, (len(poses), 1))
        for j, name in enumerate(model.dof_names):
            if name in searched.dof_names:
                taken[:, j] = poses[:, searched.dof(name)]
        halves = [(some, np.zeros(len(some), dtype=np.int64)) for some in (taken[::2], taken[1::2])]
        last = iterations(settings, ITERATIONS // 2)
        found = yield from self._refine_candidates(subject, [model], halves, last)
        return found, gate_pose(found.log_likelihood[0], found.residual[0], settings)

    def _refine_candidates(
        self,
        subject: SubjectFrame,
        models: Sequence[BodyModel],
        groups: Iterable[tuple[Array, Indices]],
        settings: RefineSettings,
    ) -> Generator[Stage, None, Candidates]:
        """Refine poses (N, D) of bodies with these indices (N,), in requests of bounded duration.

        Each group is sent as soon as it is known.
        """
        most, sent = max(1, REQUEST_ITERATIONS // (settings.icp_iterations + 1)), list[tuple[int, Pending]]()
        for poses, of in groups:
            for size in np.unique(of).tolist():
                mine = poses[of == size]
                for first in range(0, len(mine), most):
                    some = Particles(mine[first : first + most], settings, spare=True)
                    sent.append((size, self._refiner.submit(subject, models[size], some)))
        try:
            yield tuple(pending for _, pending in sent)
            return ordered([candidates_of(models[size], pending.result(), size) for size, pending in sent])
        finally:
            for _, pending in sent:
                pending.cancel()


def gain(subject: SubjectFrame, found: Candidates, settings: RefineSettings) -> float:
    """Log-likelihood of a subject's pixels with the best candidate, less that at the gate's residual."""
    least = -0.5 * ((RESIDUAL_M + settings.noise_depth) / settings.likelihood_scale) ** 2
    return subject.pixels * (float(found.log_likelihood[0]) - least)


def move_with_points(model: BodyModel, poses: Array, before: SubjectFrame, now: SubjectFrame) -> Array:
    """Poses (N, D), with the root moved as the middle of the observed points moves between two frames."""
    after = poses.copy()
    for name, step in zip(ROOT_DOFS[:3], middle_of(now) - middle_of(before), strict=True):
        if name in model.dof_names:
            after[:, model.dof(name)] += step
    return after
