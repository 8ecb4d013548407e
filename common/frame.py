"""A depth image from a source, and its crop that is sent to the workers; of one camera, or of a rig.

The poses of bodies are in the frame of the rig. That of a single camera is the camera's own.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.camera import NOT_MOVED, Intrinsics, inverse, moved


@dataclass(frozen=True, slots=True, eq=False)
class DepthFrame:
    """A depth image with its camera and time, and those of the other cameras of a rig.

    Attributes:
        number: The number of the frame.
        time_s: Its time, seconds.
        depth: uint16 (H, W), `depth_scale` units per metre, 0 for no depth.
        depth_scale: Units of depth per metre.
        intrinsics: The camera.
        camera: Its name in the rig; empty for a camera alone.
        T_rig_camera: (4, 4), metres.
        others: The images of other cameras that are nearest in time, each with its own time; a camera may be
            missing.
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
    others: tuple[DepthFrame, ...] = ()
    gravity: Array | None = None
    colours: NDArray[np.uint8] | None = None

    @property
    def views(self) -> tuple[DepthFrame, ...]:
        """The images of all cameras."""
        return (self, *self.others)

    @property
    def T_camera_rig(self) -> Array:  # noqa: N802 as T_rig_camera
        """The inverse (4, 4) of T_rig_camera."""
        return inverse(self.T_rig_camera)

    def to_rig(self, points: Array) -> Array:
        """Points (..., 3) of the camera's frame in the rig's frame."""
        return moved(points, self.T_rig_camera)

    def to_camera(self, points: Array) -> Array:
        """Points (..., 3) of the rig's frame in the camera's frame."""
        return moved(points, self.T_camera_rig)

    def metres(self) -> NDArray[np.float32]:
        """Depth (H, W) in metres, 0 for no depth."""
        return self.depth.astype(np.float32) / np.float32(self.depth_scale)


UNKNOWN, SUBJECT, EMPTY, HIDDEN, UNMEASURED = 0, 1, 2, 3, 4
"""Labels of pixels. UNKNOWN: it is unclear what was measured. SUBJECT: the subject. EMPTY: something farther
was measured, so the subject is not there. HIDDEN: something nearer was measured, and the subject may be
behind it. UNMEASURED: no depth."""


@dataclass(frozen=True, slots=True, eq=False)
class SubjectFrame:
    """A frame cropped to the subject: all other pixels are 0.

    picked: flat indices (P,) into the cropped depth, ascending: the pixels that become observed points. view:
    (left, top, right, bottom) of the camera's whole image in pixels of the crop, half-open. Pixels outside
    are unknown; pixels inside it but outside the crop are empty. kinds: labels (H, W) of the crop, uint8;
    None if all pixels but the subject's are empty. delay_s: from the time of the frame until the time of this
    image, seconds. others: the crops of the rig's other cameras; this one is that of the camera with the
    largest part of the subject. wider: of a person who is not tracked yet, the same frame with more and more
    of what may be the person's. keypoints: KEYPOINTS of `body` in the camera's colour image: column and row
    in the crop, and inverse variance (1 / pixels^2), 0 for a keypoint that was not seen.
    """

    frame: DepthFrame
    picked: NDArray[np.uint32]  # (P,)
    view: tuple[int, int, int, int]
    kinds: NDArray[np.uint8] | None = None  # (H, W)
    delay_s: float = 0.0
    others: tuple[SubjectFrame, ...] = ()
    wider: tuple[SubjectFrame, ...] = ()
    keypoints: NDArray[np.float32] | None = None  # (K, 3)

    @property
    def views(self) -> tuple[SubjectFrame, ...]:
        """The crops of all cameras."""
        return (self, *self.others)

    @property
    def widest(self) -> SubjectFrame:
        """The frame with all that may be the person's."""
        return self.wider[-1] if self.wider else self

    @property
    def pixels(self) -> int:
        """Number of pixels of the subject in all images."""
        return sum(int(np.count_nonzero(each.frame.depth)) for each in self.views)
