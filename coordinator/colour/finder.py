"""Finds the keypoints of tracked people in the colour images of a frame, on a thread of its own."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from gepf.common.arrays import Array
from gepf.common.body import KEYPOINTS, BodyModel
from gepf.common.camera import points_of, project
from gepf.common.frame import Frame, SubjectFrame, SubjectView, View
from gepf.common.kinematics import keypoint_positions, pose_vertices
from gepf.common.packages import MissingPackage
from gepf.common.refinement import KEYPOINT_OUTLIER, KEYPOINT_WEIGHT
from gepf.coordinator.colour.crop import Crop, crop_of_body, crop_of_points
from gepf.coordinator.colour.keypoints import HIPS, SHOULDERS, find_keypoints
from gepf.coordinator.colour.network import PoseNetwork, check_installed

SAME_PERSON = 3.0  # median distance of keypoints, in deviations
CANDIDATES_PER_S = 40.0  # that are looked at: half of the time of a processor core
NEAR_PX = 3  # to which keypoints at an outline may be off it
TRUNK_M = 0.2  # thickness of a trunk: the mean distance of two people's keypoints is above it

SIDES = {"left": "right", "right": "left"}
EXCHANGED = [
    KEYPOINTS.index("_".join(SIDES.get(part, part) for part in name.split("_"))) for name in KEYPOINTS
]
"""The place of each keypoint with left and right exchanged."""

Keypoints = Mapping[str, NDArray[np.float32]]
"""Keypoints (17, 3) of a person in the image of each camera: column, row, inverse variance (1 / pixels^2)."""


class ExpectedBody(NamedTuple):
    """Where a person is expected in a frame."""

    model: BodyModel
    pose: Array  # (D,)


def without_colour(missing: MissingPackage) -> str:
    """What to say if the extra `color` is not installed."""
    return f"colour is not used, which corrects many limbs, and exchanged left and right: {missing}"


class Sight(NamedTuple):
    """What colour shows of people: the keypoints of each, and who follows the person of another body."""

    keypoints: Sequence[Keypoints]
    doubles: Sequence[bool]
    looked_in: Sequence[Collection[str]]  # the cameras in which each person was looked for
    candidates: Mapping[int, Keypoints] = MappingProxyType(
        {}
    )  # of candidates in the frame that were looked at, by place

    @classmethod
    def of_nobody(cls, people: int) -> Self:
        """Without colour."""
        return cls([{}] * people, [False] * people, [()] * people)


class KeypointFinder:
    """Looks at each person once in each image, one after another.

    Raises MissingPackage if the extra `color` is not installed.
    """

    def __init__(self) -> None:
        check_installed()
        self.left_out = 0  # frames, for want of time
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="keypoints")

    @cached_property
    def _network(self) -> PoseNetwork:
        return PoseNetwork()

    def prepare(self) -> None:
        """Load the network, which the first frame with colour would else wait for."""
        self._thread.submit(lambda: self._network).result()

    def leave_out(self, frame: Frame, bodies: Sequence[ExpectedBody | None]) -> bool:
        """Count a frame that is not looked at for want of time; whether there was anything to look at."""
        is_of_use = any(view.colours is not None for view in frame.views) and any(bodies)
        self.left_out += is_of_use
        return is_of_use

    def submit(self, frame: Frame, bodies: Sequence[ExpectedBody | None]) -> Future[Sight]:
        """Begin to look for people, each around an expected body; without one, or without colour: nothing."""

        def look() -> Sight:
            seen = [self._look(frame, body) for body in bodies]
            given = assign(bodies, seen, frame)
            looked_in = [
                [
                    view.camera
                    for view in frame.views
                    if body is not None and would_show(body, view, around, given)
                ]
                for body, around in zip(bodies, seen, strict=True)
            ]
            return Sight(given, find_doubles(bodies, seen, given), looked_in)

        return self._thread.submit(look)

    def look_at(
        self,
        candidates: Sequence[tuple[SubjectFrame, SubjectFrame]],
        frame: Frame,
        upward: Mapping[str, Array],
        interval_s: float,
    ) -> dict[int, Keypoints]:
        """The keypoints of some candidates, by their place; none where the network sees no person.

        Each has its turn, as many in a frame as the `interval_s` since the one before allows; in the first
        frame all. A candidate is what shows it, and all that may show it. `upward` (3,) are directions in the
        camera's frame, by its name.
        """

        def look(subject: SubjectFrame, widest: SubjectFrame) -> Keypoints:
            shown = dict[str, NDArray[np.float32]]()
            images = {view.camera: view for view in frame.views}
            whole = {view.image.camera: view for part in (subject, widest) for view in part.views}
            for view in subject.views:
                image = images[view.image.camera]
                points = points_of(view.image.metres(), view.image.intrinsics, view.image.depth > 0)
                if image.colours is None or not len(points):
                    continue
                crop = crop_of_points(points, upward[image.camera], image.intrinsics)
                keypoints = find_keypoints(self._network, image.colours, image.depth > 0, crop)
                if keypoints is not None and are_on(whole[image.camera], keypoints):
                    shown[image.camera] = keypoints
            return shown

        count = len(candidates)
        most = min(count, max(1, round(CANDIDATES_PER_S * interval_s))) if interval_s > 0.0 else count
        turns = [(frame.number * most + n) % count for n in range(most)]
        return self._thread.submit(lambda: {turn: look(*candidates[turn]) for turn in turns}).result()

    def _look(self, frame: Frame, body: ExpectedBody | None) -> Keypoints:
        found = dict[str, NDArray[np.float32]]()
        for view in frame.views if body is not None else ():
            crop = None if view.colours is None else crop_of(body, view)
            if crop is not None and view.colours is not None:
                keypoints = find_keypoints(self._network, view.colours, view.depth > 0, crop)
                if keypoints is not None:
                    found[view.camera] = keypoints
        return found


def would_show(body: ExpectedBody, view: View, around: Keypoints, given: Sequence[Keypoints]) -> bool:
    """Whether a colour image that was looked at would show a body, with the keypoints seen `around` it.

    Not if they are those that another body is `given`: that person may hide it.
    """
    if view.colours is None or crop_of(body, view) is None:
        return False
    seen = around.get(view.camera)
    owners = (own[view.camera] for own in given if view.camera in own)
    return seen is None or not any(
        seen is not own and distance_of(seen[:, :2], own) < SAME_PERSON for own in owners
    )


def assign(bodies: Sequence[ExpectedBody | None], seen: Sequence[Keypoints], frame: Frame) -> list[Keypoints]:
    """Keypoints of bodies: each person in an image is that of the nearest body, and a body is one person.

    Around a body that is hidden or wrong, the network may see another person, who may be another body.
    """
    given = [dict[str, NDArray[np.float32]]() for _ in bodies]
    for view in frame.views:
        people = [keypoints[view.camera] for keypoints in seen if view.camera in keypoints]
        places = [None if body is None else keypoint_pixels(body, view) for body in bodies]
        away = {
            (b, p): distance_of(place, person)
            for b, place in enumerate(places)
            for p, person in enumerate(people)
            if place is not None
        }
        free, taken = set(range(len(bodies))), list[NDArray[np.float32]]()
        for b, p in sorted(away, key=away.__getitem__):
            is_taken = any(distance_of(people[p][:, :2], other) < SAME_PERSON for other in taken)
            if b in free and not is_taken:
                given[b][view.camera] = people[p]
                free.remove(b)
                taken.append(people[p])
    return list[Keypoints](given)


def find_doubles(
    bodies: Sequence[ExpectedBody | None], seen: Sequence[Keypoints], given: Sequence[Keypoints]
) -> list[bool]:
    """Whether bodies are where another one is, and the person whom the network saw there is that one's."""
    places = [None if body is None else keypoint_positions(body.model, body.pose[None])[0] for body in bodies]

    def is_double(mine: int, other: int) -> bool:
        a, b = places[mine], places[other]
        return (
            a is not None
            and b is not None
            and float(np.linalg.norm(a - b, axis=1).mean()) < TRUNK_M
            and any(
                camera not in given[mine]
                and camera in given[other]
                and distance_of(keypoints[:, :2], given[other][camera]) < SAME_PERSON
                for camera, keypoints in seen[mine].items()
            )
        )

    people = range(len(bodies))
    return [any(is_double(mine, other) for other in people if other != mine) for mine in people]


