"""The scene that a camera sees: what is known of it, frame after frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from common.frame import DepthFrame
from coordinator.scene.geometry import Array, Depth, Mask
from coordinator.scene.noise import DepthNoise, fit_noise
from coordinator.scene.planes import NO_PLANES, Planes, find_planes, follow_planes, sample_rays
from coordinator.scene.room import Background, Learned, SceneView

PERSON_SPAN_M = 2.4  # between the measured points of a frame from which on it shows more than a person
EXTREMES = (1.0, 99.0)  # per cent of the points, between which a span is taken
FILLED = 0.4  # of the picture, from which on so much is measured that it cannot be people alone
MOVED = 0.5  # of what is measured, where so much is not as it was the camera moved: what is known is void
PLANES_EVERY_FRAMES = 30  # planes are sought again, where none were found
NOTHING = Background.of(np.zeros((0, 0), np.float32)).at(np.empty(0, np.uint32))


@dataclass(frozen=True, slots=True, eq=False)
class SceneChange:
    """What a frame changed in what is known of a scene: of the background its pixels, of the rest all."""

    seen: int = 0  # frames that show something
    growth: float = 0.0  # of the depth's noise; 0 before anything was measured
    planes: Array = field(default_factory=lambda: NO_PLANES.coefficients)  # (P, 3)
    has_floor: bool = False
    furnished: bool = False
    size: tuple[int, int] = (0, 0)  # rows and columns of the background; none are known in the beginning
    learned: Learned = field(default_factory=lambda: NOTHING)


class Scene:
    """What is known of a scene so far.

    Each frame is given to `see`, and then to `learn`. From the same frames and people's pixels the same
    follows, bit for bit; `recall` does it from the changes alone. A frame of another size than those before,
    or than the background, is another camera's: the scene starts anew with it.

    Args:
        background: Depth (H, W) in metres where nobody is, 0 where that is not known; None to learn it all.
        up: Where the sky is about (3,), camera frame; None for a camera that is held as usual.
    """

    def __init__(self, background: Depth | None = None, up: Array | None = None) -> None:
        self._sky = NO_PLANES.sky if up is None else up
        self._noise: DepthNoise | None = None
        self._background: Background | None = None
        self._size: tuple[int, ...] | None = None
        self._begin(background)

    def see(self, frame: DepthFrame, left_out: Mask | None = None) -> SceneView:
        """A frame with what is known of its scene; `left_out` (H, W) are pixels that do not count."""
        depth = frame.metres()
        if self._size not in (None, depth.shape):
            self._begin(None)
        self._size = depth.shape
        self._look(depth, sample_rays(depth, frame.intrinsics))
        known = self._background
        return SceneView(
            number=frame.number,
            depth=depth,
            camera=frame.intrinsics,
            noise=self._noise or DepthNoise(),
            planes=self._planes,
            background=np.zeros_like(depth) if known is None else known.depth,
            furnished=self._furnished,
            left_out=left_out,
        )

    def learn(self, view: SceneView, people: Mask | None = None) -> SceneChange:
        """Take in the frame that was seen last, and give what it changed.

        Args:
            view: The frame, as it was seen.
            people: Pixels (H, W) that are a person's, or may be: they are not learned.
        """
        if not self._furnished:
            return self._change(NOTHING)
        outside = np.zeros(view.depth.shape, np.bool_) if people is None else people
        known = self._background or Background.of(np.zeros_like(view.depth))
        was_known = known.depth.ravel() > 0.0
        pixels = known.learn(view.depth, view.noise.growth, outside)
        if np.count_nonzero(was_known[pixels]) > MOVED * np.count_nonzero(view.depth):
            known = Background.of(np.zeros_like(view.depth))
            known.learn(view.depth, view.noise.growth, outside)
            pixels = np.arange(view.depth.size, dtype=np.uint32)
            self._given = False
        self._background = known
        return self._change(known.at(pixels))

    def recall(self, change: SceneChange) -> None:
        """Know what was known after the frame that made this change, if all before it were recalled, too."""
        self._seen, self._furnished = change.seen, change.furnished
        self._noise = DepthNoise(change.growth) if change.growth else None
        self._planes = Planes(change.planes, change.has_floor, self._sky)
        if self._background is None or self._background.depth.shape != change.size:
            self._background, self._given = Background.of(np.zeros(change.size, np.float32)), False
        if change.size == (0, 0):
            self._background = None
            return
        self._size = change.size
        self._background.recall(change.learned)
        self._given = self._given and len(change.learned.pixels) < self._background.depth.size

    def all(self) -> SceneChange:
        """The change that leads from nothing, or from the background that was given, to what is known now."""
        known = self._background
        if known is None:
            return self._change(NOTHING)
        touched = (known.depth > 0.0) | (known.frames > 0) | (not self._given)
        return self._change(known.at(np.flatnonzero(touched).astype(np.uint32)))

    def _begin(self, background: Depth | None) -> None:
        self._seen = 0
        self._noise = None
        self._planes = replace(NO_PLANES, sky=self._sky)
        self._furnished = self._given = background is not None  # given: what is known began with this
        self._background = None if background is None else Background.of(background)
        self._size = None if background is None else background.shape

    def _look(self, depth: Depth, rays: Array) -> None:
        if not len(rays):
            return
        self._noise = self._noise or fit_noise(depth)
        if len(self._planes.coefficients):
            self._planes = follow_planes(self._planes, rays, self._noise)
        elif self._seen % PLANES_EVERY_FRAMES == 0 and shows_more_than_a_person(rays):
            self._planes = find_planes(rays, self._noise, self._sky)
            filled = float(np.mean(depth > 0.0)) > FILLED
            self._furnished = self._furnished or filled or len(self._planes.coefficients) > 0
        self._seen += 1

    def _change(self, learned: Learned) -> SceneChange:
        return SceneChange(
            self._seen,
            self._noise.growth if self._noise else 0.0,
            self._planes.coefficients,
            self._planes.has_floor,
            self._furnished,
            (0, 0) if self._background is None else self._background.depth.shape,
            learned,
        )


def shows_more_than_a_person(rays: Array) -> bool:
    """Whether points (N, 3) of `sample_rays` spread farther than one person can."""
    points = np.column_stack([rays[:, :2], np.ones(len(rays))]) / rays[:, 2:]
    low, high = np.percentile(points, EXTREMES, axis=0)
    return bool((high - low).max() > PERSON_SPAN_M)
