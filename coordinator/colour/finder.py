"""Finds the keypoints of people in the colour images of a frame, beside the thread of the tracker."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.camera import points_of
from gepf.common.frame import Frame, SubjectFrame, View
from gepf.common.kinematics import pose_vertices
from gepf.common.nearest_pixels import nearest_occupied_pixels
from gepf.common.packages import MissingPackage
from gepf.coordinator.colour.crop import Crop, crop_of_body, crop_of_points
from gepf.coordinator.colour.keypoints import HIPS, SHOULDERS, find_keypoints
from gepf.coordinator.colour.matching import ExpectedBody, Keypoints, are_on, assign, is_another_person
from gepf.coordinator.colour.network import PoseNetwork, check_installed
from gepf.coordinator.settings import ColourSettings


def without_colour(missing: MissingPackage) -> str:
    """What to say if the extra `color` is not installed."""
    return f"colour, which corrects many limbs and swapped sides, is not used: {missing}"


class PeopleInColour(NamedTuple):
    """What the network shows of the people of a frame, in their order.

    looked_in: for each person, the cameras in whose images the network looked for them, and would have shown
    them.
    """

    keypoints: Sequence[Keypoints]
    looked_in: Sequence[Collection[str]]


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
        """Load the network and compiled code, which the first frame with colour would otherwise wait for."""
        nearest_occupied_pixels(np.zeros((1, 1), dtype=np.bool_))
        self._thread.submit(lambda: self._network).result()

    def submit(
        self, frame: Frame, bodies: Sequence[ExpectedBody | None], settings: ColourSettings
    ) -> Future[PeopleInColour]:
        """Begin to look for people, each around an expected body; without body or colour, for nobody."""

        def look() -> PeopleInColour:
            looks = [self._look(frame, body, settings) for body in bodies]
            seen = [{camera: own for camera, own in each.items() if own is not None} for each in looks]
            assigned = assign(bodies, seen, frame, settings)
            looked_in = [
                [name for name, own in each.items() if not is_another_person(own, name, assigned, settings)]
                for each in looks
            ]
            return PeopleInColour(assigned, looked_in)

        return self._thread.submit(look)

    def look_at(
        self,
        candidates: Mapping[int, tuple[SubjectFrame, SubjectFrame]],
        frame: Frame,
        upward: Mapping[str, Array],
        settings: ColourSettings,
    ) -> dict[int, Keypoints]:
        """The keypoints of candidates, by their place; none where the network sees no person.

        A candidate is a pair of subjects: what shows it, and all that may show it. `upward` has a direction
        (3,) in the frame of each camera, by the camera's name.
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
                crop = crop_of_points(points, upward[image.camera], image.intrinsics, settings.reach_m)
                keypoints = find_keypoints(self._network, image.colours, image.depth > 0, crop, settings)
                if keypoints is not None and are_on(whole[image.camera], keypoints, settings.outline_px):
                    shown[image.camera] = keypoints
            return shown

        return self._thread.submit(lambda: {n: look(*who) for n, who in candidates.items()}).result()

    def _look(
        self, frame: Frame, body: ExpectedBody | None, settings: ColourSettings
    ) -> dict[str, NDArray[np.float32] | None]:
        """What the network sees around a body in each image that may show it; None if it sees nobody."""
        seen = dict[str, NDArray[np.float32] | None]()
        for view in frame.views:
            crop = None if body is None or view.colours is None else crop_of(body, view)
            if crop is not None and view.colours is not None:
                measured = view.depth > 0
                seen[view.camera] = find_keypoints(self._network, view.colours, measured, crop, settings)
        return seen


def crop_of(body: ExpectedBody, view: View) -> Crop | None:
    """The crop around a person in an image; None if the person is not expected in it."""
    keypoints = view.to_camera(body.keypoints)
    hips, shoulders = (keypoints[pair].mean(axis=0) for pair in (HIPS, SHOULDERS))
    vertices = view.to_camera(pose_vertices(body.model, body.pose[None])[0])
    crop = crop_of_body(vertices, hips, shoulders, view.intrinsics)
    return crop if crop is not None and crop.overlaps(view.depth.shape) else None
