"""Segments each frame into tracked bodies and other people, and then learns the scene from it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import NamedTuple

import numpy as np

from gepf.common.arrays import Array, Mask
from gepf.common.camera import points_of
from gepf.common.frame import Frame, SubjectFrame, View
from gepf.coordinator.bodies.pixels import BodyNetwork
from gepf.coordinator.colour.matching import Keypoints, with_keypoints
from gepf.coordinator.scene.candidates import (
    LIKELY,
    BodyPixels,
    Candidate,
    area_of,
    find_candidates,
    has_flat_side,
    has_moved,
)
from gepf.coordinator.scene.duplicates import evidence_of, find_duplicates
from gepf.coordinator.scene.planes import Planes
from gepf.coordinator.scene.scene import (
    FOREGROUND,
    NO_POINTS,
    Depth,
    Scene,
    SceneChange,
    SceneChanges,
    SceneView,
)
from gepf.coordinator.scene.scope import Scope
from gepf.coordinator.scene.segmentation import (
    Points,
    Segmentation,
    is_missing,
    mark_foreign,
    measure_distances,
    nearest_of,
    points_beside,
    segment_body,
    segment_masks,
)
from gepf.coordinator.settings import SceneSettings
from gepf.coordinator.tracking.observation import MaskedView, depth_in, depth_of, subject_of, whole_view


class PersonMasks(NamedTuple):
    """The masks of an untracked person in one image.

    hypotheses: from the narrowest to the widest. body: the pixels of the widest one that look like a body;
    None if the network is not asked, or if they are too few for a body.
    """

    hypotheses: tuple[MaskedView, ...]
    body: MaskedView | None = None

    @property
    def narrowest(self) -> MaskedView:
        """The narrowest mask."""
        return self.hypotheses[0]


class ExpectedSurface(NamedTuple):
    """Where a body is expected in a frame.

    vertices: (V, 3) of its surface, rig frame, metres; None if it may be anywhere. excluded: cameras that are
    not used for it, unless no other camera shows it. is_new: whether it was detected a short time ago.
    points_factor: factor on the number of points that are picked. followed_s: see `NextSegmentation`.
    """

    vertices: Array | None = None
    excluded: Collection[str] = ()
    is_new: bool = False
    points_factor: float = 1.0
    followed_s: float = 0.0


class PosedSurface(NamedTuple):
    """An expected body in the image of one camera.

    vertices: (V, 3), camera frame, metres. distances: (H, W) of the pixels' points from it. is_new: see
    `ExpectedSurface`.
    """

    vertices: Array
    distances: Depth
    is_new: bool


class ExpectedView(NamedTuple):
    """The image of one camera, within the user's scope, and the expected bodies in it.

    `bodies` holds None for a body that may be anywhere, and is empty if everything in the image is the body.
    """

    image: View
    scene: SceneView
    bodies: Sequence[PosedSurface | None]


@dataclass(frozen=True, slots=True, eq=False)
class SegmentedView:
    """The segmented image of one camera.

    image: within the user's scope. bodies: the mask of each body, None if invisible. people: the masks of
    each untracked person. not_learned: the pixels (H, W) of people and possible people; None if there are
    none. foreign: points (N, 3) of other people and things beside the bodies, camera frame, metres.
    """

    image: View
    scene: SceneView
    bodies: tuple[MaskedView | None, ...]
    people: tuple[PersonMasks, ...]
    not_learned: Mask | None = None
    foreign: Points = field(default_factory=lambda: NO_POINTS)


@dataclass(frozen=True, slots=True, eq=False)
class UntrackedPerson:
    """The crop of a person who is not tracked.

    alternatives: the crop of the person with successively wider masks. body: the crop with only those pixels
    that look like a body; None if they are not known.
    """

    subject: SubjectFrame
    alternatives: tuple[SubjectFrame, ...] = ()
    body: SubjectFrame | None = None

    @property
    def widest(self) -> SubjectFrame:
        """The frame with the widest mask of the person."""
        return self.alternatives[-1] if self.alternatives else self.subject

    @property
    def is_confirmed(self) -> bool:
        """Whether colour confirms the person."""
        return self.subject.has_keypoints

    def by_camera(self) -> list[UntrackedPerson]:
        """The person in the image of one camera at a time, without alternatives."""
        bodies = {view.image.camera: view for view in (self.body.views if self.body else ())}
        people = list[UntrackedPerson]()
        for view in self.subject.views:
            own = bodies.get(view.image.camera)
            body = None if own is None else replace(self.subject, views=(own,))
            people.append(UntrackedPerson(replace(self.subject, views=(view,)), body=body))
        return people

    def with_keypoints(self, keypoints: Keypoints) -> UntrackedPerson:
        """The person with the keypoints that colour shows."""
        if not keypoints:
            return self
        alternatives = (with_keypoints(frame, keypoints) for frame in self.alternatives)
        body = None if self.body is None else with_keypoints(self.body, keypoints)
        return UntrackedPerson(with_keypoints(self.subject, keypoints), tuple(alternatives), body)


@dataclass(frozen=True, slots=True, eq=False)
class SegmentedFrame:
    """A segmented frame.

    subjects: one per body; None if nothing of the body is visible, or if it may be anywhere.
    set_aside: for each body, its crops from the cameras that are not used for it.
    duplicates: whether each body is a duplicate, because others explain everything visible of it.
    candidates: people who are not tracked, the most likely first; empty unless they were looked for.
    """

    frame: Frame
    subjects: tuple[SubjectFrame | None, ...]
    set_aside: tuple[SubjectFrame | None, ...]
    duplicates: tuple[bool, ...]
    candidates: tuple[UntrackedPerson, ...]
    views: tuple[SegmentedView, ...]

    def pixels(self, person_index: int) -> int:
        """Number of pixels that show the body with this index in the list."""
        subject = self.subjects[person_index]
        return 0 if subject is None else subject.pixels

    def planes(self, subject: SubjectFrame | None) -> Planes:
        """The planes that the camera with the largest part of a subject sees."""
        camera = None if subject is None else subject.largest.image.camera
        seen = (view.scene.planes for view in self.views if view.image.camera == camera)
        return next(seen, Planes())


class DetectedBody(NamedTuple):
    """A body that a search has just detected.

    searched: the candidate that was searched, in the last segmented frame or an earlier one. subject: the
    crop of the detected body in the same frame. vertices: (V, 3) of the body, rig frame, metres. others: the
    other people in the last frame.
    """

    searched: UntrackedPerson
    subject: SubjectFrame
    vertices: Array
    others: Sequence[SubjectFrame] = ()


@dataclass(frozen=True, slots=True, eq=False)
class BodyView:
    """What a frame shows of one body.

    candidate: the untracked person whose subject this is; None if it is that of the body. set_aside: the
    crops from the cameras that are not used for this body. is_own: the subject was segmented around the body,
    and is not a candidate. is_duplicate: others explain everything visible of the body. is_elsewhere: not
    where the body was expected. after_gap: the gap since the last frame is long, so the next frame is not
    segmented until this one has been refined. is_looked_at: the keypoint network has looked for this person
    in a trusted colour image. motion_m: the motion (3,) since the last pose according to colour; None if
    unknown. is_swapped: left and right in colour were swapped, to agree with the body.
    """

    frame: Frame
    subject: SubjectFrame | None
    planes: Planes
    candidate: UntrackedPerson | None = None
    set_aside: SubjectFrame | None = None
    is_own: bool = True
    is_duplicate: bool = False
    is_elsewhere: bool = False
    after_gap: bool = False
    is_looked_at: bool = False
    motion_m: Array | None = None
    is_swapped: bool = False


class Segmenter:
    """Segments frames in order, within a `scope`; a body gets `points` points, times its `points_factor`.

    Each camera has its own scene. A frame is learned after it has been segmented, before the next one.
    """

    def __init__(
        self,
        points: int,
        settings: SceneSettings,
        scope: Scope | None = None,
        network: BodyNetwork | None = None,
    ) -> None:
        self._points, self._settings = points, settings
        self._scope = scope or Scope()
        self._body_pixels = None if network is None else body_pixels_of(network)
        self._scenes = dict[str, Scene]()

    def restore(self, changes: SceneChanges) -> None:
        """Restore what was known after a frame by applying its changes.

        Those of all earlier frames must have been applied first.
        """
        for camera, change in changes.items():
            self._scene_of(camera, change.T_rig_camera, None).restore(change)

    def _scene_of(self, camera: str, T_rig_camera: Array, gravity: Array | None) -> Scene:
        """The scene of a camera, created in its first frame; `gravity` (3,) is as the camera measures it."""
        if camera not in self._scenes:
            scope, up = self._scope.of(camera), None if gravity is None else -gravity
            if scope.up is not None:
                up = T_rig_camera[:3, :3].T @ scope.up
            self._scenes[camera] = Scene(self._settings, scope.background, up)
        return self._scenes[camera]

    def segment(
        self, frame: Frame, bodies: Sequence[ExpectedSurface], *, rejected: bool = False, find: bool = True
    ) -> SegmentedFrame:
        """Segment the next frame: around bodies, and, with `find`, into other people.

        Other people are not added to the background, unless they have been `rejected` for a while and do not
        move. Without `find`, nothing is learned while a body may be anywhere.
        """
        expected = [self._expected_view(view, bodies) for view in frame.views]
        duplicates = self._find_duplicates(expected, bodies)
        views = tuple(
            self._segment_view(view, bodies, duplicates, rejected=rejected, find=find) for view in expected
        )
        subjects, set_aside = list[SubjectFrame | None](), list[SubjectFrame | None]()
        for n, body in enumerate(bodies):
            shown = [masked for view in views if (masked := view.bodies[n]) is not None]
            points = round(body.points_factor * self._points)
            used, unused = (
                subject_of(frame, [m for m in shown if (m.image.camera in body.excluded) == excluded], points)
                for excluded in (False, True)
            )
            subjects.append(used or unused)
            set_aside.append(None if used is None else unused)
        excluded_by_any = set[str]().union(*(body.excluded for body in bodies))
        used_views = [view for view in views if view.image.camera not in excluded_by_any]
        shows_people = any(view.people for view in used_views)
        people = self._join_people(frame, [view.people for view in (used_views if shows_people else views)])
        return SegmentedFrame(frame, tuple(subjects), tuple(set_aside), tuple(duplicates), people, views)

    def find_candidates(
        self, segmented: SegmentedFrame, tracked: Sequence[Array]
    ) -> tuple[UntrackedPerson, ...]:
        """People in a segmented frame, most likely first, without those at the vertices `tracked` (V, 3)."""
        masks_by_image = list[Sequence[PersonMasks]]()
        for segmented_view in segmented.views:
            image, view = segmented_view.image, segmented_view.scene
            if shows_one_body(view, len(segmented.subjects)):
                everything = whole_view(image)
                masks_by_image.append([] if everything is None else [PersonMasks((everything,))])
                continue
            distances = [measure_distances(view, image.to_camera(body)) for body in tracked]
            near_bodies = nearest_of(view, distances) <= self._settings.segmentation.near_m
            scope = self._scope.of(image.camera)
            people = scope.choose(view, find_candidates(view, near_bodies, self._body_pixels))
            masks_by_image.append([mask_candidate(image, view, person, near_bodies) for person in people])
        return self._join_people(segmented.frame, masks_by_image)

    def learn(self, segmented: SegmentedFrame, detected: Sequence[DetectedBody] = ()) -> SceneChanges:
        """Learn the scenes from the last segmented frame, and return what it changed in them.

        Pixels that were searched when the `detected` bodies were found are added to the background as well,
        unless these bodies cover them: they are theirs, or near and in the narrowest mask.
        """
        return {view.image.camera: self._learn_view(view, detected) for view in segmented.views}

    def _learn_view(self, view: SegmentedView, detected: Sequence[DetectedBody]) -> SceneChange:
        scene, name, depth = self._scenes[view.image.camera], view.image.camera, view.scene.depth
        change = scene.learn(view.scene, view.not_learned, view.foreign)
        for body in detected:
            searched_depth = depth_of(body.searched.widest, name, depth.shape)
            step_m = self._settings.segmentation.step_m
            things = (searched_depth > 0.0) & (abs(depth - searched_depth) < step_m)
            distances = measure_distances(view.scene, view.image.to_camera(body.vertices))
            near = distances <= self._settings.segmentation.near_m
            things &= ~(near & (depth_of(body.searched.subject, name, depth.shape) > 0.0))
            for subject in (body.subject, *body.others):
                things &= depth_of(subject, name, depth.shape) == 0.0
            change = scene.learn(view.scene, ~things, change.foreign, change.learned)
        return change

    def _expected_view(self, image: View, bodies: Sequence[ExpectedSurface]) -> ExpectedView:
        """One image of a frame with the bodies that are expected in it."""
        scene = self._scene_of(image.camera, image.T_rig_camera, image.gravity)
        image, out_of_scope = self._scope.of(image.camera).limit(image)
        view = scene.observe(image, out_of_scope)
        if shows_one_body(view, len(bodies)):
            return ExpectedView(image, view, [])
        return ExpectedView(image, view, [posed_surface(view, image, body) for body in bodies])

    def _find_duplicates(
        self, expected: Sequence[ExpectedView], bodies: Sequence[ExpectedSurface]
    ) -> list[bool]:
        """Which bodies are duplicates in the images of all cameras together."""
        if sum(body.vertices is not None for body in bodies) < 2:
            return [False] * len(bodies)
        evidence = [
            evidence_of(
                view.scene,
                [
                    None if shown is None or view.image.camera in body.excluded else shown.distances
                    for shown, body in zip(view.bodies, bodies, strict=True)
                ],
            )
            for view in expected
        ]
        followed_s = [body.followed_s for body in bodies]
        return find_duplicates(evidence, followed_s, self._settings.segmentation.min_own_share)

    def _segment_view(
        self,
        expected: ExpectedView,
        bodies: Sequence[ExpectedSurface],
        duplicates: Sequence[bool],
        *,
        rejected: bool,
        find: bool,
    ) -> SegmentedView:
        """Segment one image of a frame; duplicates get no pixels."""
        image, view = expected.image, expected.scene
        if not expected.bodies:
            everything = whole_view(image)
            if bodies[0].vertices is None:
                shown = [] if everything is None else [PersonMasks((everything,))]
                return SegmentedView(image, view, (None,), tuple(shown))
            return SegmentedView(image, view, (everything,), ())
        surfaces = [
            None if is_duplicate else body
            for body, is_duplicate in zip(expected.bodies, duplicates, strict=True)
        ]
        posed_bodies = [body for body in surfaces if body is not None]
        nearest = nearest_of(view, [body.distances for body in posed_bodies])
        near_bodies = nearest <= self._settings.segmentation.near_m
        nearest_new = nearest_of(view, [body.distances for body in posed_bodies if body.is_new])
        foreign = mark_foreign(view, nearest, nearest_new)
        foreign_points = points_beside(view, foreign, [body.vertices for body in posed_bodies])
        own, learns_nothing = segment_bodies(expected, surfaces, nearest, foreign)
        possible = find_candidates(view, near_bodies, self._body_pixels) if find else []
        learns_nothing |= not find and any(body.vertices is None for body in bodies)
        people = self._choose_people(expected, possible, near_bodies)
        moving = [person.widest for person in possible if not rejected or has_moved(view, person)]
        not_learned = reduce(np.logical_or, moving, near_bodies)
        if learns_nothing:  # the pixels of a body may be anywhere
            not_learned = np.ones_like(near_bodies)
        return SegmentedView(image, view, own, people, not_learned, foreign_points)

    def _choose_people(
        self, expected: ExpectedView, candidates: Sequence[Candidate], near_bodies: Mask
    ) -> tuple[PersonMasks, ...]:
        """The masks of the candidates for the selected person, the most likely first."""
        image, view = expected.image, expected.scene
        # colour tells which of several candidates is a person
        count = 1 if len(expected.bodies) == 1 and image.colours is None else None
        chosen = self._scope.of(image.camera).choose(view, candidates)[:count]
        return tuple(mask_candidate(image, view, person, near_bodies, self._body_pixels) for person in chosen)

    def _join_people(
        self, frame: Frame, masks_by_image: Sequence[Sequence[PersonMasks]]
    ) -> tuple[UntrackedPerson, ...]:
        """The people that the masks in all images show; masks at the same place are one person."""
        people, max_distance_m = list[list[PersonMasks]](), self._settings.candidates.same_person_m
        for in_image in masks_by_image:
            for masks in in_image:
                not_in_image = [
                    p for p in people if all(m.narrowest.image is not masks.narrowest.image for m in p)
                ]
                near = (person for person in not_in_image if distance_of(person, masks) < max_distance_m)
                same = min(near, key=lambda person: distance_of(person, masks), default=None)
                if same is None:
                    people.append([masks])
                else:
                    same.append(masks)
        joined = (self._person_of(frame, person) for person in people)
        return tuple(person for person in joined if person is not None)

    def _person_of(self, frame: Frame, images: Sequence[PersonMasks]) -> UntrackedPerson | None:
        """The person whom these masks, one group per image, show; None if they contain no depth."""
        by_image = [masks.hypotheses for masks in images]
        levels = range(max(map(len, by_image)))
        masked = [[masks[min(level, len(masks) - 1)] for masks in by_image] for level in levels]
        subject, *wider = [subject_of(frame, views, self._points) for views in masked]
        body = subject_of(frame, [masks.body for masks in images if masks.body is not None], self._points)
        return UntrackedPerson(subject, tuple(filter(None, wider)), body) if subject else None


def segment_bodies(
    expected: ExpectedView, surfaces: Sequence[PosedSurface | None], nearest: Depth, foreign: Mask
) -> tuple[tuple[MaskedView | None, ...], bool]:
    """The mask of each body, None without a surface, and whether the pixels of a body may be anywhere.

    nearest: distances (H, W) from the nearest body. foreign: pixels (H, W) of other people and things.
    """
    image, view = expected.image, expected.scene
    own = list[MaskedView | None]()
    may_be_anywhere = False
    for body in surfaces:
        if body is None:
            own.append(None)
            continue
        not_own = (body.distances > nearest) | foreign
        segmentation = segment_body(view, body.vertices, body.distances, not_own)
        own.append(masked_view(image, view, segmentation))
        may_be_anywhere |= is_missing(view, body.vertices, segmentation)
    return tuple(own), may_be_anywhere


def mask_candidate(
    image: View, view: SceneView, person: Candidate, near_bodies: Mask, body_pixels: BodyPixels | None = None
) -> PersonMasks:
    """The masks of a candidate in an image; `near_bodies` (H, W) are the pixels near tracked bodies.

    Where something is flat, `body_pixels` tells which of the pixels show a body.
    """
    asked = body_pixels is not None and has_flat_side(view, person.part)
    found = body_pixels(view, person.widest) > LIKELY if body_pixels is not None and asked else None
    body = [found] if found is not None and is_large(view, found) else []
    segmented = segment_masks(view, [*body, person.mask, *person.wider], near_bodies)
    masked = tuple(masked_view(image, view, each) for each in segmented)
    return PersonMasks(masked[len(body) :], masked[0] if body else None)


def is_large(view: SceneView, mask: Mask) -> bool:
    """Whether pixels (H, W) are enough for a person."""
    area_m2 = area_of(view, points_of(view.depth, view.intrinsics, mask))
    return area_m2 >= view.settings.segmentation.min_person_m2


def body_pixels_of(network: BodyNetwork) -> BodyPixels:
    """A function that asks the network how likely pixels show a body."""

    def probabilities(view: SceneView, mask: Mask) -> Depth:
        foreground, down = view.marks == FOREGROUND, view.planes.level[1, :2]
        found = network.probabilities(view.depth, view.intrinsics, mask, foreground, down)
        return np.where(mask, found, np.float32(0.0))

    return probabilities


def shows_one_body(view: SceneView, body_count: int) -> bool:
    """Whether an image shows nothing but the one tracked body."""
    return not view.shows_room and body_count == 1


def posed_surface(view: SceneView, image: View, body: ExpectedSurface) -> PosedSurface | None:
    """The body in an image; None if it may be anywhere."""
    if body.vertices is None:
        return None
    vertices = image.to_camera(body.vertices)
    return PosedSurface(vertices, measure_distances(view, vertices), body.is_new)


def masked_view(image: View, view: SceneView, segmentation: Segmentation) -> MaskedView:
    """What an image shows of a subject; the longer a surface has been there, the less its points weigh."""
    weights = None
    if (permanence := view.permanence(segmentation.window)) is not None:
        weights = np.maximum(1.0 - permanence, view.settings.segmentation.permanent_weight)
    return MaskedView(image, segmentation.window, segmentation.labels, weights)


def distance_of(person: Sequence[PersonMasks], masks: PersonMasks) -> float:
    """Distance in metres between a person's masks in their first image and masks in another image."""
    return distance_between(person[0].narrowest, masks.narrowest)


def distance_between(first: MaskedView, second: MaskedView) -> float:
    """Distance in metres between the centres of what two images show."""
    centres = []
    for masked in (first, second):
        image, (left, top, right, bottom) = masked.image, masked.window
        camera = image.intrinsics.crop(left, top, right - left, bottom - top)
        depth = depth_in(masked) / image.depth_scale
        centres.append(image.to_rig(np.median(points_of(depth, camera, depth > 0.0), axis=0)))
    return float(np.linalg.norm(centres[0] - centres[1]))
