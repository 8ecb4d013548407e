"""Whether what a recording says of its camera and units can be so."""

from __future__ import annotations

from common.camera import Intrinsics

NEAREST_M, FARTHEST_M = 0.4, 10.0
"""All depth below or beyond of this is not that of a camera in a room."""

SCALE = "is it in other units? --depth-scale N says how many are a metre"


def doubt_range(near: float | None, far: float | None) -> str | None:
    """What is odd about the nearest and farthest depth, metres; None where nothing is."""
    if near is None or far is None:
        return f"no depth is there in the frames that were looked at (floats count up to 6.5 m); {SCALE}"
    if near > FARTHEST_M or far < NEAREST_M:
        return f"all depth lies between {near:.3g} and {far:.3g} m; {SCALE}"
    return None


def doubt_camera(camera: Intrinsics) -> str | None:
    """What is odd about a camera's matrix; None where nothing is."""
    if 0.0 <= camera.cx <= camera.width and 0.0 <= camera.cy <= camera.height:
        return None
    return (
        f"the camera's centre ({camera.cx:g}, {camera.cy:g}) is outside of its picture of "
        f"{camera.width}x{camera.height}; are these the intrinsics of another size?"
    )
