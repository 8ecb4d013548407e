"""Finds the keypoints of tracked people in the colour images of a frame, on a thread of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.body import KEYPOINTS, ROOT_DOFS, BodyModel
from gepf.common.camera import points_of, project
from gepf.common.frame import DepthFrame, SubjectFrame
from gepf.common.kinematics import joint_positions, keypoint_positions, pose_vertices
from gepf.common.refinement import KEYPOINT_OUTLIER
from gepf.coordinator.colour.crop import Crop, crop_of_body, crop_of_points
from gepf.coordinator.colour.inverse_kinematics import fit_keypoints
from gepf.coordinator.colour.keypoints import find_keypoints
from gepf.coordinator.colour.network import PoseNetwork

LEAST_POINTS = 100  # of a candidate
OTHER_SIDE = {"left": "right", "right": "left"}
MIRRORED = [
    KEYPOINTS.index("_".join(OTHER_SIDE.get(part, part) for part in name.split("_"))) for name in KEYPOINTS
]
"""The keypoint on the other side, for each."""

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

    def look_at(self, subject: SubjectFrame, frame: DepthFrame, up: Array) -> Keypoints:
        """The keypoints of a candidate in a frame, if the network sees a person there, and on its pixels.

        `up` (3,) is the upward direction in the frame of the candidate's main camera. No other camera looks.
        """
        view = next(each for each in frame.views if each.camera == subject.frame.camera)
        points = points_of(subject.frame.metres(), subject.frame.intrinsics, subject.frame.depth > 0)
        if view.colours is None or len(points) < LEAST_POINTS:
            return {}
        crop = crop_of_points(points, up, view.intrinsics)
        keypoints = find_keypoints(self._network, view.colours, view.depth > 0, crop)
        return {view.camera: keypoints} if keypoints is not None and is_on(subject, keypoints) else {}

    def _look(self, frame: DepthFrame, body: ExpectedBody | None) -> Keypoints:
        found = dict[str, NDArray[np.float32]]()
        for view in frame.views if body is not None else ():
            crop = None if view.colours is None else crop_of(body, view)
            if crop is not None and view.colours is not None:
                keypoints = find_keypoints(self._network, view.colours, view.depth > 0, crop)
                if keypoints is not None:
                    found[view.camera] = keypoints
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


def is_on(subject: SubjectFrame, keypoints: NDArray[np.float32]) -> bool:
    """Whether at least half of the more precise keypoints (17, 3) of an image are on a subject's pixels."""
    mine, (height, width) = in_crop(subject, keypoints), subject.frame.depth.shape
    precise = mine[mine[:, 2] >= np.median(mine[:, 2])]
    column, row = np.rint(precise[:, :2]).astype(int).T
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    on = subject.frame.depth[row[inside], column[inside]] > 0
    return bool(2 * np.count_nonzero(on) >= len(precise))


def fitted_poses(body: ExpectedBody | None, found: Keypoints, frame: DepthFrame) -> Array:
    """Poses (F, D) that keypoints suggest: near the expected one, from rest, and of the other side.

    The keypoints are those of the camera that sees most. None (0, D) without keypoints.
    """
    if body is None or not found:
        return np.empty((0, 0 if body is None else len(body.pose)))
    view = max(
        (each for each in frame.views if each.camera in found),
        key=lambda each: float(np.sum(found[each.camera][:, 2])),
    )
    seen = found[view.camera].astype(np.float64)
    near = fit_keypoints(body.model, body.pose, seen, view)
    rest = np.where(np.isin(body.model.dof_names, ROOT_DOFS) | ~body.model.moves, near, 0.0)
    starts = ((rest, seen), (near, seen[MIRRORED]))
    others = [fit_keypoints(body.model, start, places, view) for start, places in starts]
    return np.stack([near, *others])


def with_keypoints(subject: SubjectFrame | None, found: Keypoints) -> SubjectFrame | None:
    """The subject of a frame with the keypoints of its cameras, in pixels of its crops."""
    if subject is None or not found:
        return subject
    first, *others = (
        replace(each, keypoints=in_crop(each, found[each.frame.camera]))
        if each.frame.camera in found
        else each
        for each in subject.views
    )
    wider = (with_keypoints(each, found) for each in subject.wider)
    return replace(first, others=tuple(others), wider=tuple(each for each in wider if each is not None))


def in_crop(subject: SubjectFrame, keypoints: NDArray[np.float32]) -> NDArray[np.float32]:
    """Keypoints of the whole image (17, 3) in pixels of a crop."""
    moved: NDArray[np.float32] = keypoints + np.array([*subject.view[:2], 0.0], np.float32)
    return moved


def in_image(subject: SubjectFrame) -> Keypoints:
    """The keypoints of a subject in pixels of the whole images."""
    return {
        each.frame.camera: each.keypoints - np.array([*each.view[:2], 0.0], np.float32)
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
