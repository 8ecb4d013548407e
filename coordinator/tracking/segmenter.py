"""Segments each frame into tracked bodies and other people, and learns the scene."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from gepf.common.arrays import Array, Mask
from gepf.common.camera import points_of
from gepf.common.frame import DepthFrame, SubjectFrame
from gepf.coordinator.scene.candidates import Candidate, candidates
from gepf.coordinator.scene.planes import Planes
from gepf.coordinator.scene.scene import Scene, SceneChange, SceneChanges, SceneView
from gepf.coordinator.scene.scope import Scope
from gepf.coordinator.scene.segmentation import (
    NEAR_M,
    STEP_M,
    is_missing,
    mark_apart,
    measure_distances,
    nearest_of,
    segment_body,
    segment_masks,
)
from gepf.coordinator.tracking.observation import Cut, depth_in, depth_of, outline, subject_of

Shown = tuple[Cut, ...]
"""What shows a person who is not tracked in an image: with more and more of what may be the person's."""

SAME_PERSON_M = 0.5  # between the middles of one person in two images, which show different sides


@dataclass(frozen=True, slots=True, eq=False)
class SegmentedView:
    """The segmented image of one camera.

    frame: within the user's scope. bodies: the crop of each body, None if invisible. people: the crop of each
    untracked person.
    """

    frame: DepthFrame
    view: SceneView
    change: SceneChange
    bodies: tuple[Cut | None, ...]
    people: tuple[Shown, ...]


@dataclass(frozen=True, slots=True, eq=False)
class SegmentedFrame:
    """A segmented frame.

    subjects: one per body; None if nothing of the body is visible, or if it may be anywhere.
    excluded: crops of each body, of the cameras that are not used for it.
    candidates: people who are not tracked, the most likely first; empty unless a body may be anywhere.
    """

    frame: DepthFrame
    subjects: tuple[SubjectFrame | None, ...]
    excluded: tuple[SubjectFrame | None, ...]
    candidates: tuple[SubjectFrame, ...]
    views: tuple[SegmentedView, ...]

    def pixels(self, place: int) -> int:
        """Number of pixels that show the body at this place in the list."""
        subject = self.subjects[place]
        return 0 if subject is None else subject.pixels

    @property
    def changes(self) -> SceneChanges:
        """What the frame changed in the known scene of each camera."""
        return {each.frame.camera: each.change for each in self.views}

    def planes(self, subject: SubjectFrame | None) -> Planes:
        """The planes that the camera with the largest part of a subject sees."""
        camera = None if subject is None else subject.frame.camera
        return next((each.view.planes for each in self.views if each.frame.camera == camera), Planes())


@dataclass(frozen=True, slots=True, eq=False)
class BodyView:
    """What a frame shows of one body.

    excluded: what the cameras show that are not used for it. is_elsewhere: not where the body was expected.
    is_slow: it is long since the frame before, so the next one is segmented when this one is refined.
    """

    frame: DepthFrame
    subject: SubjectFrame | None
    planes: Planes
    excluded: SubjectFrame | None = None
    is_elsewhere: bool = False
    is_slow: bool = False


