"""Cuts tracked bodies out of frame after frame, finds people who are not tracked, and learns the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.camera import Intrinsics
from common.frame import DepthFrame, SubjectFrame
from common.kinematics import pose_vertices
from coordinator.scene.candidates import candidates
from coordinator.scene.scene import Depth, Mask, Scene, SceneChange, SceneView
from coordinator.scene.scope import Scope
from coordinator.scene.segmentation import (
    NEAR_M,
    assign_pixels,
    is_missing,
    measure_distances,
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
        frame, left_out = self._scope.limit(frame)
        view = self._scene.see(frame, left_out)
        if not view.furnished and len(bodies) == 1:
            subject, change = isolate(frame, self._points), self._scene.learn(view)
            found = () if bodies[0] is not None or subject is None else (subject,)
            return Segmented(frame, (None if bodies[0] is None else subject,), found, view, change)
        surfaces = [body.surface for body in bodies if body is not None]
        distances = [measure_distances(view, surface) for surface in surfaces]
        others, known = assign_pixels(distances), near_any(view, distances)
        strangers, theirs = tuple[SubjectFrame, ...](), known.copy()
        if len(surfaces) < len(bodies):
            possible = candidates(view, known)
            found_masks = [each.mask for each in self._scope.choose(view, possible)]
            found_masks = found_masks[:1] if len(bodies) == 1 else found_masks
            strangers = self._people(frame, view, found_masks, known)
            for mask in found_masks:
                others = [mask if other is None else mask | other for other in others]
            for each in possible:
                theirs |= each.mask
        segmented = [segment_body(view, *each) for each in zip(surfaces, distances, others, strict=True)]
        if any(is_missing(view, *each) for each in zip(surfaces, segmented, strict=True)):
            theirs[:] = True  # a body may be elsewhere: wherever it is, it is not learned as the room
        change = self._scene.learn(view, theirs)
        own = (subject_of(frame, each, self._points) for each in segmented)
        subjects = tuple(None if body is None else next(own) for body in bodies)
        return Segmented(frame, subjects, strangers, view, change)

    def find_candidates(self, segmented: Segmented, tracked: Sequence[PosedBody]) -> tuple[SubjectFrame, ...]:
        """People in a frame that was segmented already, beside those who are tracked; the likeliest first."""
        frame, view = segmented.frame, segmented.view
        if not view.furnished and len(segmented.subjects) == 1:
            subject = isolate(frame, self._points)
            return () if subject is None else (subject,)
        known = near_any(view, [measure_distances(view, body.surface) for body in tracked])
        found = self._scope.choose(view, candidates(view, known))
        return self._people(frame, view, [each.mask for each in found], known)

    def _people(
        self, frame: DepthFrame, view: SceneView, masks: Sequence[Mask], known: Mask
    ) -> tuple[SubjectFrame, ...]:
        """People whose pixels (H, W) are known, beside the pixels of those who are tracked."""
        found = (subject_of(frame, segment_mask(view, mask, known), self._points) for mask in masks)
        return tuple(subject for subject in found if subject is not None)


def near_any(view: SceneView, distances: Sequence[Depth]) -> Mask:
    """Pixels (H, W) near a body, by the distances from each: not learned as the room, and no other person."""
    near = np.zeros(view.depth.shape, dtype=np.bool_)
    for each in distances:
        near |= each <= NEAR_M
    return near


def prepare() -> None:
    """Load what the first frame of a room needs, which takes some seconds, once in a process."""
    camera = Intrinsics(80, 60, 60.0, 60.0, 39.5, 29.5)
    wall = np.full((camera.height, camera.width), 4000, dtype=np.uint16)
    Segmenter(1).segment(DepthFrame(0, 0.0, wall, 1000.0, camera), [None])
