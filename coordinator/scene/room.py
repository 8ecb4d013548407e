"""The room around the people in a frame: what lies on its planes, and its background, learned pixel by pixel.

A background pixel is learned where no person may be. Deeper than what is known for some frames replaces it:
something went away. Nearer and still for a second is taken in: a chair was moved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.camera import Intrinsics
from common.compiling import numba
from coordinator.scene.geometry import Array, Depth, Lens, Mask
from coordinator.scene.noise import DepthNoise, margin_at
from coordinator.scene.planes import Planes

Marks = NDArray[np.uint8]
Pixels = NDArray[np.uint32]

NOT_MEASURED, FOREGROUND, BACKGROUND, ON_PLANE = 0, 1, 2, 3  # marks of a pixel
TWO_SAMPLES = 1.4  # the background's depth is a sample, too
DEEPER_FRAMES = 3
NEARER_FRAMES = 30


@dataclass(frozen=True, slots=True, eq=False)
class SceneView:
    """One frame as the scene is understood in it.

    depth: (H, W) metres, 0 where nothing was measured, or nothing that counts.
    background: (H, W) metres, what is seen where nobody is; 0 where that is not known.
    furnished: something else than people is measured; where it is not, what is not measured is empty.
    left_out: (H, W) pixels that do not count, as the user says; they say nothing of anybody.
    """

    number: int
    depth: Depth
    camera: Intrinsics
    noise: DepthNoise
    planes: Planes
    background: Depth
    furnished: bool
    left_out: Mask | None = None

    @property
    def lens(self) -> Lens:
        """fx, fy, cx, cy."""
        return self.camera.fx, self.camera.fy, self.camera.cx, self.camera.cy

    @property
    def up(self) -> Array:
        """Unit vector (3,) away from the floor, camera frame."""
        return self.planes.up

    @property
    def floor_height(self) -> float | None:
        """How far the camera is above the floor, metres; None where no floor is seen."""
        return self.planes.camera_height

    def marks(self, planes: Array | None = None) -> Marks:
        """NOT_MEASURED, FOREGROUND, BACKGROUND or ON_PLANE of each pixel (H, W); planes (P, 3), all if None.

        What is deeper than the background is foreground: somebody may come through a door.
        """
        marks = np.empty(self.depth.shape, dtype=np.uint8)
        coefficients = self.planes.coefficients if planes is None else planes
        mark_pixels(self.depth, self.background, self.lens, coefficients, self.noise.growth, marks)
        return marks


@numba.njit(cache=True, nogil=True, error_model="numpy")
def mark_pixels(
    depth: Depth, background: Depth, lens: Lens, planes: Array, growth: float, marks: Marks
) -> None:
    """Fill marks (H, W) of a window as `SceneView.marks` says; the lens is that of the window."""
    fx, fy, cx, cy = lens
    for v in range(depth.shape[0]):
        y = (v - cy) / fy
        for u in range(depth.shape[1]):
            z = depth[v, u]
            if not z > 0.0:
                marks[v, u] = NOT_MEASURED
                continue
            x, margin = (u - cx) / fx, margin_at(z, growth)
            inverse = 1.0 / z
            highest = inverse - margin * inverse * inverse
            mark = FOREGROUND
            for p in range(len(planes)):
                if planes[p, 0] * x + planes[p, 1] * y + planes[p, 2] > highest:
                    mark = ON_PLANE
            if mark == FOREGROUND and abs(z - background[v, u]) < TWO_SAMPLES * margin:
                mark = BACKGROUND
            marks[v, u] = mark


@dataclass(frozen=True, slots=True, eq=False)
class Learned:
    """What one frame changed in the background: flat indices (N,) of pixels and what holds there."""

    pixels: Pixels
    depth: Depth  # (N,)
    rival: Depth  # (N,)
    frames: Marks  # (N,)


@dataclass(frozen=True, slots=True, eq=False)
class Background:
    """Depths (H, W) in metres, 0 where nothing is known; what else was seen there, and for how many frames.

    The arrays are changed in place by `learn` and `recall`.
    """

    depth: Depth
    rival: Depth
    frames: Marks

    @classmethod
    def of(cls, depth: Depth) -> Background:
        """The background of which this is known (H, W)."""
        return cls(depth.copy(), np.zeros_like(depth), np.zeros(depth.shape, np.uint8))

    def learn(self, depth: Depth, growth: float, people: Mask) -> Pixels:
        """Learn a frame (H, W) in metres, without people's pixels (H, W); gives the pixels that changed."""
        pixels = np.empty(depth.size, dtype=np.uint32)
        count = learn_pixels(depth, growth, people, self.depth, self.rival, self.frames, pixels)
        return pixels[:count].copy()

    def recall(self, learned: Learned) -> None:
        """Hold what was learned in a frame, as if it had been seen here."""
        self.depth.ravel()[learned.pixels] = learned.depth
        self.rival.ravel()[learned.pixels] = learned.rival
        self.frames.ravel()[learned.pixels] = learned.frames

    def at(self, pixels: Pixels) -> Learned:
        """What holds at some pixels, by flat indices (N,)."""
        return Learned(
            pixels, self.depth.ravel()[pixels], self.rival.ravel()[pixels], self.frames.ravel()[pixels]
        )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def learn_pixels(
    depth: Depth, growth: float, people: Mask, known: Depth, rival: Depth, frames: Marks, pixels: Pixels
) -> int:
    """Learn a depth image (H, W) in place; gives how many pixels changed, which are the first of `pixels`."""
    count = 0
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            z, old = depth[v, u], known[v, u]
            margin = TWO_SAMPLES * margin_at(z, growth)
            alike = abs(z - old) <= margin
            if not z > 0.0 or people[v, u] or (alike and frames[v, u] == 0):
                continue
            pixels[count] = v * depth.shape[1] + u
            count += 1
            if alike:
                rival[v, u], frames[v, u] = 0.0, 0
                continue
            stays = frames[v, u] > 0 and abs(z - rival[v, u]) <= margin
            if not stays:
                rival[v, u] = z
            frames[v, u] = frames[v, u] + 1 if stays else 1
            if old == 0.0 or frames[v, u] >= (DEEPER_FRAMES if z > old else NEARER_FRAMES):
                known[v, u], rival[v, u], frames[v, u] = z, 0.0, 0
    return count
