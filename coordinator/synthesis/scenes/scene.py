"""What a synthetic sequence shows: a body, its pose in every frame, the camera, and where to start."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from common.body import BodyModel
from common.camera import Intrinsics
from coordinator.synthesis.scenes.furniture import Room


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A body with D degrees of freedom that moves through F frames.

    `start` (D,) is what a tracker knows at the beginning; None where it has to find the body.
    """

    model: BodyModel
    camera: Intrinsics
    fps: float
    poses: NDArray[np.float64]  # (F, D) radians and metres
    start: NDArray[np.float64] | None  # (D,)
    room: Room | None = None  # around it

    def __post_init__(self) -> None:
        self.poses.setflags(write=False)
        if self.start is not None:
            self.start.setflags(write=False)


def through_keys(keys: dict[float, float], frames: int) -> NDArray[np.float64]:
    """A smooth curve (frames,) through key values by frame number, which never overshoots them.

    Before the first and after the last key it stands still.
    """
    curve = PchipInterpolator(list(keys), list(keys.values()))
    return np.asarray(curve(np.clip(np.arange(frames), min(keys), max(keys))))


def animate(model: BodyModel, keys: dict[str, dict[float, float]], frames: int) -> NDArray[np.float64]:
    """Poses (frames, D) of a body from key values of some degrees of freedom; the others stay at zero."""
    poses = np.zeros((frames, len(model.dof_names)))
    for name, values in keys.items():
        poses[:, model.dof(name)] = through_keys(values, frames)
    return poses
