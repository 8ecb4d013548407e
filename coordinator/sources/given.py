"""What a user says of a recording that does not say it itself, or says it wrongly."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.camera import Intrinsics
from common.errors import InputError
from common.frame import DepthFrame
from coordinator.sources.source import Recording, Source


@dataclass(frozen=True, slots=True)
class Given:
    """fx, fy, cx, cy in pixels, and units per metre; None for what the recording says."""

    lens: tuple[float, float, float, float] | None = None
    depth_scale: float | None = None

    def camera(self, width: int, height: int, name: str) -> Intrinsics:
        """The camera of images of a size; InputError where nobody said which."""
        if self.lens is None:
            raise InputError(
                f"{name} does not say its camera; add --intrinsics fx,fy,cx,cy (pixels), or write "
                "camera_intrinsic.json beside the frames"
            )
        return Intrinsics(width, height, *self.lens)


NOTHING = Given()


def parse_given(intrinsics: str | None, depth_scale: float | None) -> Given:
    """From the words of the command line; InputError where they make no sense."""
    if depth_scale is not None and not 0.0 < depth_scale < math.inf:
        raise InputError(
            f"--depth-scale {depth_scale:g} is no number of units per metre; millimetres have 1000"
        )
    if intrinsics is None:
        return Given(None, depth_scale)
    try:
        fx, fy, cx, cy = (float(part) for part in intrinsics.split(","))
    except ValueError:
        raise InputError(
            f"--intrinsics '{intrinsics}' is not fx,fy,cx,cy in pixels; give four numbers"
        ) from None
    if not (np.isfinite([fx, fy, cx, cy]).all() and fx > 0.0 and fy > 0.0):
        raise InputError(f"--intrinsics '{intrinsics}' is not fx,fy,cx,cy with positive fx, fy; mend it")
    return Given((fx, fy, cx, cy), depth_scale)


class GivenSource(Recording):
    """A source with another camera or scale than it has of its own."""

    def __init__(self, source: Source, given: Given) -> None:
        own = source.intrinsics
        self._source, self._given = source, given
        self.name, self.numbers, self.fps = source.name, source.numbers, source.fps
        self.truth, self.init, self.gravity = source.truth, source.init, source.gravity
        self.intrinsics = Intrinsics(own.width, own.height, *given.lens) if given.lens else own

    def frame(self, number: int) -> DepthFrame:
        """One frame, with what the user gave instead of its own."""
        frame = self._source.frame(number)
        scale = self._given.depth_scale or frame.depth_scale
        return DepthFrame(number, frame.time_s, frame.depth, scale, self.intrinsics)


def with_given(source: Source, given: Given) -> Source:
    """The source as the user says that it is."""
    return source if given == NOTHING else GivenSource(source, given)


def unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """The vector (3,) at length 1."""
    scaled: NDArray[np.float64] = vector / np.linalg.norm(vector)
    return scaled
