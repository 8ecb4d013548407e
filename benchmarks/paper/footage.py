"""Synthetic sequences in memory: the same frames that `gepf synth` writes, rendered once for all seeds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.frame import DepthFrame
from coordinator.synthesis.noise import add_noise
from coordinator.synthesis.scenes import SCENES, Scene
from coordinator.synthesis.sequence import DEPTH_SCALE, render, to_units
from coordinator.tracking.observing.sensor_noise import SensorNoise


@dataclass(frozen=True, slots=True, eq=False)
class Footage:
    """A scene and the exact depth (F, H, W) in metres of all its frames."""

    scene: Scene
    exact: NDArray[np.float32]

    def frames(self, noise: SensorNoise, seed: int, count: int) -> Iterator[DepthFrame]:
        """The first `count` frames with noise, as they come back from the files of `gepf synth`."""
        camera, fps = self.scene.camera, self.scene.fps
        for number, depth_m in enumerate(self.exact[:count]):
            rng = np.random.default_rng([seed, number])
            noisy = to_units(add_noise(depth_m.astype(np.float64), camera, noise, rng))
            yield DepthFrame(number, number / fps, noisy, DEPTH_SCALE, camera)

    @property
    def start(self) -> dict[str, float]:
        """The pose to start from by degree of freedom, as `init.json` has it."""
        start = self.scene.poses[0] if self.scene.start is None else self.scene.start
        return dict(zip(self.scene.model.dof_names, start.tolist(), strict=True))


def shoot(scene: str) -> Footage:
    """Render all of a scene."""
    found = SCENES[scene]()
    return Footage(found, np.array([depth.astype(np.float32) for depth in render(found)]))
