"""Segments each frame into tracked bodies and other people, and learns the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.frame import DepthFrame, SubjectFrame
from common.kinematics import pose_vertices
from coordinator.scene.candidates import candidates
from coordinator.scene.scene import Depth, Mask, Scene, SceneChange, SceneView
from coordinator.scene.scope import Scope
from coordinator.scene.segmentation import (
    NEAR_M,
    assign_pixels,
    is_missing,
    mark_apart,
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
        """Vertices (V, 3) in the camera frame, metres."""
        vertices: Array = pose_vertices(self.model, self.pose[None])[0]
        return vertices


@dataclass(frozen=True, slots=True, eq=False)
class Segmented:
    """A segmented frame.

    subjects: one per body; None if nothing of the body is visible, or if it may be anywhere.
    candidates: people who are not tracked, the most likely first; empty unless a body may be anywhere.
    change: what the frame changed in the known scene.
    """

    frame: DepthFrame
    subjects: tuple[SubjectFrame | None, ...]
    candidates: tuple[SubjectFrame, ...]
    view: SceneView
    change: SceneChange

    def pixels(self, place: int) -> int:
        """Number of pixels that show the body at this place in the list."""
        subject = self.subjects[place]
        return 0 if subject is None else subject.pixels


class Segmenter:
    """Segments the frames of one camera, in their order.

    Args:
        points: Largest number of observed points of a body.
        scope: Which part of the scene counts, and which person is meant.
    """

    def __init__(self, points: int, scope: Scope | None = None) -> None:
        self._points = points
        self._scope = scope or Scope()
        self._scene = Scene(self._scope.background, self._scope.up)

    def recall(self, change: SceneChange) -> None:
        """Restore what was known after a frame; the changes of the frames before it come first."""
        self._scene.recall(change)

    def segment(
        self,
        frame: DepthFrame,
        bodies: Sequence[PosedBody | None],
        *,
        rejected: bool = False,
        find: bool = True,
    ) -> Segmented:
        """Segment the next frame: near each body, and, if a body may be anywhere, other people.

        Other people are not learned as the room, unless they have been `rejected` for a while. Without
        `find`, they are not searched for, and nothing is learned while a body may be anywhere.
        """
        whole = frame
        frame, left_out = self._scope.limit(frame)
        view = self._scene.see(frame, left_out)
        if not view.furnished and len(bodies) == 1:
            subject, change = isolate(frame, self._points), self._scene.learn(view)
            found = () if bodies[0] is not None or subject is None else (subject,)
            return Segmented(whole, (None if bodies[0] is None else subject,), found, view, change)
        surfaces = [body.surface for body in bodies if body is not None]
        distances = [measure_distances(view, surface) for surface in surfaces]
        known, apart = near_any(view, distances), mark_apart(view, distances)
        others = [each | apart for each in assign_pixels(distances)]
        strangers, theirs = tuple[SubjectFrame, ...](), known.copy()
        if len(surfaces) < len(bodies) and not find:
            theirs[:] = True
        elif len(surfaces) < len(bodies):
            possible = candidates(view, known)
            found_masks = [each.mask for each in self._scope.choose(view, possible)]
            found_masks = found_masks[:1] if len(bodies) == 1 else found_masks
            strangers = self._people(frame, view, found_masks, known)
            for each in () if rejected else possible:
                theirs |= each.mask
        segmented = [segment_body(view, *each) for each in zip(surfaces, distances, others, strict=True)]
        if any(is_missing(view, *each) for each in zip(surfaces, segmented, strict=True)):
            theirs[:] = True  # a body may be anywhere, so no pixel is learned as the room
        change = self._scene.learn(view, theirs)
        own = (subject_of(frame, each, self._points) for each in segmented)
        subjects = tuple(None if body is None else next(own) for body in bodies)
        return Segmented(whole, subjects, strangers, view, change)

    def find_candidates(self, segmented: Segmented, tracked: Sequence[PosedBody]) -> tuple[SubjectFrame, ...]:
        """People in a segmented frame, apart from those who are tracked; the most likely first."""
        frame, _ = self._scope.limit(segmented.frame)
        view = segmented.view
        if not view.furnished and len(segmented.subjects) == 1:
            subject = isolate(frame, self._points)
            return () if subject is None else (subject,)
        known = near_any(view, [measure_distances(view, body.surface) for body in tracked])
        found = self._scope.choose(view, candidates(view, known))
        return self._people(frame, view, [each.mask for each in found], known)

    def _people(
        self, frame: DepthFrame, view: SceneView, masks: Sequence[Mask], known: Mask
    ) -> tuple[SubjectFrame, ...]:
        """People by masks (H, W) of their pixels; `known` are the pixels of those who are tracked."""
        found = (subject_of(frame, segment_mask(view, mask, known), self._points) for mask in masks)
        return tuple(subject for subject in found if subject is not None)


def near_any(view: SceneView, distances: Sequence[Depth]) -> Mask:
    """Pixels (H, W) near any body, from the distances to each: neither room nor another person."""
    near = np.zeros(view.depth.shape, dtype=np.bool_)
    for each in distances:
        near |= each <= NEAR_M
    return near
