"""Publishes the result of each frame during the run; docs/live.md describes the message.

Each message contains all names and values, so a receiver needs no earlier message.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from coordinator.bodies.angles import Angles, angles_of
from coordinator.results.log import assemble
from coordinator.results.track import Track
from coordinator.tracking.estimate import Estimate

VERSION = 1
KIND, END = "estimate", "estimates-end"


class Outlet(Protocol):
    """A destination of messages."""

    def put(self, payload: bytes) -> None:
        """Publish a message; it may be dropped."""
        ...

    def put_surely(self, payload: bytes) -> None:
        """Publish a message that is not dropped."""
        ...


class LiveResults:
    """Publishes estimates as MessagePack or JSON; angles do not jump by full turns between frames."""

    def __init__(
        self, outlet: Outlet, *, as_json: bool = False, clock: Callable[[], float] = time.time
    ) -> None:
        self._outlet, self._clock = outlet, clock
        self._encode = msgspec.json.encode if as_json else msgspec.msgpack.encode
        self._last: NDArray[np.float64] | None = None

    def put(self, estimate: Estimate, model: BodyModel, held: Mapping[str, float]) -> None:
        """Publish the estimate of a frame."""
        estimated_at = self._clock()
        angles = angles_of(model, held)
        track = assemble(model, [estimate], held=held)
        values = self._follow(angles, track)
        self._outlet.put(
            self._encode(
                {
                    "kind": KIND,
                    "version": VERSION,
                    "frame": estimate.frame,
                    "time_s": estimate.time_s,
                    "estimated_at": estimated_at,
                    "status": estimate.status,
                    "residual": estimate.residual if np.isfinite(estimate.residual) else None,
                    "pose": by_name(model.dof_names, estimate.pose),
                    "angles": by_name(angles.names, values),
                    "angle_deviation": by_name(angles.names, track.angle_deviation[0]),
                    "joints": by_name(model.joint_names, estimate.joint_positions),
                    "why": estimate.why,
                    "joint_deviation": by_name(model.joint_names, track.joint_deviation[0]),
                    "joint_off_probability": by_name(model.joint_names, track.joint_off_probability[0]),
                    "joint_seen": by_name(model.joint_names, track.joint_seen[0]),
                }
            )
        )

    def _follow(self, angles: Angles, track: Track) -> NDArray[np.float64]:
        """The angles (A,) of the frame, shifted by full turns towards the last known angles; NaN before."""
        if not track.placed[0]:
            return np.full(len(angles.names), np.nan)
        measured = track.angle
        near: NDArray[np.float64] = (
            measured[0] if self._last is None else angles.near(measured, self._last)[0]
        )
        if not track.unknown[0]:
            self._last = near
        return near

    def end(self) -> None:
        """Publish that there are no more messages."""
        self._outlet.put_surely(self._encode({"kind": END, "version": VERSION}))


def by_name(names: tuple[str, ...], values: NDArray[np.float64]) -> dict[str, Any]:
    """Values (N,) or points (N, 3) by name; null if unknown."""
    return {
        name: value.tolist() if np.isfinite(value).all() else None
        for name, value in zip(names, values, strict=True)
    }
