"""Faults of the cameras of a rig: a camera gives no depth, repeats an image, or contradicts the others.

One principle decides: the pose that the other cameras support must explain both the body points in a camera's
image and the depth that this camera measures behind the body, to within the allowed residual. A camera with a
wrong or changed pose fails this test, whatever the reason. When cameras that agreed begin to disagree, the
predicted pose decides, because the refined one is a compromise between them. A repeated image is not new
evidence. At least one camera is always kept.

After a frame, `Agreement.after` says which cameras contradict the pose of a body. When the next frame is
segmented, the body excludes these (`NextSegmentation.excluded`): what they show of it is set aside, and
compared again. `update_camera_states` marks a camera as faulty for all bodies if any body excludes it or if
its image is faulty. `faults_of` returns the faults that have lasted long enough: estimates name them, and a
track is checked when one of them ends.
"""

from __future__ import annotations

import zlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.spatial import cKDTree

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.camera import pixels_at
from gepf.common.frame import Frame, SubjectView, View
from gepf.common.kinematics import pose_vertices
from gepf.coordinator.tracking.estimate import Fault
from gepf.coordinator.tracking.observation import camera_points

NO_DEPTH: Fault = "gives no depth"
REPEATS: Fault = "repeats an image"
CONTRADICTS: Fault = "contradicts the others"
REMEDY = "this camera or another one may have moved; run gepf calibrate on recordings to find their poses"


@dataclass(frozen=True, slots=True)
class CameraState:
    """A camera after a frame."""

    image: int  # checksum of a part of its last image
    last_good_s: float  # time of the last frame without a fault
    fault: Fault | None = None