class Segmenter:
    """Segments frames in their order, within a `scope`, with at most `points` points of a body.

    Each camera has its own scene.
    """

    def __init__(self, points: int, scope: Scope | None = None) -> None:
        self._points = points
        self._scope = scope or Scope()
        self._scenes = dict[str, Scene]()

    def recall(self, changes: SceneChanges) -> None:
        """Restore what was known after a frame; the changes of the frames before it come first."""
        for camera, change in changes.items():
            up = None if self._scope.up is None else change.T_rig_camera[:3, :3].T @ self._scope.up
            self._scenes.setdefault(camera, Scene(up=up)).recall(change)

    def segment(
        self,
        frame: DepthFrame,
        bodies: Sequence[Array | None],
        *,
        excluded: Sequence[Collection[str]] = (),
        rejected: bool = False,
        find: bool = True,
    ) -> SegmentedFrame:
        """Segment the next frame: near the vertices (V, 3) of bodies, and people if a body may be anywhere.

        The `excluded` cameras of a body are not used for it, unless no other camera shows it.

        Other people are not learned as the room, unless they have been `rejected` for a while. Without
        `find`, they are not searched for, and nothing is learned while a body may be anywhere.
        """
        views = tuple(self._segment_view(view, bodies, rejected=rejected, find=find) for view in frame.views)
        subjects, contradicting = list[SubjectFrame | None](), list[SubjectFrame | None]()
        for n, out in enumerate(excluded or [()] * len(bodies)):
            cuts = [(each.frame.camera, cut) for each in views if (cut := each.bodies[n]) is not None]
            agreed = subject_of(frame, [cut for name, cut in cuts if name not in out], self._points)
            against = subject_of(frame, [cut for name, cut in cuts if name in out], self._points)
            subjects.append(agreed or against)
            contradicting.append(None if agreed is None else against)
        excluded_by_any = set().union(*excluded)
        shown = [each.people for each in views if each.frame.camera not in excluded_by_any]
        people = self._join_people(frame, shown if any(shown) else [each.people for each in views])
        return SegmentedFrame(frame, tuple(subjects), tuple(contradicting), people, views)

    def find_candidates(
        self, segmented: SegmentedFrame, tracked: Sequence[Array]
    ) -> tuple[SubjectFrame, ...]:
        """People in a segmented frame, most likely first, without those with vertices `tracked` (V, 3)."""
        found = list[Sequence[Shown]]()
        for each in segmented.views:
            frame, view = each.frame, each.view
            if not view.furnished and len(segmented.subjects) == 1:
                found.append([(cut,) for cut in outline(frame)])
                continue
            distances = [measure_distances(view, frame.to_camera(one)) for one in tracked]
            known = nearest_of(view, distances) <= NEAR_M
            scope = self._scope.of(frame.camera)
            people = scope.choose(view, candidates(view, known))
            found.append([cut_candidate(frame, view, one, known) for one in people])
        return self._join_people(segmented.frame, found)

    def learn_things(
        self,
        segmented: SegmentedFrame,
        changes: SceneChanges,
        searched: SubjectFrame,
        person: SubjectFrame,
        others: Sequence[SubjectFrame],
    ) -> SceneChanges:
        """Learn as the room what a search took for a part of the person, and what is none.

        The search was in the frame `searched`, the last segmented one or an earlier one, and found `person`.
        `others` are other people in the last frame. Returns all that the last frame changed, given the
        `changes` so far.
        """
        after = dict(changes)
        for each in segmented.views:
            name, depth = each.frame.camera, each.view.depth
            shown = depth_of(searched.widest, name, depth.shape)
            things = (shown > 0.0) & (abs(depth - shown) < STEP_M)
            for one in (person, *others):
                things &= depth_of(one, name, depth.shape) == 0.0
            after[name] = self._scenes[name].learn(each.view, ~things, changes[name].learned)
        return after

    def _segment_view(
        self, frame: DepthFrame, bodies: Sequence[Array | None], *, rejected: bool, find: bool
    ) -> SegmentedView:
        """Segment one image of a frame, with the surfaces (V, 3) of bodies."""
        scope = self._scope.of(frame.camera)
        if frame.camera not in self._scenes:
            up = None if frame.gravity is None else -frame.gravity
            if scope.up is not None:
                up = frame.T_camera_rig[:3, :3] @ scope.up
            self._scenes[frame.camera] = Scene(scope.background, up)
        scene = self._scenes[frame.camera]
        frame, excluded = scope.limit(frame)
        view = scene.see(frame, excluded)
        if not view.furnished and len(bodies) == 1:
            found, change = tuple(outline(frame)), scene.learn(view)
            if bodies[0] is None:
                return SegmentedView(frame, view, change, (None,), tuple((cut,) for cut in found))
            return SegmentedView(frame, view, change, (found[0] if found else None,), ())
        surfaces = [frame.to_camera(body) for body in bodies if body is not None]
        distances = [measure_distances(view, surface) for surface in surfaces]
        nearest = nearest_of(view, distances)
        known, apart = nearest <= NEAR_M, mark_apart(view, nearest)
        others = [(each > nearest) | apart for each in distances]
        segmented = [segment_body(view, *each) for each in zip(surfaces, distances, others, strict=True)]
        complete = len(surfaces) == len(bodies)
        strangers, people = tuple[Shown, ...](), known
        if find and not complete:
            possible = candidates(view, known)
            chosen = scope.choose(view, possible)[: 1 if len(bodies) == 1 else None]
            strangers = tuple(cut_candidate(frame, view, each, known) for each in chosen)
            people = known if rejected else reduce(np.logical_or, (each.widest for each in possible), known)
        missing = any(is_missing(view, *each) for each in zip(surfaces, segmented, strict=True))
        if missing or not (find or complete):  # a body may be anywhere, so no pixel is learned as the room
            people = np.ones_like(known)
        change = scene.learn(view, people)
        cuts = iter([(frame, each.window, each.labels) for each in segmented])
        own = tuple(None if body is None else next(cuts) for body in bodies)
        return SegmentedView(frame, view, change, own, strangers)

    def _join_people(self, frame: DepthFrame, seen: Sequence[Sequence[Shown]]) -> tuple[SubjectFrame, ...]:
        """People by what shows them in each image; those at the same place are one person."""
        people = list[list[Shown]]()
        for shown in seen:
            for one in shown:
                alone = [each for each in people if all(view is not one[0][0] for (view, _, _), *_ in each)]
                near = (each for each in alone if apart_m(each[0][0], one[0]) < SAME_PERSON_M)
                joined = min(near, key=lambda each: apart_m(each[0][0], one[0]), default=None)
                if joined is None:
                    people.append([one])
                else:
                    joined.append(one)
        found = (self._person_of(frame, each) for each in people)
        return tuple(person for person in found if person is not None)

    def _person_of(self, frame: DepthFrame, shown: Sequence[Shown]) -> SubjectFrame | None:
        """The person whom some images show, with the wider ones; None if there are none."""
        levels = range(max(map(len, shown)))
        cuts = [[each[min(n, len(each) - 1)] for each in shown] for n in levels]
        first, *wider = [subject_of(frame, each, self._points) for each in cuts]
        return first and replace(first, wider=tuple(each for each in wider if each))


def cut_candidate(frame: DepthFrame, view: SceneView, one: Candidate, known: Mask) -> Shown:
    """What shows a candidate in an image; `known` are the pixels (H, W) of those who are tracked."""
    found = segment_masks(view, (one.mask, *one.wider), known)
    return tuple((frame, each.window, each.labels) for each in found)


def apart_m(one: Cut, other: Cut) -> float:
    """Distance in metres between the middles of what two images show."""
    middles = []
    for view, window, labels in (one, other):
        left, top, right, bottom = window
        camera = view.intrinsics.crop(left, top, right - left, bottom - top)
        depth = depth_in(view, window, labels) / view.depth_scale
        middles.append(view.to_rig(np.median(points_of(depth, camera, depth > 0.0), axis=0)))
    return float(np.linalg.norm(middles[0] - middles[1]))
