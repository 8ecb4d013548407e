"""Segments each frame into tracked bodies and other people, and learns the scene."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import NamedTuple

import numpy as np

from gepf.common.arrays import Array, Mask
from gepf.common.camera import points_of
from gepf.common.frame import Frame, SubjectFrame, View
from gepf.coordinator.colour.matching import Keypoints, with_keypoints
from gepf.coordinator.scene.candidates import Candidate, candidates, has_moved
from gepf.coordinator.scene.foreign import mark_foreign, points_beside
from gepf.coordinator.scene.planes import Planes
from gepf.coordinator.scene.scene import NOBODY, Depth, Scene, SceneChange, SceneChanges, SceneView
from gepf.coordinator.scene.scope import Scope
from gepf.coordinator.scene.segmentation import (
    Segmentation,
    is_missing,
    measure_distances,
    nearest_of,
    segment_body,
    segment_masks,
)
from gepf.coordinator.settings import SceneSettings
from gepf.coordinator.tracking.observation import MaskedView, depth_in, depth_of, outline, subject_of

MaskHypotheses = tuple[MaskedView, ...]
"""The masks of an untracked person in one image, from the narrowest to the widest."""


class ExpectedSurface(NamedTuple):
    """Where a body is expected in a frame.

    vertices: (V, 3) of its surface, rig's frame, metres; None if it may be anywhere. excluded: cameras that
    are not used for it, unless no other camera shows it. is_new: whether it was detected a short time ago.
    """

    vertices: Array | None = None
    excluded: Collection[str] = ()
    is_new: bool = False


class PosedSurface(NamedTuple):
    """An expected body in the image of one camera.

    vertices: (V, 3), camera frame, metres. distances: (H, W) of the pixels' points from it. is_new: see
    `ExpectedSurface`.
    """

    vertices: Array
    distances: Depth
    is_new: bool


@dataclass(frozen=True, slots=True, eq=False)
class SegmentedView:
    """The segmented image of one camera.

    image: within the user's scope. bodies: the mask of each body, None if invisible. people: the masks of
    each untracked person.
    """

    image: View
    scene: SceneView
    change: SceneChange
    bodies: tuple[MaskedView | None, ...]
    people: tuple[MaskHypotheses, ...]


@dataclass(frozen=True, slots=True, eq=False)
class UntrackedPerson:
    """The crop of a person who is not tracked.

    alternatives: the same frame with successively wider masks of the person.
    """

    subject: SubjectFrame
    alternatives: tuple[SubjectFrame, ...] = ()

    @property
    def widest(self) -> SubjectFrame:
        """The frame with the widest mask of the person."""
        return self.alternatives[-1] if self.alternatives else self.subject

    @property
    def is_shown(self) -> bool:
        """Whether colour confirms the person."""
        return any(view.keypoints is not None for view in self.subject.views)

    def with_keypoints(self, keypoints: Keypoints) -> UntrackedPerson:
        """The person with the keypoints that colour shows."""
        if not keypoints:
            return self
        alternatives = (with_keypoints(frame, keypoints) for frame in self.alternatives)
        return UntrackedPerson(with_keypoints(self.subject, keypoints), tuple(alternatives))


@dataclass(frozen=True, slots=True, eq=False)
class SegmentedFrame:
    """A segmented frame.

    subjects: one per body; None if nothing of the body is visible, or if it may be anywhere.
    set_aside: for each body, its crops from the cameras that are not used for it.
    candidates: people who are not tracked, the most likely first; empty unless a body may be anywhere.
    """

    frame: Frame
    subjects: tuple[SubjectFrame | None, ...]
    set_aside: tuple[SubjectFrame | None, ...]
    candidates: tuple[UntrackedPerson, ...]
    views: tuple[SegmentedView, ...]

    def pixels(self, person_index: int) -> int:
        """Number of pixels that show the body with this index in the list."""
        subject = self.subjects[person_index]
        return 0 if subject is None else subject.pixels

    @property
    def changes(self) -> SceneChanges:
        """What the frame changed in the known scene of each camera."""
        return {view.image.camera: view.change for view in self.views}

    def planes(self, subject: SubjectFrame | None) -> Planes:
        """The planes that the camera with the largest part of a subject sees."""
        camera = None if subject is None else subject.largest.image.camera
        seen = (view.scene.planes for view in self.views if view.image.camera == camera)
        return next(seen, Planes())


@dataclass(frozen=True, slots=True, eq=False)
class BodyView:
    """What a frame shows of one body.

    alternatives: see `UntrackedPerson`; used only for a body that is not known yet. set_aside: the crops from
    the cameras that are not used for this body. is_own: the subject was segmented around the body, and is
    not a candidate. is_elsewhere: not where the body was expected. after_gap: the gap since the last frame is
    long, so the next frame is not segmented until this one has been refined. is_looked_at: the keypoint
    network has looked for this person in a trusted colour image. step_m: the motion (3,) since the last pose
    according to colour; None if unknown. is_swapped: left and right in colour were swapped, to agree with
    the body.
    """

    frame: Frame
    subject: SubjectFrame | None
    planes: Planes
    alternatives: tuple[SubjectFrame, ...] = ()
    set_aside: SubjectFrame | None = None
    is_own: bool = True
    is_elsewhere: bool = False
    after_gap: bool = False
    is_looked_at: bool = False
    step_m: Array | None = None
    is_swapped: bool = False


class Segmenter:
    """Segments frames in their order, within a `scope`, with at most `points` points of a body.

    Each camera has its own scene.
    """

    def __init__(self, points: int, settings: SceneSettings, scope: Scope | None = None) -> None:
        self._points, self._settings = points, settings
        self._scope = scope or Scope()
        self._scenes = dict[str, Scene]()

    def recall(self, changes: SceneChanges) -> None:
        """Restore what was known after a frame by applying its changes.

        Those of all earlier frames must have been applied first.
        """
        for camera, change in changes.items():
            self._scene_of(camera, change.T_rig_camera, None).recall(change)

    def _scene_of(self, camera: str, T_rig_camera: Array, gravity: Array | None) -> Scene:
        """The scene of a camera, from its first frame on; `gravity` (3,) as the camera measures it."""
        if camera not in self._scenes:
            scope, up = self._scope.of(camera), None if gravity is None else -gravity
            if scope.up is not None:
                up = T_rig_camera[:3, :3].T @ scope.up
            self._scenes[camera] = Scene(self._settings, scope.background, up)
        return self._scenes[camera]

    def segment(
        self, frame: Frame, bodies: Sequence[ExpectedSurface], *, rejected: bool = False, find: bool = True
    ) -> SegmentedFrame:
        """Segment the next frame: around bodies, and into other people if a body may be anywhere.

        Other people are not added to the background, unless they have been `rejected` for a while and do not
        move. Without `find`, they are not searched for, and nothing is learned while a body may be anywhere.
        """
        views = tuple(self._segment_view(view, bodies, rejected=rejected, find=find) for view in frame.views)
        subjects, set_aside = list[SubjectFrame | None](), list[SubjectFrame | None]()
        for n, body in enumerate(bodies):
            shown = [masked for view in views if (masked := view.bodies[n]) is not None]
            used, unused = (
                subject_of(
                    frame, [m for m in shown if (m.image.camera in body.excluded) == excluded], self._points
                )
                for excluded in (False, True)
            )
            subjects.append(used or unused)
            set_aside.append(None if used is None else unused)
        excluded_by_any = set[str]().union(*(body.excluded for body in bodies))
        used_views = [view for view in views if view.image.camera not in excluded_by_any]
        shows_people = any(view.people for view in used_views)
        people = self._join_people(frame, [view.people for view in (used_views if shows_people else views)])
        return SegmentedFrame(frame, tuple(subjects), tuple(set_aside), people, views)

    def find_candidates(
        self, segmented: SegmentedFrame, tracked: Sequence[Array]
    ) -> tuple[UntrackedPerson, ...]:
        """People in a segmented frame, most likely first, without those with vertices `tracked` (V, 3)."""
        seen = list[Sequence[MaskHypotheses]]()
        for segmented_view in segmented.views:
            image, view = segmented_view.image, segmented_view.scene
            if shows_one_body(view, len(segmented.subjects)):
                seen.append([(everything,) for everything in outline(image)])
                continue
            distances = [measure_distances(view, image.to_camera(body)) for body in tracked]
            near_bodies = nearest_of(view, distances) <= self._settings.segmentation.near_m
            scope = self._scope.of(image.camera)
            people = scope.choose(view, candidates(view, near_bodies))
            seen.append([mask_candidate(image, view, person, near_bodies) for person in people])
        return self._join_people(segmented.frame, seen)

    def learn_things(
        self,
        segmented: SegmentedFrame,
        changes: SceneChanges,
        searched: UntrackedPerson,
        person: SubjectFrame,
        others: Sequence[SubjectFrame],
    ) -> SceneChanges:
        """Add to the background what a search attributed to the person but the detected body does not cover.

        The search was for `searched`, in the last segmented frame or an earlier one, and detected `person`.
        `others` are the other people in the last frame. Returns all that the last frame changed, given the
        `changes` so far.
        """
        after = dict(changes)
        for view in segmented.views:
            name, depth = view.image.camera, view.scene.depth
            searched_depth = depth_of(searched.widest, name, depth.shape)
            things = (searched_depth > 0.0) & (
                abs(depth - searched_depth) < self._settings.segmentation.step_m
            )
            for subject in (person, *others):
                things &= depth_of(subject, name, depth.shape) == 0.0
            after[name] = self._scenes[name].learn(view.scene, ~things, changes[name].learned)
        return after

    def _segment_view(
        self, image: View, bodies: Sequence[ExpectedSurface], *, rejected: bool, find: bool
    ) -> SegmentedView:
        """Segment one image of a frame, and learn its scene."""
        scope = self._scope.of(image.camera)
        scene = self._scene_of(image.camera, image.T_rig_camera, image.gravity)
        image, out_of_scope = scope.limit(image)
        view = scene.see(image, out_of_scope)
        if shows_one_body(view, len(bodies)):
            scene.foreign = NOBODY
            everything, is_known = tuple(outline(image)), bodies[0].vertices is not None
            body = everything[0] if everything and is_known else None
            candidate = (everything,) if everything and not is_known else ()
            return SegmentedView(image, view, scene.learn(view), (body,), candidate)
        posed = [posed_surface(view, image, body) for body in bodies]
        known = [body for body in posed if body is not None]
        nearest = nearest_of(view, [body.distances for body in known])
        near_bodies = nearest <= self._settings.segmentation.near_m
        beside = mark_and_remember(scene, view, known, nearest)
        segmented = [
            None
            if body is None
            else segment_body(view, body.vertices, body.distances, (body.distances > nearest) | beside)
            for body in posed
        ]
        is_sought = find and len(known) < len(bodies)
        possible = candidates(view, near_bodies) if is_sought else []
        # colour tells which of several candidates is a person
        count = 1 if len(bodies) == 1 and image.colours is None else None
        chosen = scope.choose(view, possible)[:count]
        people = tuple(mask_candidate(image, view, person, near_bodies) for person in chosen)
        is_complete = is_sought or len(known) == len(bodies)
        if is_complete and not any(
            is_missing(view, body.vertices, segmentation)
            for body, segmentation in zip(posed, segmented, strict=True)
            if body is not None and segmentation is not None
        ):
            moving = [person.widest for person in possible if not rejected or has_moved(view, person)]
            not_learned = reduce(np.logical_or, moving, near_bodies)
        else:  # a body may be anywhere
            not_learned = np.ones_like(near_bodies)
        change = scene.learn(view, not_learned)
        own = tuple(None if body is None else masked_view(image, view, body) for body in segmented)
        return SegmentedView(image, view, change, own, people)

    def _join_people(
        self, frame: Frame, seen: Sequence[Sequence[MaskHypotheses]]
    ) -> tuple[UntrackedPerson, ...]:
        """People by their masks in each image; those at the same place are one person."""
        people, farthest = list[list[MaskHypotheses]](), self._settings.candidates.same_person_m
        for in_image in seen:
            for masks in in_image:

                def distance(person: list[MaskHypotheses], masks: MaskHypotheses = masks) -> float:
                    return distance_between(person[0][0], masks[0])

                elsewhere = [p for p in people if all(m[0].image is not masks[0].image for m in p)]
                near = (person for person in elsewhere if distance(person) < farthest)
                same = min(near, key=distance, default=None)
                if same is None:
                    people.append([masks])
                else:
                    same.append(masks)
        joined = (self._person_of(frame, person) for person in people)
        return tuple(person for person in joined if person is not None)

    def _person_of(self, frame: Frame, images: Sequence[MaskHypotheses]) -> UntrackedPerson | None:
        """The person whom these images show; None if there are no masks."""
        levels = range(max(map(len, images)))
        masked = [[masks[min(level, len(masks) - 1)] for masks in images] for level in levels]
        subject, *wider = [subject_of(frame, views, self._points) for views in masked]
        return UntrackedPerson(subject, tuple(filter(None, wider))) if subject else None


def mask_candidate(image: View, view: SceneView, person: Candidate, near_bodies: Mask) -> MaskHypotheses:
    """The masks of a candidate in an image; `near_bodies` are the pixels (H, W) of those who are tracked."""
    masked = segment_masks(view, (person.mask, *person.wider), near_bodies)
    return tuple(masked_view(image, view, mask) for mask in masked)


def shows_one_body(view: SceneView, body_count: int) -> bool:
    """Whether everything that an image shows is the only body."""
    return not view.shows_room and body_count == 1


def posed_surface(view: SceneView, image: View, body: ExpectedSurface) -> PosedSurface | None:
    """The body in an image; None if it may be anywhere."""
    if body.vertices is None:
        return None
    vertices = image.to_camera(body.vertices)
    return PosedSurface(vertices, measure_distances(view, vertices), body.is_new)


def mark_and_remember(scene: Scene, view: SceneView, bodies: Sequence[PosedSurface], nearest: Depth) -> Mask:
    """The pixels (H, W) of other people and things, which the scene remembers until the next frame.

    `nearest` (H, W) is the distance from the nearest of the bodies.
    """
    nearest_new = nearest_of(view, [body.distances for body in bodies if body.is_new])
    foreign = mark_foreign(view, nearest, nearest_new, scene.foreign)
    is_beside = len(bodies) > 0 and foreign.any()
    vertices = [body.vertices for body in bodies]
    scene.foreign = points_beside(view, foreign, np.concatenate(vertices)) if is_beside else NOBODY
    return foreign


def masked_view(image: View, view: SceneView, segmentation: Segmentation) -> MaskedView:
    """What an image shows of a subject; the longer a surface has been there, the less its points weigh."""
    weights = None
    if (permanence := view.permanence(segmentation.window)) is not None:
        weights = np.maximum(1.0 - permanence, view.settings.segmentation.permanent_weight)
    return MaskedView(image, segmentation.window, segmentation.labels, weights)


def distance_between(first: MaskedView, second: MaskedView) -> float:
    """Distance in metres between the centres of what two images show."""
    centres = []
    for masked in (first, second):
        image, (left, top, right, bottom) = masked.image, masked.window
        camera = image.intrinsics.crop(left, top, right - left, bottom - top)
        depth = depth_in(masked) / image.depth_scale
        centres.append(image.to_rig(np.median(points_of(depth, camera, depth > 0.0), axis=0)))
    return float(np.linalg.norm(centres[0] - centres[1]))
