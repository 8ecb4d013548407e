"""Finds the keypoints of tracked people in the colour images of a frame, on a thread of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.camera import project
from gepf.common.frame import DepthFrame, SubjectFrame
from gepf.common.kinematics import joint_positions, keypoint_positions, pose_vertices
from gepf.common.refinement import KEYPOINT_OUTLIER
from gepf.coordinator.colour.crop import Crop, crop_of_body
from gepf.coordinator.colour.keypoints import find_keypoints
from gepf.coordinator.colour.network import PoseNetwork

Keypoints = Mapping[str, NDArray[np.float32]]
"""Keypoints (17, 3) of a person in the image of each camera: column, row, inverse variance (1 / pixels^2)."""


class ExpectedBody(NamedTuple):
    """Where a person is expected in a frame."""

    model: BodyModel
    pose: Array  # (D,)


class KeypointFinder:
    """Looks at each person once in each image, one after another.

    Raises MissingPackage if the extra `color` is not installed.
    """

    def __init__(self) -> None:
        self._network = PoseNetwork()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="keypoints")

    def submit(self, frame: DepthFrame, bodies: Sequence[ExpectedBody | None]) -> Future[list[Keypoints]]:
        """Begin to look for people, each around an expected body; without one, or without colour: nothing."""
        return self._thread.submit(lambda: [self._look(frame, each) for each in bodies])

    def _look(self, frame: DepthFrame, body: ExpectedBody | None) -> Keypoints:
        found = dict[str, NDArray[np.float32]]()
        for view in frame.views if body is not None else ():
            crop = None if view.colours is None else crop_of(body, view)
            if crop is not None and view.colours is not None:
                person = find_keypoints(self._network, view.colours, view.depth > 0, crop)
                if person is not None:
                    found[view.camera] = person.keypoints
        return found


def crop_of(body: ExpectedBody | None, view: DepthFrame) -> Crop | None:
    """The crop around a person in an image; None if the person is not expected in it."""
    if body is None:
        return None
    model, pose = body.model, body.pose[None]
    joints = dict(zip(model.joint_names, view.to_camera(joint_positions(model, pose)[0]), strict=True))
    hips = 0.5 * (joints["right_hip"] + joints["left_hip"])
    vertices = view.to_camera(pose_vertices(model, pose)[0])
    crop = crop_of_body(vertices, hips, joints["neck"], view.intrinsics)
    return crop if crop is not None and crop.overlaps(view.depth.shape) else None


def with_keypoints(subject: SubjectFrame | None, found: Keypoints) -> SubjectFrame | None:
    """The subject of a frame with the keypoints of its cameras, in pixels of its crops."""
    if subject is None or not found:
        return subject
    seen = (in_crop(each, found.get(each.frame.camera)) for each in subject.views)
    pairs = zip(subject.views, seen, strict=True)
    first, *others = (replace(each, keypoints=keypoints) for each, keypoints in pairs)
    return replace(first, others=tuple(others))


def in_crop(subject: SubjectFrame, keypoints: NDArray[np.float32] | None) -> NDArray[np.float32] | None:
    """Keypoints of the whole image (17, 3) in pixels of a crop."""
    if keypoints is None:
        return None
    moved: NDArray[np.float32] = keypoints + np.float32([subject.view[0], subject.view[1], 0.0])
    return moved


def in_image(subject: SubjectFrame) -> Keypoints:
    """The keypoints of a subject in pixels of the whole images."""
    return {
        each.frame.camera: each.keypoints - np.float32([each.view[0], each.view[1], 0.0])
        for each in subject.views
        if each.keypoints is not None
    }


def keypoint_cost(model: BodyModel, pose: Array, subject: SubjectFrame) -> float:
    """The part of minus the log posterior of a pose (D,) that is due to keypoints, nats.

    Depth alone decides whether a body is accepted.
    """
    total, scale = 0.0, KEYPOINT_OUTLIER**2
    for view in subject.views:
        if view.keypoints is not None and len(model.keypoint_links):
            places = view.frame.to_camera(keypoint_positions(model, pose[None])[0])
            ahead, seen = places[:, 2] > 0.0, view.keypoints.astype(np.float64)
            squared = np.full(len(places), np.inf)
            off = project(places[ahead], view.frame.intrinsics) - seen[ahead, :2]
            squared[ahead] = seen[ahead, 2] * np.sum(off**2, axis=1)
            farther = np.where(np.isfinite(squared), scale * squared / (scale + squared), scale)
            total += 0.5 * float(np.sum(farther[seen[:, 2] > 0.0]))
    return total
