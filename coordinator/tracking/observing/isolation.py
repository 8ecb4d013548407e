"""The subject cut out of frame after frame, in a scene that becomes known meanwhile."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.camera import Intrinsics
from common.frame import DepthFrame, SubjectFrame
from common.kinematics import bounding_box, pose_vertices
from coordinator.scene.cutting import Cut, cut_mask, cut_out
from coordinator.scene.extent import share_shown
from coordinator.scene.people.candidates import Candidate, candidates, likeliest, somebodys, take_apart
from coordinator.scene.scene import Scene, SceneChange
from coordinator.scene.scope import Scope
from coordinator.scene.view import SceneView
from coordinator.tracking.observing.subject import isolate, subject_of

Array = NDArray[np.float64]

SHOWN = 0.2  # share of the posed body that is seen from which on it tells what is the room's


@dataclass(frozen=True, slots=True, eq=False)
class PosedBody:
    """A body in a pose (D,)."""

    model: BodyModel
    pose: Array

    @property
    def surface(self) -> Array:
        """Its vertices (V, 3) in the camera frame."""
        vertices: Array = pose_vertices(self.model, self.pose[None])[0]
        return vertices


@dataclass(frozen=True, slots=True, eq=False)
class Isolated:
    """What a frame shows of the subject, of the scene, and what it changed in what is known of that."""

    subject: SubjectFrame | None  # None where nothing of it is seen
    view: SceneView
    change: SceneChange


class Isolation:
    """Cuts the subject out of one frame after the other.

    Args:
        points: How many pixels to pick at the most.
        scope: What of the scene counts, and who is meant.
    """

    def __init__(self, points: int, scope: Scope | None = None) -> None:
        self._points = points
        self._scope = scope or Scope()
        self._scene = Scene(self._scope.background, self._scope.up)

    def recall(self, change: SceneChange) -> None:
        """Know what was known after a frame that made this change, if all before it were recalled, too."""
        self._scene.recall(change)

    def cut(self, frame: DepthFrame, body: PosedBody | None) -> Isolated:
        """What the next frame shows near a body; without one, of whoever is the likeliest to be a person."""
        frame, left_out = self._scope.limits.split(frame)
        view = self._scene.see(frame, left_out)
        if not view.furnished:
            box = None if body is None else bounding_box(body.model, body.pose)
            return Isolated(isolate(frame, box, self._points), view, self._scene.learn(view, None))
        if body is None:
            parts = take_apart(view)
            cut = self._choose(view, likeliest(view, parts))
            subject = None if cut is None else subject_of(frame, cut, self._points)
            return Isolated(subject, view, self._scene.learn(view, None, somebodys(view, parts)))
        cut = cut_out(view, body.surface)
        subject = subject_of(frame, cut, self._points)
        gone = not self._shows(view, cut, body)
        return Isolated(subject, view, self._scene.learn(view, cut, elsewhere=gone))

    @staticmethod
    def _shows(view: SceneView, cut: Cut, body: PosedBody) -> bool:
        """Whether so much of a body is where it is posed that what is beside it is the room's."""
        left, top, _, _ = cut.window
        fx, fy, cx, cy = view.lens
        return share_shown(cut.kinds, (fx, fy, cx - left, cy - top), body.surface) > SHOWN

    def anybody(self, frame: DepthFrame, view: SceneView) -> SubjectFrame | None:
        """Whoever is the likeliest in a frame that was cut already, in which the body is not where it was."""
        frame = self._scope.limits.keep(frame)
        if not view.furnished:
            return isolate(frame, None, self._points)
        cut = self._choose(view, candidates(view))
        return None if cut is None else subject_of(frame, cut, self._points)

    def _choose(self, view: SceneView, found: Sequence[Candidate]) -> Cut | None:
        """The likeliest of those who may be the person that is meant."""
        found = self._scope.person.choose(view, found)
        return cut_mask(view, found[0].mask) if found else None


def prepare() -> None:
    """Load what the first frame of a room needs, which takes some seconds, once in a process."""
    camera = Intrinsics(80, 60, 60.0, 60.0, 39.5, 29.5)
    wall = np.full((camera.height, camera.width), 4000, dtype=np.uint16)
    Isolation(1).cut(DepthFrame(0, 0.0, wall, 1000.0, camera), None)
