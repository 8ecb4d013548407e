"""Depth images from a source, and the crops of them that workers receive, for one camera or a rig; checks.

The poses of bodies are in the frame of the rig. That of a single camera is the camera's own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.camera import NOT_MOVED, Intrinsics, inverse, is_rigid, moved
from gepf.common.checks import check_camera
from gepf.common.errors import InputError, ProtocolError


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A depth image of one camera.

    Attributes:
        number: The number of the image among those of its camera.
        time_s: Its time, seconds.
        depth: uint16 (H, W), `depth_scale` units per metre, 0 for no depth.
        depth_scale: Units of depth per metre.
        intrinsics: The camera.
        camera: Its name in the rig; empty for a camera alone.
        T_rig_camera: (4, 4), metres.
        gravity: Direction (3,), unit vector in the camera's frame, if a live camera measures it.
        colours: The colour image (h, w, 3), RGB, registered to depth, at any scale. Workers do not get it.
    """

    number: int
    time_s: float
    depth: NDArray[np.uint16]
    depth_scale: float
    intrinsics: Intrinsics
    camera: str = ""
    T_rig_camera: Array = field(default_factory=NOT_MOVED.copy)
    gravity: Array | None = None
    colours: NDArray[np.uint8] | None = None

    @property
    def T_camera_rig(self) -> Array:  # noqa: N802 as T_rig_camera
        """The inverse (4, 4) of T_rig_camera."""
        return inverse(self.T_rig_camera)

    def to_rig(self, points: Array) -> Array:
        """Transform points (..., 3) from the camera's frame to the rig's."""
        return moved(points, self.T_rig_camera)

    def to_camera(self, points: Array) -> Array:
        """Transform points (..., 3) from the rig's frame to the camera's."""
        return moved(points, self.T_camera_rig)

    def metres(self) -> NDArray[np.float32]:
        """Depth (H, W) in metres, 0 for no depth."""
        return self.depth.astype(np.float32) / np.float32(self.depth_scale)


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """What all cameras show at one time.

    Attributes:
        number: The number of the frame.
        time_s: Its time, seconds.
        views: For each camera, the image nearest in time, with its own time; cameras may be missing, but not
            all.
    """

    number: int
    time_s: float
    views: tuple[View, ...]

    @classmethod
    def of(cls, *views: View) -> Self:
        """The frame of these images, with number and time of the first."""
        return cls(views[0].number, views[0].time_s, views)

    @property
    def has_colours(self) -> bool:
        """Whether any of the images has colours."""
        return any(view.colours is not None for view in self.views)


UNKNOWN, SUBJECT, EMPTY, HIDDEN, UNMEASURED = 0, 1, 2, 3, 4
"""Labels of pixels. UNKNOWN: it is unclear what was measured. SUBJECT: the subject. EMPTY: something farther
was measured, so the subject is not there. HIDDEN: something nearer was measured, and the subject may be
behind it. UNMEASURED: no depth."""


@dataclass(frozen=True, slots=True, eq=False)
class SubjectView:
    """An image of one camera, cropped to the subject: all other pixels are 0.

    image: the crop, without colours. picked: flat indices (P,) into its depth, ascending: the pixels that
    become observed points. extent: (left, top, right, bottom) of the camera's whole image in pixels of the
    crop, half-open. Pixels outside are unknown; pixels inside it but outside the crop are empty. labels:
    (H, W) of the crop, uint8; None if all pixels but the subject's are empty. delay_s: from the time of the
    frame until the time of this image, seconds. keypoints: the keypoints (`gepf.common.body`) in the camera's
    colour image: column and row in the crop, and inverse variance (1 / pixels^2), 0 for a keypoint that was
    not seen.
    """

    image: View
    picked: NDArray[np.uint32]  # (P,)
    extent: tuple[int, int, int, int]
    labels: NDArray[np.uint8] | None = None  # (H, W)
    delay_s: float = 0.0
    keypoints: NDArray[np.float32] | None = None  # (K, 3)


@dataclass(frozen=True, slots=True, eq=False)
class SubjectFrame:
    """What the cameras of a frame show of a subject: the crops of those that show any of it, at least one.

    number and time_s are the frame's.
    """

    number: int
    time_s: float
    views: tuple[SubjectView, ...]  # the largest first

    @property
    def largest(self) -> SubjectView:
        """The view of the camera that shows the largest part of the subject."""
        return self.views[0]

    @property
    def pixels(self) -> int:
        """Number of pixels of the subject in all images."""
        return sum(int(np.count_nonzero(view.image.depth)) for view in self.views)

    @property
    def has_keypoints(self) -> bool:
        """Whether any of the images has keypoints."""
        return any(view.keypoints is not None for view in self.views)


def check_frame(frame: Frame, cameras: dict[str, Intrinsics]) -> Frame:
    """Return a user's own frame; InputError if it is invalid, or if a camera's intrinsics have changed.

    `cameras` maps names to intrinsics; new cameras are added.
    """
    found = {view.camera: view.intrinsics for view in frame.views}
    if not found:
        raise InputError(f"frame {frame.number} has no image; give it one view per camera")
    if not math.isfinite(frame.time_s):
        raise InputError(f"frame {frame.number}: time_s is {frame.time_s}; give seconds")
    if len(found) < len(frame.views):
        raise InputError(
            f"frame {frame.number} has two images with the same camera name; give each camera its own name"
        )
    for view in frame.views:
        wrong = find_fault(view)
        if wrong is None and cameras.get(view.camera, view.intrinsics) != view.intrinsics:
            wrong = "its intrinsics differ from those of earlier frames; use a new tracker for another camera"
        if wrong is not None:
            name = f" of camera '{view.camera}'" if view.camera else ""
            raise InputError(f"frame {frame.number}{name}: {wrong}")
    cameras.update(found)
    return frame


def find_fault(view: View) -> str | None:
    """What is wrong with one image of a frame; None if nothing is."""
    depth, camera = np.asarray(view.depth), view.intrinsics
    if depth.dtype != np.uint16 or depth.shape != (camera.height, camera.width):
        actual = f"{depth.dtype} of shape {depth.shape}"
        return f"depth is {actual}; give uint16 of shape ({camera.height}, {camera.width}), as in intrinsics"
    try:
        check_camera(camera, float(view.depth_scale))
    except ProtocolError as error:
        return f"{error}; correct it"
    if not math.isfinite(view.time_s):
        return f"time_s is {view.time_s}; give seconds"
    placed = np.asarray(view.T_rig_camera)
    if placed.shape != (4, 4) or not is_rigid(placed):
        return "T_rig_camera is not a rigid transform; give a rotation and a translation in metres, (4, 4)"
    return None
