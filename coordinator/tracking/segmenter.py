"""Cuts tracked bodies out of frame after frame, finds people who are not tracked, and learns the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.camera import Intrinsics
from common.frame import DepthFrame, SubjectFrame
from common.kinematics import bounding_box, pose_vertices
from coordinator.scene.candidates import candidates
from coordinator.scene.distance_field import DistanceField
from coordinator.scene.room import SceneView
from coordinator.scene.scene import Scene, SceneChange
from coordinator.scene.scope import Scope
from coordinator.scene.segmentation import (
    Segmentation,
    assign_pixels,
    explained,
    is_present,
    segment_body,
    segment_mask,
)
from coordinator.tracking.observation import isolate, subject_of

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PosedBody:
    """A body in a pose (D,)."""

    model: BodyModel
    pose: Array

    @property
    def surface(self) -> Array:
        """Its vertices (V, 3) in the camera frame, metres."""
        vertices: Array = pose_vertices(self.model, self.pose[None])[0]
        return vertices


@dataclass(frozen=True, slots=True, eq=False)
class Segmented:
    """What a frame shows of each body, of people who are not tracked, and of the scene.

    subjects: one a body; None where nothing of it is seen, or where it may be anywhere.
    candidates: people who are not tracked, the likeliest first; looked for only where a body is missing.
    change: what the frame changed in what is known of the scene.
    """

    frame: DepthFrame
    subjects: tuple[SubjectFrame | None, ...]
    candidates: tuple[SubjectFrame, ...]
    view: SceneView
    change: SceneChange

    def pixels(self, place: int) -> int:
        """How many pixels show one of the bodies."""
        subject = self.subjects[place]
        return 0 if subject is None else subject.pixels


class Segmenter:
    """Segments one frame after the other, of one camera.

    Args:
        points: How many pixels of a body become observed points, at most.
        scope: What of the scene counts, and who is meant.
    """

    def __init__(self, points: int, scope: Scope | None = None) -> None:
        self._points = points
        self._scope = scope or Scope()
        self._scene = Scene(self._scope.background, self._scope.up)

    def recall(self, change: SceneChange) -> None:
        """Know what was known after a frame that made this change, if all before it were recalled, too."""
        self._scene.recall(change)

    def segment(self, frame: DepthFrame, bodies: Sequence[PosedBody | None]) -> Segmented:
        """What the next frame shows near each body; and, if one may be anywhere, of other people."""
        frame, left_out = self._scope.limits.split(frame)
        view = self._scene.see(frame, left_out)
        if not view.furnished and len(bodies) == 1:
            (body,) = bodies
            box = None if body is None else bounding_box(body.model, body.pose)
            subject = isolate(frame, box, self._points)
            change = self._scene.learn(view)
            found = () if body is not None or subject is None else (subject,)
            return Segmented(frame, (None if body is None else subject,), found, view, change)
        return self._segment_room(frame, view, bodies)

    def find_candidates(self, segmented: Segmented, tracked: Sequence[PosedBody]) -> tuple[SubjectFrame, ...]:
        """People in a frame that was segmented already, beside those who are tracked; the likeliest first."""
        frame, view = segmented.frame, segmented.view
        if not view.furnished and len(segmented.subjects) == 1:
            subject = isolate(frame, None, self._points)
            return () if subject is None else (subject,)
        known = explained(view, [DistanceField.around(body.surface) for body in tracked])
        found = self._scope.person.choose(view, candidates(view, known))
        return self._subjects(frame, [segment_mask(view, each.mask, known) for each in found])

    def _segment_room(
        self, frame: DepthFrame, view: SceneView, bodies: Sequence[PosedBody | None]
    ) -> Segmented:
        """Where something else than people is measured, or several people are tracked."""
        placed = [n for n, body in enumerate(bodies) if body is not None]
        surfaces = [body.surface for body in bodies if body is not None]
        fields = [DistanceField.around(surface) for surface in surfaces]
        others, strangers = assign_pixels(view, fields), list[Segmentation]()
        known = explained(view, fields)
        people = known.copy()
        if len(placed) < len(bodies):
            possible = candidates(view, known)
            found = self._scope.person.choose(view, possible)
            found = found[:1] if len(bodies) == 1 else found
            strangers = [segment_mask(view, each.mask, known) for each in found]
            theirs = np.logical_or.reduce([np.zeros_like(known), *(each.mask for each in found)])
            others = [theirs if mask is None else mask | theirs for mask in others]
            people = np.logical_or.reduce([people, *(each.mask for each in possible)])
        segmented = {
            n: segment_body(view, surface, fields[place], others[place])
            for place, (n, surface) in enumerate(zip(placed, surfaces, strict=True))
        }
        present = (is_present(view, each, segmented[n]) for n, each in zip(placed, surfaces, strict=True))
        if not all(present):  # a body may be elsewhere: wherever it is, it is not learned as the room
            people = np.logical_or.reduce([people, *(each.mask for each in candidates(view, known))])
        change = self._scene.learn(view, people)
        subjects = [
            self._subjects(frame, [segmented[n]] if n in segmented else []) for n in range(len(bodies))
        ]
        return Segmented(
            frame,
            tuple(found[0] if found else None for found in subjects),
            self._subjects(frame, strangers),
            view,
            change,
        )

    def _subjects(self, frame: DepthFrame, people: Sequence[Segmentation]) -> tuple[SubjectFrame, ...]:
        """The people of a frame that was segmented, without those of whom nothing is measured."""
        found = (subject_of(frame, each, self._points) for each in people)
        return tuple(subject for subject in found if subject is not None)


def prepare() -> None:
    """Load what the first frame of a room needs, which takes some seconds, once in a process."""
    camera = Intrinsics(80, 60, 60.0, 60.0, 39.5, 29.5)
    wall = np.full((camera.height, camera.width), 4000, dtype=np.uint16)
    Segmenter(1).segment(DepthFrame(0, 0.0, wall, 1000.0, camera), [None])
