"""A frame divided among several people: who is tracked is cut out, who may be somebody else is offered."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.frame import SUBJECT, UNKNOWN, DepthFrame, SubjectFrame
from coordinator.scene.candidates import candidates
from coordinator.scene.cutting import Cut, cut_mask, cut_out
from coordinator.scene.nearness import surround
from coordinator.scene.scene import Scene, SceneChange
from coordinator.scene.scope import Scope
from coordinator.scene.sharing import share, within
from coordinator.scene.view import SceneView
from coordinator.tracking.isolation import PosedBody
from coordinator.tracking.subject import subject_of

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

EXPLAINED = 0.12  # metres from a posed body in which nobody else is looked for


@dataclass(frozen=True, slots=True, eq=False)
class Offer:
    """Somebody who is not tracked, perhaps; `middle` (3,) of what is seen, camera frame, metres."""

    subject: SubjectFrame
    middle: Array


@dataclass(frozen=True, slots=True, eq=False)
class Divided:
    """What a frame shows of each body that was given (None of who is nowhere), and who else is there."""

    subjects: list[SubjectFrame | None]
    offers: list[Offer]
    view: SceneView
    change: SceneChange


class Division:
    """Divides one frame after the other.

    Args:
        points: How many pixels to pick at the most of each person.
        scope: What of the scene counts, and who is meant first.
    """

    def __init__(self, points: int, scope: Scope | None = None) -> None:
        self._points = points
        self._scope = scope or Scope()
        self._scene = Scene(self._scope.background)

    def recall(self, change: SceneChange) -> None:
        """Know what was known after a frame that made this change, if all before it were recalled, too."""
        self._scene.recall(change)

    def divide(self, frame: DepthFrame, bodies: Sequence[PosedBody | None]) -> Divided:
        """What the next frame shows near each body, and, if one of them is nowhere, of other people."""
        frame = self._scope.limits.keep(frame)
        view = self._scene.see(frame)
        surfaces = [body.surface for body in bodies if body is not None]
        near = [surround(surface) for surface in surfaces]
        shared = zip(surfaces, near, share(view, near), strict=True)
        cuts = [cut_out(view, *each) for each in shared]
        strangers: list[Cut] = []
        missing = len(cuts) < len(bodies)
        if missing:
            known = within(view, near, EXPLAINED)
            found = self._scope.person.choose(view, candidates(view, known))
            strangers = [cut_mask(view, each.mask, known) for each in found]
        change = self._scene.learn(view, everybody(view, surfaces, [*cuts, *strangers]), patient=missing)
        placed = iter(cuts)
        return Divided(
            [None if body is None else subject_of(frame, next(placed), self._points) for body in bodies],
            [offer for cut in strangers if (offer := self._offer(frame, cut)) is not None],
            view,
            change,
        )

    def _offer(self, frame: DepthFrame, cut: Cut) -> Offer | None:
        subject = subject_of(frame, cut, self._points)
        return None if subject is None else Offer(subject, middle_of(subject))


def everybody(view: SceneView, surfaces: Sequence[Array], cuts: Sequence[Cut]) -> Cut | None:
    """All who were cut out as one, with the distances from all posed bodies; None if there is no such."""
    if not surfaces:
        return None
    height, width = view.depth.shape
    kinds = np.full((height, width), UNKNOWN, dtype=np.uint8)
    for cut in cuts:
        left, top, right, bottom = cut.window
        kinds[top:bottom, left:right][cut.kinds == SUBJECT] = SUBJECT
    return Cut((0, 0, width, height), kinds, surround(np.concatenate(surfaces)))


def middle_of(subject: SubjectFrame) -> Array:
    """The median (3,) of what is seen of somebody, camera frame, metres."""
    camera, depth = subject.frame.intrinsics, subject.frame.metres()
    rows, columns = np.nonzero(depth)
    z = depth[rows, columns].astype(np.float64)
    points = np.stack([(columns - camera.cx) / camera.fx * z, (rows - camera.cy) / camera.fy * z, z])
    middle: Array = np.median(points, axis=1)
    return middle
