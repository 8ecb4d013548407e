"""Looks for the tracked body: of any size at first, of its own when it may be elsewhere.

And doubts what it finds.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.body import ROOT_DOFS
from common.frame import SubjectFrame
from common.kinematics import joint_positions
from common.settings import RefineSettings, Settings, preset
from coordinator.bodies.tracked import Bodies, pose_by_name
from coordinator.scene.room.planes import Planes
from coordinator.tracking.distance import farthest_joint
from coordinator.tracking.observing.sensor_noise import SensorNoise, assume_noise
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.search.search import (
    QUICK,
    THOROUGH,
    Found,
    Search,
    observed_points,
    ways_from,
    ways_of,
)
from coordinator.tracking.search.sizes import Size
from coordinator.tracking.search.stages import Standing, refine
from coordinator.tracking.search.verdict import (
    FEWEST,
    Verdict,
    add_doubts,
    doubt_flat,
    doubt_place,
    doubt_size,
    doubt_span,
    weigh,
)
from coordinator.tracking.search.watch import CHOOSY, DOUBTFUL, Watch
from coordinator.tracking.starting.start import Start, found_start, poses_of, way_up

Array = NDArray[np.float64]

ALIKE = 1.0  # difference of log likelihood up to which candidates explain a frame as well as each other
ELSEWHERE = 0.2  # metres of a joint between poses that are told apart
HEAD, PELVIS = "head", "pelvis"


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """Where a body was found in a frame: hypotheses (M), the likeliest first, of the body that is tracked."""

    start: Start
    standing: Standing
    verdict: Verdict

    @property
    def convinces(self) -> bool:
        """Whether it explains the frame well, by a body of no extreme size."""
        size = Size(self.start.stature, self.start.girth)
        return self.verdict.strain <= DOUBTFUL and not size.extreme

    def is_elsewhere(self, joints: Array) -> bool:
        """Whether it is another posture or place than that of joints (J, 3), and not the same one refined."""
        return bool(farthest_joint(self.standing.joints[0], joints) > ELSEWHERE)


class Seeker:
    """Finds a body in single frames.

    Args:
        bodies: Whoever may be there.
        refiner: Has candidates refined.
        settings: The tracker's: what it assumes of the camera's noise, and which way up it is.
        choosy: Believe only what explains a frame well, for some searches.
    """

    def __init__(
        self,
        bodies: Bodies,
        refiner: Refiner,
        settings: Settings,
        *,
        choosy: bool = False,
    ) -> None:
        self._bodies = bodies
        self._refiner = refiner
        self._settings = msgspec.structs.replace(
            preset("default").refine,
            noise_depth=settings.refine.noise_depth,
            noise_lateral=settings.refine.noise_lateral,
        )
        self._ways_up = tuple(ways_of(settings.rotate_deg))
        self._fewest = min(FEWEST, settings.points)
        self._choosy = choosy

    @cached_property
    def _search(self) -> Search:
        return Search(self._bodies, self._refiner)

    def prepare(self) -> None:
        """Make what the first search needs, so that no frame has to wait for it."""
        self._search.prepare()

    def begin(
        self, subject: SubjectFrame, noise: SensorNoise, planes: Planes, watch: Watch
    ) -> tuple[Finding | None, Watch]:
        """A body of which nothing is known, if it is time to look for it and it can be believed."""
        if len(subject.picked) < self._fewest:
            return None, watch.saw_nobody()
        if watch.pause > 0:
            return None, watch.waited()
        finding = self.find(subject, noise, planes)
        eager = not self._choosy or watch.failures >= CHOOSY
        if finding.verdict.stands if eager else finding.convinces:
            return finding, Watch(why=finding.verdict.why)
        return None, watch.failed(finding.verdict.why, subject.pixels)

    def find(self, subject: SubjectFrame, noise: SensorNoise, planes: Planes) -> Finding:
        """A body of which nothing is known. The verdict says whether to believe it."""
        settings = assume_noise(self._settings, noise)
        ways = ways_from(planes, self._ways_up)
        found = self._search.find(subject, settings, THOROUGH, ways_up=ways)
        start = found_start(found, self._bodies, noise)
        standing = self._on_tracked(found, start, settings)
        verdict = weigh(standing.log_likelihood[0], standing.residual[0], settings)
        verdict = add_doubts(verdict, self._doubts(subject, start, found.size, standing.joints[0], planes))
        return Finding(start, standing, self._mention_rivals(verdict, standing))

    def find_again(
        self, subject: SubjectFrame, start: Start, rules: RefineSettings, last: Array, *, lost: bool
    ) -> Finding:
        """The body that is known and was seen in pose `last` (D,), wherever it is now.

        Who is not lost and still the same way up as at the start is looked for that way up alone.
        """
        ways = (start.way_up, *(way for way in self._ways_up if way != start.way_up))
        if not lost and self._bodies.people and way_up(start.model, last) == start.way_up:
            ways = ways[:1]
        settings = msgspec.structs.replace(
            self._settings, noise_depth=rules.noise_depth, noise_lateral=rules.noise_lateral
        )
        size = Size(start.stature, start.girth)
        found = self._search.find(subject, settings, QUICK, size, ways, self._for_start(start, last))
        standing = self._on_tracked(found, start, rules)
        return Finding(start, standing, weigh(standing.log_likelihood[0], standing.residual[0], rules))

    def _for_start(self, start: Start, pose: Array) -> Array:
        """A pose (D,) of the body that is tracked as the search has it."""
        values = {**start.values, **pose_by_name(start.model, pose)}
        names = self._bodies.for_start(start.stature, start.girth).dof_names
        return np.array([values.get(name, 0.0) for name in names])

    def can_find_again(self, start: Start) -> bool:
        """Whether the body may be elsewhere: its base is not held still."""
        return set(ROOT_DOFS) <= set(start.model.dof_names)

    def _on_tracked(self, found: Found, start: Start, settings: RefineSettings) -> Standing:
        """What was found, as the body that is tracked takes it."""
        model, poses = start.model, poses_of(found, start)
        refined = refine(self._refiner, model, poses, settings)
        order = np.argsort(-refined.log_likelihood, kind="stable")
        order = order[np.isfinite(refined.log_likelihood[order])]
        joints = joint_positions(model, refined.poses)
        sizes = np.zeros(len(poses), dtype=np.int64)
        return Standing(refined.poses, sizes, refined.log_likelihood, refined.residual, joints).take(order)

    def _doubts(
        self, subject: SubjectFrame, start: Start, size: Size, joints: Array, planes: Planes
    ) -> list[tuple[float, str]]:
        """What speaks against a person; of another body nothing is known."""
        if not self._bodies.people:
            return []
        points, names = observed_points(subject), start.model.joint_names
        doubts = [*doubt_span(points, size.stature), *doubt_flat(points)]
        if self._bodies.measures is None:
            doubts += doubt_size(extreme=size.extreme, stature=size.stature)
        if planes.has_floor:
            trunk = joints[names.index(HEAD)] - joints[names.index(PELVIS)]
            doubts += doubt_place(float(trunk @ planes.up), float(planes.above(joints).min()))
        return doubts

    @staticmethod
    def _mention_rivals(verdict: Verdict, standing: Standing) -> Verdict:
        """Say where other poses explain the frame as well."""
        close = standing.log_likelihood > standing.log_likelihood[0] - ALIKE
        count = int(np.sum(close & (farthest_joint(standing.joints, standing.joints[0]) > ELSEWHERE)))
        if verdict.why or not count:
            return verdict
        return Verdict(verdict.strain, f"{count + 1} poses look alike; the likeliest was taken")
