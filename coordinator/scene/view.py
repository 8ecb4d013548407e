"""What is known of the scene in one frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.camera import Intrinsics
from coordinator.scene.noise import DepthNoise
from coordinator.scene.room.planes import Planes

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class SceneView:
    """One frame as the scene is understood in it.

    depth: (H, W) metres, 0 where nothing was measured, or nothing that counts.
    background: (H, W) metres, what is seen where nobody is; 0 where that is not known.
    furnished: something else than people is measured; where it is not, what is not measured is empty.
    left_out: (H, W) pixels that do not count, as the user says; they say nothing of anybody.
    """

    number: int
    depth: NDArray[np.float32]
    camera: Intrinsics
    noise: DepthNoise
    planes: Planes
    background: NDArray[np.float32]
    furnished: bool
    left_out: NDArray[np.bool_] | None = None

    @property
    def lens(self) -> tuple[float, float, float, float]:
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
