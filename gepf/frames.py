"""Checks depth frames that a user's program creates itself."""

from __future__ import annotations

import math

import numpy as np

from gepf.common.camera import Intrinsics, is_rigid
from gepf.common.checks import check_camera
from gepf.common.errors import InputError, ProtocolError
from gepf.common.frame import Frame, View


def check_frame(frame: Frame, cameras: dict[str, Intrinsics]) -> Frame:
    """Return the frame; InputError if it is invalid, or if the intrinsics of a camera have changed.

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
        check_camera(camera, view.depth_scale)
    except ProtocolError as error:
        return f"{error}; correct it"
    if not math.isfinite(view.time_s):
        return f"time_s is {view.time_s}; give seconds"
    moved = np.asarray(view.T_rig_camera)
    if moved.shape != (4, 4) or not is_rigid(moved):
        return "T_rig_camera is not a rigid transform; give a rotation and a translation in metres, (4, 4)"
    return None