def keypoint_pixels(body: ExpectedBody, view: View) -> Array:
    """Where the keypoints (17, 2) of a body are in an image, if it is before the camera."""
    places = view.to_camera(keypoint_positions(body.model, body.pose[None])[0])
    return project(places, view.intrinsics)


def distance_of(pixels: NDArray[np.floating], keypoints: NDArray[np.float32]) -> float:
    """The median distance of pixels (17, 2) from keypoints, in their deviations."""
    return float(np.median(deviations_of(pixels, keypoints)))


def deviations_of(pixels: NDArray[np.floating], keypoints: NDArray[np.float32]) -> Array:
    """The distance of each pixel (17, 2) from its keypoint, in deviations of the keypoint."""
    off = np.linalg.norm(pixels - keypoints[:, :2], axis=1)
    return np.asarray(off * np.sqrt(keypoints[:, 2]))


def crop_of(body: ExpectedBody | None, view: View) -> Crop | None:
    """The crop around a person in an image; None if the person is not expected in it."""
    if body is None:
        return None
    model, pose = body.model, body.pose[None]
    keypoints = view.to_camera(keypoint_positions(model, pose)[0])
    hips, shoulders = (keypoints[pair].mean(axis=0) for pair in (HIPS, SHOULDERS))
    vertices = view.to_camera(pose_vertices(model, pose)[0])
    crop = crop_of_body(vertices, hips, shoulders, view.intrinsics)
    return crop if crop is not None and crop.overlaps(view.depth.shape) else None


