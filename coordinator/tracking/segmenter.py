"""Cuts tracked bodies out of frame after frame, finds people who are not tracked, and learns the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.camera import Intrinsics
from common.frame import SUBJECT, UNKNOWN, DepthFrame, SubjectFrame
from common.kinematics import bounding_box, pose_vertices
from coordinator.scene.cutting import REACH, Cut, cut_mask, cut_out
from coordinator.scene.extent import share_shown
from coordinator.scene.nearness import Nearness, surround
from coordinator.scene.people.candidates import likeliest, somebodys, take_apart
from coordinator.scene.room.background import AWAY
from coordinator.scene.scene import Scene, SceneChange
from coordinator.scene.scope import Scope
from coordinator.scene.sharing import share, within
from coordinator.scene.view import SceneView
from coordinator.tracking.observing.subject import isolate, subject_of

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

EXPLAINED_M = 0.12  # from a posed body, in which no other person is looked for
LEAST_SHOWN = 0.2  # share of a posed body that is seen, from which on what is beside it is the room's
NOWHERE = Nearness(np.zeros(3), np.empty((0, 0, 0), np.uint8))


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
            change = self._scene.learn(view, None)
            found = () if body is not None or subject is None else (subject,)
            return Segmented(frame, (None if body is None else subject,), found, view, change)
        return self._segment_room(frame, view, bodies)

    def find_candidates(self, segmented: Segmented, tracked: Sequence[PosedBody]) -> tuple[SubjectFrame, ...]:
        """People in a frame that was segmented already, beside those who are tracked; the likeliest first."""
        frame, view = segmented.frame, segmented.view
        if not view.furnished and len(segmented.subjects) == 1:
            subject = isolate(frame, None, self._points)
            return () if subject is None else (subject,)
        near = [surround(body.surface) for body in tracked]
        known = within(view, near, EXPLAINED_M) if near else None
        found = self._scope.person.choose(view, likeliest(view, take_apart(view, known)))
        return self._subjects(frame, [cut_mask(view, each.mask, known) for each in found])

    def _segment_room(
        self, frame: DepthFrame, view: SceneView, bodies: Sequence[PosedBody | None]
    ) -> Segmented:
        """Where something else than people is measured, or several people are tracked."""
        placed = [n for n, body in enumerate(bodies) if body is not None]
        surfaces = [body.surface for body in bodies if body is not None]
        near = [surround(surface) for surface in surfaces]
        others, candidates, somebody = share(view, surfaces, near), list[Cut](), None
        missing = len(placed) < len(bodies)
        if missing:
            known = within(view, near, EXPLAINED_M) if near else None
            parts = take_apart(view, known)
            found = self._scope.person.choose(view, likeliest(view, parts))
            somebody = somebodys(view, parts)
            found = found[:1] if len(bodies) == 1 else found
            candidates = [cut_mask(view, each.mask, known) for each in found]
            others = [joined([mask, *(each.mask for each in found)]) for mask in others]
        cuts = {
            n: cut_out(view, surface, near[place], others[place], REACH)
            for place, (n, surface) in enumerate(zip(placed, surfaces, strict=True))
        }
        gone = any(
            not shows(view, cut, surface) for cut, surface in zip(cuts.values(), surfaces, strict=True)
        )
        everyone = joined_cuts(view, [*cuts.values(), *candidates]) if near else None
        free = replace(view, depth=np.where(within(view, near, AWAY), np.float32(0.0), view.depth))
        change = self._scene.learn(free, everyone, somebody, patient=missing, elsewhere=gone)
        subjects = [self._subjects(frame, [cuts[n]] if n in cuts else []) for n in range(len(bodies))]
        return Segmented(
            frame,
            tuple(found[0] if found else None for found in subjects),
            self._subjects(frame, candidates),
            view,
            change,
        )

    def _subjects(self, frame: DepthFrame, cuts: Sequence[Cut]) -> tuple[SubjectFrame, ...]:
        """The people who were cut out of a frame, without those of whom nothing is measured."""
        found = (subject_of(frame, cut, self._points) for cut in cuts)
        return tuple(subject for subject in found if subject is not None)


def prepare() -> None:
    """Load what the first frame of a room needs, which takes some seconds, once in a process."""
    camera = Intrinsics(80, 60, 60.0, 60.0, 39.5, 29.5)
    wall = np.full((camera.height, camera.width), 4000, dtype=np.uint16)
    Segmenter(1).segment(DepthFrame(0, 0.0, wall, 1000.0, camera), [None])


def shows(view: SceneView, cut: Cut, surface: Array) -> bool:
    """Whether so much of a posed surface (V, 3) is seen that what is beside it is the room's."""
    left, top, _, _ = cut.window
    fx, fy, cx, cy = view.lens
    return share_shown(cut.kinds, (fx, fy, cx - left, cy - top), surface) > LEAST_SHOWN


def joined(masks: Sequence[Mask | None]) -> Mask | None:
    """Pixels that are in any of several masks (H, W); None if there is no mask."""
    given = [mask for mask in masks if mask is not None]
    return np.logical_or.reduce(given) if given else None


def joined_cuts(view: SceneView, cuts: Sequence[Cut]) -> Cut:
    """All bodies and people who were cut out, as one."""
    height, width = view.depth.shape
    labels = np.full((height, width), UNKNOWN, dtype=np.uint8)
    for cut in cuts:
        left, top, right, bottom = cut.window
        labels[top:bottom, left:right][cut.kinds == SUBJECT] = SUBJECT
    return Cut((0, 0, width, height), labels, NOWHERE)
