"""What is suspicious about a recording's camera: unit, lens, rate, mirrored images, gaps between points."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import numpy as np

from gepf.common.arrays import Array
from gepf.common.camera import Intrinsics
from gepf.coordinator.sources.clock import CLOCK
from gepf.coordinator.sources.source import Source


class Plausible(msgspec.Struct, frozen=True):
    """What is expected of a recording."""

    max_median_m: float = 10.0  #: of depth around bodies
    max_shift_share: float = 0.25  #: of the centre from the middle of the image, in its width or height
    max_stretch: float = 1.2  #: of pixels


PLAUSIBLE = Plausible()


def find_doubts(source: Source, nearest_m: float) -> Iterator[str]:
    """Lines about what is suspicious in a recording of one camera, each with a remedy.

    `nearest_m` is the least median depth around bodies of the tracked family.
    """
    yield from doubts_of_lens(source.intrinsics)
    yield from doubts_of_unit(measured_depth(source), nearest_m)
    if len(source) > 1 and not 1.0 / CLOCK.max_step_s <= source.fps <= 1.0 / CLOCK.min_step_s:
        yield f"{source.fps:.4g} frames per second are implausible; write the frames' times to timestamps.txt"
    # Only images of a Kinect v2 have this size; libfreenect2 and the vendor's driver mirror them, which depth
    # alone does not show. Recordings with ground truth are not in doubt.
    is_kinect_v2 = (source.intrinsics.width, source.intrinsics.height) == (512, 424)
    if is_kinect_v2 and source.mirrored is None and source.truth is None:
        yield (
            "images of a Kinect v2 (512x424) are often mirrored, which exchanges left and right: if text in "
            "its colour images reads backwards, add --mirrored, else --not-mirrored"
        )
    if source.is_sparse:
        yield "depth is sparse; the narrow gaps between its points are filled"


def measured_depth(source: Source) -> Array:
    """All depth (N,) that was measured in some frames, metres."""
    return np.concatenate([np.empty(0), *(depth[depth > 0] for depth in source.examined())])


def doubts_of_lens(camera: Intrinsics) -> Iterator[str]:
    """Lines about a matrix that does not fit the size of the images."""
    size = f"{camera.width}x{camera.height}"
    shift = max(abs((camera.cx + 0.5) / camera.width - 0.5), abs((camera.cy + 0.5) / camera.height - 0.5))
    mend = "if the intrinsics are for another image size, correct them with --intrinsics fx,fy,cx,cy"
    if shift > 0.5:
        yield f"the centre ({camera.cx:g}, {camera.cy:g}) is outside its {size} image; {mend}"
    elif shift > PLAUSIBLE.max_shift_share:
        yield f"the centre ({camera.cx:g}, {camera.cy:g}) is far from the middle of its {size} image; {mend}"
    if not 1.0 / PLAUSIBLE.max_stretch < camera.fx / camera.fy < PLAUSIBLE.max_stretch:
        yield f"focal lengths {camera.fx:g} and {camera.fy:g} mean that pixels are not square; {mend}"


def doubts_of_unit(seen: Array, nearest_m: float) -> Iterator[str]:
    """Lines about measured depth (N,) in metres that is implausibly near or far."""
    scale = "if the unit is wrong, correct it with --depth-scale N, the units per metre"
    if not len(seen):
        yield f"the examined frames have no depth; {scale}"
        return
    if not nearest_m <= np.median(seen) <= PLAUSIBLE.max_median_m:
        yield f"{describe_range(seen)}; {scale}"


def describe_range(seen: Array) -> str:
    """Where the measured depth (N,) lies."""
    near, middle, far = np.quantile(seen, [0.01, 0.5, 0.99]) if len(seen) else (0.0, 0.0, 0.0)
    return f"depth lies between {near:.3g} and {far:.3g} m, half of it beyond {middle:.3g} m"