def with_keypoints(subject: SubjectFrame | None, found: Keypoints) -> SubjectFrame | None:
    """The subject of a frame with the keypoints of its cameras, in pixels of its crops."""
    if subject is None or not found:
        return subject
    views = (
        replace(view, keypoints=in_crop(view, found[view.image.camera]))
        if view.image.camera in found
        else view
        for view in subject.views
    )
    return replace(subject, views=tuple(views))


def without_keypoints(subject: SubjectFrame | None, cameras: Collection[str]) -> SubjectFrame | None:
    """The subject of a frame without the keypoints of these cameras."""
    if subject is None:
        return None
    views = (
        replace(view, keypoints=None) if view.image.camera in cameras else view for view in subject.views
    )
    return replace(subject, views=tuple(views))


def with_sides_of(subject: SubjectFrame | None, body: ExpectedBody) -> SubjectFrame | None:
    """The subject with left and right keypoints exchanged where only that fits a body whose facing is known.

    Networks exchange left and right of people seen from behind or poorly; a body does not turn in a frame.
    """
    if subject is None or all(view.keypoints is None for view in subject.views):
        return subject

    def sided(view: SubjectView) -> SubjectView:
        if view.keypoints is None:
            return view
        pixels, exchanged = keypoint_pixels(body, view.image), view.keypoints[EXCHANGED]
        is_exchanged = distance_of(pixels, exchanged) < SAME_PERSON < distance_of(pixels, view.keypoints)
        return replace(view, keypoints=exchanged) if is_exchanged else view

    views = tuple(map(sided, subject.views))
    if all(after is before for after, before in zip(views, subject.views, strict=True)):
        return subject  # as it was sent to the workers
    return replace(subject, views=views)


