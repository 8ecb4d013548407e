"""Compares keypoints in images with bodies: where they are, whose they are, and which side is left."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from gepf.common.arrays import Array
from gepf.common.body import KEYPOINTS, BodyModel
from gepf.common.camera import project
from gepf.common.frame import Frame, SubjectFrame, SubjectView, View
from gepf.common.kinematics import keypoint_positions
from gepf.common.refinement import KEYPOINT_OUTLIER, KEYPOINT_WEIGHT
from gepf.coordinator.settings import ColourSettings

SIDES = {"left": "right", "right": "left"}
EXCHANGED = [
    KEYPOINTS.index("_".join(SIDES.get(part, part) for part in name.split("_"))) for name in KEYPOINTS
]
"""The index of each keypoint with left and right swapped."""

Keypoints = Mapping[str, NDArray[np.float32]]
"""Keypoints (17, 3) of a person in the image of each camera: column, row, inverse variance (1 / pixels^2)."""


@dataclass(frozen=True, eq=False)
class ExpectedBody:
    """A person in a pose (D,)."""

    model: BodyModel
    pose: Array

    @cached_property
    def keypoints(self) -> Array:
        """Where the keypoints (17, 3) of the body are, metres, frame of the rig."""
        return np.asarray(keypoint_positions(self.model, self.pose[None])[0])

    def pixels(self, view: View) -> Array:
        """The pixels of the keypoints in an image (17, 2), if the body is in front of the camera."""
        return project(view.to_camera(self.keypoints), view.intrinsics)


class Match(NamedTuple):
    """How keypoints in images compare with those of a body.

    is_confirmed: the keypoints are where the body is, whichever way the person faces. sides: 1 if they show
    left and right as the body does, -1 if swapped, 0 if they do not tell.
    """

    is_confirmed: bool
    sides: int


NO_MATCH = Match(is_confirmed=False, sides=0)
"""Without keypoints."""


def match_sides(body: ExpectedBody, subject: SubjectFrame, settings: ColourSettings) -> Match:
    """Compare the keypoints of a subject with a body."""
    is_confirmed, farthest = False, settings.same_person_deviations
    for view in subject.views:
        if view.keypoints is not None:
            pixels = body.pixels(view.image)
            as_is, exchanged = (
                distance_of(pixels, view.keypoints[order]) for order in (slice(None), EXCHANGED)
            )
            is_confirmed |= min(as_is, exchanged) < farthest
            if min(as_is, exchanged) < farthest < max(as_is, exchanged):
                return Match(is_confirmed, 1 if as_is < exchanged else -1)
    return Match(is_confirmed, 0)


def distance_of(pixels: NDArray[np.floating], keypoints: NDArray[np.float32]) -> float:
    """The median distance of pixels (17, 2) from keypoints, in standard deviations of the keypoints."""
    return float(np.median(deviations_of(pixels, keypoints)))


def deviations_of(pixels: NDArray[np.floating], keypoints: NDArray[np.float32]) -> Array:
    """The distance of each pixel (17, 2) from its keypoint, in standard deviations of the keypoint."""
    off = np.linalg.norm(pixels - keypoints[:, :2], axis=1)
    return np.asarray(off * np.sqrt(keypoints[:, 2]))


def assign(
    bodies: Sequence[ExpectedBody | None], seen: Sequence[Keypoints], frame: Frame, settings: ColourSettings
) -> list[Keypoints]:
    """Assign keypoints to bodies: each person in an image to the nearest body, and at most one to each body.

    Around a body that is hidden or wrong, the network may see another person, who may be another body.
    """
    assigned = [dict[str, NDArray[np.float32]]() for _ in bodies]
    for view in frame.views:
        people = [keypoints[view.camera] for keypoints in seen if view.camera in keypoints]
        places = [None if body is None else body.pixels(view) for body in bodies]
        away = {
            (b, p): distance_of(place, person)
            for b, place in enumerate(places)
            for p, person in enumerate(people)
            if place is not None
        }
        free, taken = set(range(len(bodies))), list[NDArray[np.float32]]()
        for b, p in sorted(away, key=away.__getitem__):
            if b in free and not any(is_same_person(people[p], other, settings) for other in taken):
                assigned[b][view.camera] = people[p]
                free.remove(b)
                taken.append(people[p])
    return list[Keypoints](assigned)


def is_same_person(first: NDArray[np.float32], second: NDArray[np.float32], settings: ColourSettings) -> bool:
    """Whether two sets of keypoints (17, 3) in an image belong to one person."""
    return distance_of(first[:, :2], second) < settings.same_person_deviations


def is_another_person(
    seen: NDArray[np.float32] | None, camera: str, assigned: Sequence[Keypoints], settings: ColourSettings
) -> bool:
    """Whether keypoints `seen` around a body in a camera's image are assigned to another body."""
    owners = (own[camera] for own in assigned if camera in own)
    return seen is not None and any(seen is not own and is_same_person(seen, own, settings) for own in owners)


