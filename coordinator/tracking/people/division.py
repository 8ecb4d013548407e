"""A frame divided among several people: who is tracked is cut out, who may be somebody else is offered."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.frame import SUBJECT, UNKNOWN, DepthFrame, SubjectFrame
from coordinator.scene.cutting import REACH, Cut, cut_mask, cut_out
from coordinator.scene.nearness import Nearness, surround
from coordinator.scene.people.candidates import candidates
from coordinator.scene.room.background import AWAY
from coordinator.scene.scene import Scene, SceneChange
from coordinator.scene.scope import Scope
from coordinator.scene.sharing import share, within
from coordinator.scene.view import SceneView
from coordinator.tracking.observing.company import EXPLAINED
from coordinator.tracking.observing.isolation import PosedBody
from coordinator.tracking.observing.subject import subject_of

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

NOWHERE = Nearness(np.zeros(3), np.empty((0, 0, 0), np.uint8))


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
        self._scene = Scene(self._scope.background, self._scope.up)

    def recall(self, change: SceneChange) -> None:
        """Know what was known after a frame that made this change, if all before it were recalled, too."""
        self._scene.recall(change)

    def divide(
        self, frame: DepthFrame, bodies: Sequence[PosedBody | None], reach: Sequence[float] | None = None
    ) -> Divided:
        """What the next frame shows near each body, and, if one of them is nowhere, of other people.

        reach: From each body, metres, to what may be its own; None for the usual.
        """
        frame, left_out = self._scope.limits.split(frame)
        view = self._scene.see(frame, left_out)
        placed = [n for n, body in enumerate(bodies) if body is not None]
        surfaces = [body.surface for body in bodies if body is not None]
        near = [surround(surface) for surface in surfaces]
        others, strangers = share(view, surfaces, near), list[Cut]()
        missing = len(placed) < len(bodies)
        if missing:
            known = within(view, near, EXPLAINED)
            found = self._scope.person.choose(view, candidates(view, known))
            strangers = [cut_mask(view, each.mask, known) for each in found]
            others = [joined([mask, *(each.mask for each in found)]) for mask in others]
        cuts = {
            n: cut_out(view, surface, near[place], others[place], reach[n] if reach else REACH)
            for place, (n, surface) in enumerate(zip(placed, surfaces, strict=True))
        }
        everyone = everybody(view, [*cuts.values(), *strangers]) if near else None
        change = self._scene.learn(without(view, near), everyone, patient=missing)
        return Divided(
            [subject_of(frame, cuts[n], self._points) if n in cuts else None for n in range(len(bodies))],
            [offer for cut in strangers if (offer := self._offer(frame, cut)) is not None],
            view,
            change,
        )

    def _offer(self, frame: DepthFrame, cut: Cut) -> Offer | None:
        subject = subject_of(frame, cut, self._points)
        return None if subject is None else Offer(subject, middle_of(subject))


def joined(masks: Sequence[Mask | None]) -> Mask | None:
    """Pixels that are in any of several masks (H, W); None if there is no mask."""
    given = [mask for mask in masks if mask is not None]
    return np.logical_or.reduce(given) if given else None


def without(view: SceneView, near: Sequence[Nearness]) -> SceneView:
    """The frame without what is near to a body, which is not to be learned."""
    return replace(view, depth=np.where(within(view, near, AWAY), np.float32(0.0), view.depth))


def everybody(view: SceneView, cuts: Sequence[Cut]) -> Cut:
    """All who were cut out, as one."""
    height, width = view.depth.shape
    kinds = np.full((height, width), UNKNOWN, dtype=np.uint8)
    for cut in cuts:
        left, top, right, bottom = cut.window
        kinds[top:bottom, left:right][cut.kinds == SUBJECT] = SUBJECT
    return Cut((0, 0, width, height), kinds, NOWHERE)


def middle_of(subject: SubjectFrame) -> Array:
    """The median (3,) of what is seen of somebody, camera frame, metres."""
    camera, depth = subject.frame.intrinsics, subject.frame.metres()
    rows, columns = np.nonzero(depth)
    z = depth[rows, columns].astype(np.float64)
    points = np.stack([(columns - camera.cx) / camera.fx * z, (rows - camera.cy) / camera.fy * z, z])
    middle: Array = np.median(points, axis=1)
    return middle