def are_on(view: SubjectView, keypoints: NDArray[np.float32]) -> bool:
    """Whether most keypoints that a network sees are on the pixels of a subject, and not on those of others.

    They weigh by their precision; those outside of the image are of no account.
    """
    left, top, right, bottom = view.extent
    places = in_crop(view, keypoints)
    columns, rows = np.rint(places[:, 0]).astype(int), np.rint(places[:, 1]).astype(int)
    in_image = (left <= columns) & (columns < right) & (top <= rows) & (rows < bottom)
    shape = view.image.depth.shape
    in_window = (columns >= 0) & (columns < shape[1]) & (rows >= 0) & (rows < shape[0])
    on = np.zeros(len(places), dtype=np.bool_)
    near = binary_dilation(view.image.depth > 0, iterations=NEAR_PX)
    on[in_window] = near[rows[in_window], columns[in_window]]
    weights = np.where(in_image, places[:, 2], 0.0)
    return bool(weights @ on > 0.5 * weights.sum())


def in_crop(view: SubjectView, keypoints: NDArray[np.float32]) -> NDArray[np.float32]:
    """Keypoints of the whole image (17, 3) in pixels of a crop."""
    moved: NDArray[np.float32] = keypoints + np.array([*view.extent[:2], 0.0], np.float32)
    return moved


def in_image(subject: SubjectFrame) -> Keypoints:
    """The keypoints of a subject in pixels of the whole images."""
    return {
        view.image.camera: view.keypoints - np.array([*view.extent[:2], 0.0], np.float32)
        for view in subject.views
        if view.keypoints is not None
    }


def is_shown(model: BodyModel, pose: Array, subject: SubjectFrame, *, looked_at: bool) -> bool | None:
    """Whether colour shows a person in this pose (D,), whichever way the person faces.

    False only if colour that shows people was `looked_at`; None if it does not tell.
    """
    body = ExpectedBody(model, pose)
    for view in subject.views:
        if view.keypoints is not None:
            pixels = keypoint_pixels(body, view.image)
            sides = view.keypoints, view.keypoints[EXCHANGED]
            if min(distance_of(pixels, keypoints) for keypoints in sides) < SAME_PERSON:
                return True
    return False if looked_at else None


def shown_sides(model: BodyModel, pose: Array, subject: SubjectFrame) -> int:
    """1 if keypoints show left and right as in this pose (D,), -1 if exchanged, 0 if they do not tell."""
    for view in subject.views:
        if view.keypoints is not None:
            pixels = keypoint_pixels(ExpectedBody(model, pose), view.image)
            sides = distance_of(pixels, view.keypoints), distance_of(pixels, view.keypoints[EXCHANGED])
            if min(sides) < SAME_PERSON < max(sides):
                return 1 if sides[0] < sides[1] else -1
    return 0


def keypoint_cost(model: BodyModel, pose: Array, subject: SubjectFrame) -> float:
    """The part of minus the log posterior of a pose (D,) that is due to keypoints, nats.

    Depth alone decides whether a body is accepted.
    """
    total, scale = 0.0, KEYPOINT_OUTLIER**2
    for view in subject.views:
        if view.keypoints is not None and len(model.keypoint_links):
            places = view.image.to_camera(keypoint_positions(model, pose[None])[0])
            ahead, seen = places[:, 2] > 0.0, view.keypoints.astype(np.float64)
            squared = np.full(len(places), np.inf)
            off = project(places[ahead], view.image.intrinsics) - seen[ahead, :2]
            squared[ahead] = seen[ahead, 2] * np.sum(off**2, axis=1)
            farther = np.where(np.isfinite(squared), scale * squared / (scale + squared), scale)
            total += 0.5 * float(np.sum(farther[seen[:, 2] > 0.0]))
    return KEYPOINT_WEIGHT * total