def with_keypoints(subject: SubjectFrame, keypoints: Keypoints) -> SubjectFrame:
    """The subject of a frame with the keypoints of its cameras, in pixels of its crops."""
    if not keypoints:
        return subject
    views = (
        replace(view, keypoints=in_crop(view, keypoints[view.image.camera]))
        if view.image.camera in keypoints
        else view
        for view in subject.views
    )
    return replace(subject, views=tuple(views))


def without_keypoints(subject: SubjectFrame, cameras: Collection[str]) -> SubjectFrame:
    """The subject of a frame without the keypoints of these cameras."""
    views = (
        replace(view, keypoints=None) if view.image.camera in cameras else view for view in subject.views
    )
    return replace(subject, views=tuple(views))


def with_sides_of(subject: SubjectFrame, body: ExpectedBody, settings: ColourSettings) -> SubjectFrame:
    """The subject with left and right keypoints swapped where they fit the body only that way.

    Networks swap left and right of people seen from behind or poorly; a body does not turn in a frame.
    """
    views, farthest = list[SubjectView](), settings.same_person_deviations
    for view in subject.views:
        if view.keypoints is not None:
            pixels, exchanged = body.pixels(view.image), view.keypoints[EXCHANGED]
            if distance_of(pixels, exchanged) < farthest < distance_of(pixels, view.keypoints):
                views.append(replace(view, keypoints=exchanged))
                continue
        views.append(view)
    if all(after is before for after, before in zip(views, subject.views, strict=True)):
        return subject  # the same that was sent to the workers
    return replace(subject, views=tuple(views))


def are_on(view: SubjectView, keypoints: NDArray[np.float32], outline_px: int) -> bool:
    """Whether most keypoints that a network sees are on the pixels of a subject, and not on other pixels.

    Keypoints are weighted by their precision; those outside the image do not count. A keypoint is on pixels
    that are up to `outline_px` away.
    """
    left, top, right, bottom = view.extent
    places = in_crop(view, keypoints)
    columns, rows = np.rint(places[:, 0]).astype(int), np.rint(places[:, 1]).astype(int)
    in_image = (left <= columns) & (columns < right) & (top <= rows) & (rows < bottom)
    shape = view.image.depth.shape
    in_window = (columns >= 0) & (columns < shape[1]) & (rows >= 0) & (rows < shape[0])
    on = np.zeros(len(places), dtype=np.bool_)
    near = binary_dilation(view.image.depth > 0, iterations=outline_px)
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


def keypoint_cost(body: ExpectedBody, subject: SubjectFrame) -> float:
    """The keypoint term of the negative log posterior of a body in a pose, nats.

    It does not count when a body is accepted or rejected: depth alone decides.
    """
    total, scale = 0.0, KEYPOINT_OUTLIER**2
    for view in subject.views:
        if view.keypoints is not None and len(body.model.keypoint_links):
            places = view.image.to_camera(body.keypoints)
            ahead, seen = places[:, 2] > 0.0, view.keypoints.astype(np.float64)
            squared = np.full(len(places), np.inf)
            off = project(places[ahead], view.image.intrinsics) - seen[ahead, :2]
            squared[ahead] = seen[ahead, 2] * np.sum(off**2, axis=1)
            farther = np.where(np.isfinite(squared), scale * squared / (scale + squared), scale)
            total += 0.5 * float(np.sum(farther[seen[:, 2] > 0.0]))
    return KEYPOINT_WEIGHT * total
