"""What is seen where nobody is, learned pixel by pixel from what is measured outside the body.

Deeper than what is known for three frames replaces it: somebody went away. Nearer and still for thirty is
taken in: a chair was moved. Never learned is what is near the body, so that who stands still stays in sight.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from coordinator.scene.nearness import CELL, Nearness, square_at
from coordinator.scene.noise import margin_at
from coordinator.scene.room.marks import TWO_SAMPLES, Depth, Lens

DEEPER, NEARER = 3, 30  # frames
FIRST = 5  # where nothing was known and what is seen hangs together with the body
PATIENT = 150  # where somebody may stand who is not found yet
Arrays = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]

AWAY = 0.12  # metres from the posed surface


@dataclass(frozen=True, slots=True, eq=False)
class Learned:
    """What one frame changed in the background: flat indices (N,) of pixels and what holds there."""

    pixels: NDArray[np.uint32]
    depth: NDArray[np.float32]  # (N,)
    rival: NDArray[np.float32]  # (N,)
    frames: NDArray[np.uint8]  # (N,)


@dataclass(frozen=True, slots=True, eq=False)
class Background:
    """Depths (H, W) in metres, 0 where nothing is known; what else was seen there, and for how many frames.

    The arrays are changed in place by `learn` and `recall`.
    """

    depth: NDArray[np.float32]
    rival: NDArray[np.float32]
    frames: NDArray[np.uint8]

    def recall(self, learned: Learned) -> None:
        """Hold what was learned in a frame, as if it had been seen here."""
        for mine, theirs in ((self.depth, learned.depth), (self.rival, learned.rival)):
            mine.ravel()[learned.pixels] = theirs
        self.frames.ravel()[learned.pixels] = learned.frames

    def only(self, pixels: NDArray[np.uint32]) -> Learned:
        """What holds at some pixels, by flat indices (N,)."""
        return Learned(
            pixels, self.depth.ravel()[pixels], self.rival.ravel()[pixels], self.frames.ravel()[pixels]
        )


def nothing_known(height: int, width: int) -> Background:
    """The background before the first frame."""
    shape = height, width
    return Background(np.zeros(shape, np.float32), np.zeros(shape, np.float32), np.zeros(shape, np.uint8))


def given(depth: NDArray[np.float32]) -> Background:
    """The background of an empty room (H, W) in metres."""
    return Background(depth.copy(), np.zeros_like(depth), np.zeros(depth.shape, np.uint8))


def learn(
    known: Background,
    depth: Depth,
    lens: Lens,
    growth: float,
    body: Nearness | None,
    doubtful: NDArray[np.bool_],
    *,
    patient: bool = False,
) -> Learned:
    """Learn a frame (H, W) in metres that shows this body.

    doubtful: (H, W) pixels that may be somebody's: learned late, even where nothing is known, and very late
    where there is no body, or to be `patient`.
    """
    near = (body.low, body.squares) if body else (np.zeros(3), np.empty((0, 0, 0), np.uint8))
    waits = (FIRST, NEARER) if body and not patient else (PATIENT, PATIENT)
    pixels = np.empty(depth.size, dtype=np.uint32)
    arrays = (known.depth, known.rival, known.frames)
    count = learn_pixels(depth, lens, growth, near, doubtful, waits, arrays, pixels)
    return known.only(pixels[:count].copy())


@numba.njit(cache=True, nogil=True, error_model="numpy")
def learn_pixels(
    depth: Depth,
    lens: Lens,
    growth: float,
    near: tuple[NDArray[np.float64], NDArray[np.uint8]],
    doubtful: NDArray[np.bool_],
    waits: tuple[int, int],
    known: Arrays,
    pixels: NDArray[np.uint32],
) -> int:
    """Learn a depth image (H, W) in place; gives how many pixels changed, which are the first of `pixels`.

    near is what a `Nearness` holds; waits are frames for doubtful pixels, where nothing is known and where
    something is.
    """
    fx, fy, cx, cy = lens
    limit = (AWAY / CELL) ** 2
    count = 0
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            z = depth[v, u]
            if not z > 0.0:
                continue
            margin = TWO_SAMPLES * margin_at(z, growth)
            if abs(z - known[0][v, u]) <= margin and known[2][v, u] == 0:
                continue
            if square_at((u - cx) / fx * z, (v - cy) / fy * z, z, near[0], near[1]) > limit:
                take_in(v, u, z, margin, doubtful[v, u], waits, known)
                pixels[count] = v * depth.shape[1] + u
                count += 1
    return count


@numba.njit(cache=True, nogil=True)
def take_in(
    v: int, u: int, z: float, margin: float, doubtful: bool, waits: tuple[int, int], known: Arrays
) -> None:
    """Take in that a pixel shows z metres; the arrays are those of a `Background`."""
    depth, rival, frames = known
    old = depth[v, u]
    if abs(z - old) <= margin:
        rival[v, u], frames[v, u] = 0.0, 0
        return
    if frames[v, u] > 0 and abs(z - rival[v, u]) <= margin:
        frames[v, u] += 1
    else:
        rival[v, u], frames[v, u] = z, 1
    needed = waits[1] if doubtful else NEARER
    if old == 0.0:
        needed = waits[0] if doubtful else 1
    elif z > old:
        needed = DEEPER
    if frames[v, u] >= needed:
        depth[v, u], rival[v, u], frames[v, u] = z, 0.0, 0