CameraStates = dict[str, CameraState]
"""By the camera's name."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """Whether the cameras that show a body agree on its position.

    contradicting: cameras whose points the pose did not explain when they were last compared. agreed_s:
    seconds for which two or more cameras have agreed; once it has reached `camera_confirmed_s`, disagreement
    no longer resets it until the body is lost.
    """

    contradicting: tuple[str, ...] = ()
    agreed_s: float = 0.0

    def after(
        self, residuals: Mapping[str, float], allowed_m: float, interval_s: float, confirmed_s: float
    ) -> Self:
        """The agreement after a frame, from the residuals (metres) of the cameras that can be compared now.

        A camera contradicts the others if the pose does not explain its image. The camera that the pose
        explains best never counts as contradicting. A camera that cannot be compared now keeps its last
        verdict.
        """
        if len(residuals) < 2:
            return self
        allowed = max(allowed_m, min(residuals.values()))
        contradicting = [name for name, residual in residuals.items() if residual > allowed]
        not_compared = [name for name in self.contradicting if name not in residuals]
        agreed_s = self.agreed_s
        if len(residuals) > len(contradicting) + 1:
            agreed_s += interval_s
        elif agreed_s < confirmed_s:
            agreed_s = 0.0
        return type(self)((*not_compared, *contradicting), agreed_s)

    def dispute(self, cameras: Sequence[str], confirmed_s: float) -> str:
        """Why a pose estimated from these `cameras` may be wrong; empty if there is no dispute.

        Of two cameras that contradict each other, one is trusted only if they agreed before.
        """
        supporting = [name for name in cameras if name not in self.contradicting]
        if not self.contradicting or len(supporting) > 1 or (supporting and self.agreed_s >= confirmed_s):
            return ""
        names, supporting_names = ", ".join(self.contradicting), ", ".join(supporting) or "the others"
        verb = "disagrees" if len(self.contradicting) == 1 else "disagree"
        return f"{names} {verb} with {supporting_names}: one of them may have a wrong T_rig_camera"


def update_camera_states(
    states: Mapping[str, CameraState], frame: Frame, contradicting: Collection[str]
) -> tuple[CameraStates, Frame]:
    """The states of all cameras after a frame, and the frame with the depth of repeated images set to 0.

    `contradicting` are the cameras that are left out now. A camera without an image keeps its fault; if it
    had none, its fault is that it gives no depth.
    """
    by_image = [state_by_image(view, states.get(view.camera), frame.time_s) for view in frame.views]
    if all(state.fault for state in by_image):  # no camera is good: use those with depth, or else all
        tolerated_fault = REPEATS if any(state.fault == REPEATS for state in by_image) else NO_DEPTH
        by_image = [
            replace(state, last_good_s=frame.time_s, fault=None) if state.fault == tolerated_fault else state
            for state in by_image
        ]
    after = {name: replace(state, fault=state.fault or NO_DEPTH) for name, state in states.items()}
    views = []
    for view, state in zip(frame.views, by_image, strict=True):
        depth = np.zeros_like(view.depth) if state.fault == REPEATS else view.depth
        views.append(replace(view, depth=depth))
        after[view.camera] = state
        if view.camera in contradicting:
            last_good_s = states.get(view.camera, state).last_good_s
            after[view.camera] = CameraState(state.image, last_good_s, CONTRADICTS)
    return after, replace(frame, views=tuple(views))


def state_by_image(view: View, before: CameraState | None, time_s: float) -> CameraState:
    """The state of a camera at the time of a frame, judged by its image alone."""
    checksum = zlib.crc32(view.depth[::8].tobytes())  # every eighth row
    if view.depth.any() and (before is None or before.image != checksum):
        return CameraState(checksum, time_s)
    return CameraState(
        checksum, before.last_good_s if before else time_s, REPEATS if view.depth.any() else NO_DEPTH
    )


def compare_cameras(
    model: BodyModel,
    refined: Array,
    predicted: Array | None,
    frame: Frame,
    used: Sequence[SubjectView],
    set_aside: Sequence[SubjectView],
    agreement: Agreement,
    allowed_m: float,
) -> dict[str, float]:
    """The residuals (metres) of the cameras in a frame with this refined pose (D,).

    When cameras that agreed begin to disagree, the refined pose is a compromise between them. The predicted
    pose (D,) tells which of them has moved, if it explains one of them; it is None if the cameras did not
    agree before, or if it is not known where the body was. A frame that was segmented before a verdict may
    still use both the contradicting cameras and others; in that frame, cameras are not compared.
    """
    contradicting = [view.image.camera in agreement.contradicting for view in used]
    if any(contradicting) and not all(contradicting):
        return {}
    views = (*used, *set_aside)
    residuals = camera_residuals(model, refined, frame, views, allowed_m)
    is_compromise = any(residuals.get(view.image.camera, 0.0) > allowed_m for view in used)
    if is_compromise and predicted is not None:
        before = camera_residuals(model, predicted, frame, views, allowed_m)
        if before and min(before.values()) <= allowed_m:
            return before
    return residuals


def camera_residuals(
    model: BodyModel, pose: Array, frame: Frame, views: Sequence[SubjectView], allowed_m: float
) -> dict[str, float]:
    """The residual (metres) of each camera for a pose (D,).

    It is the larger of two distances: that of the camera's crop of the body from the pose, and that by which
    its depth lies behind the pose. A camera whose image has no crop of the body is included only if it
    contradicts the pose by more than `allowed_m`.

    Empty for a single camera. Cameras that cannot be compared are left out.
    """
    if len(frame.views) < 2:
        return {}
    # the corners of every third triangle
    first, second, third = pose_vertices(model, pose[None])[0][model.triangles[::3].T]
    normals = np.cross(second - first, third - first)
    offsets = np.sum(normals * first, axis=1)
    views_by_camera, residuals = {view.image.camera: view for view in views}, dict[str, float]()
    for image in frame.views:
        facing = first[normals @ image.T_rig_camera[:3, 3] > offsets]
        through = seen_through(image, facing)
        if image.camera in views_by_camera:
            residuals[image.camera] = max(through, mean_distance(views_by_camera[image.camera], facing))
        elif through > allowed_m:
            residuals[image.camera] = through
    return residuals


def seen_through(image: View, surface: Array) -> float:
    """Median distance in metres by which the depth of an image is behind points (N, 3) of a surface.

    It counts as 0 where the image shows nothing or something nearer.
    """
    points = image.to_camera(surface)
    points = points[points[:, 2] > 0.0]
    row, column, inside = pixels_at(points, image.intrinsics)
    behind = np.zeros(len(surface))
    depth = image.depth[row[inside], column[inside]] / image.depth_scale
    # only the median counts, so order does not matter; points outside the image count as 0
    behind[: len(depth)] = np.maximum(depth - points[inside, 2], 0.0)
    return float(np.median(behind)) if len(behind) else 0.0


def mean_distance(view: SubjectView, surface: Array) -> float:
    """Mean distance in metres of about 100 points of a camera from points (N, 3) of a surface."""
    points = view.image.to_rig(camera_points(view, max(1, len(view.picked) // 100)))
    return float(cKDTree(surface).query(points)[0].mean())


def faults_of(
    states: Mapping[str, CameraState], time_s: float, confirmed_s: float
) -> dict[str, tuple[Fault, float]]:
    """The camera faults that have lasted for `confirmed_s` by the time of a frame, each with its start."""
    return {
        name: (state.fault, state.last_good_s)
        for name, state in states.items()
        if state.fault is not None and time_s - state.last_good_s >= confirmed_s
    }


def describe_changes(
    before: Mapping[str, tuple[Fault, float]], after: Mapping[str, tuple[Fault, float]]
) -> list[str]:
    """Messages about faults that started between two frames, and about those that ended."""
    started = [
        f"camera {name} has had a fault since t = {since:.2f} s: it {kind}"
        + (f", and is left out; {REMEDY}" if kind == CONTRADICTS else "")
        for name, (kind, since) in after.items()
        if name not in before or before[name][0] != kind
    ]
    return started + [f"camera {name} is used again" for name in before if name not in after]
