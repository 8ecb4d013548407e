"""The input of an export: poses and body of a run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gepf.common.arrays import Array, Mask
from gepf.common.camera import level_from_camera
from gepf.coordinator.results.killed import finish_killed
from gepf.coordinator.results.track import (
    Track,
    TrackedBody,
    filled,
    read_track,
    read_tracked_body,
    where_missing,
)
from gepf.coordinator.sources.source import rate_of, rising


@dataclass(frozen=True, slots=True, eq=False)
class RecordedRun:
    """A run: its name, its track, which may be low-pass filtered, and its body, which is read on request."""

    name: str
    track: Track
    folder: Path
    placed: Mask  # (F,) frames that have a pose; the others get the first one
    smoothed_hz: float | None = None

    @property
    def told(self) -> Track:
        """The track for formats with values: NaN in frames before the body was found."""
        return where_missing(self.track, ~self.placed, lambda _: np.nan)

    @property
    def remark(self) -> str:
        """The origin of the values, for formats with comments."""
        how = f"low pass {self.smoothed_hz:g} Hz, no delay" if self.smoothed_hz else "as tracked"
        up = "the camera's" if self.track.up is None else "against gravity"
        return f"gepf; {how}; camera at the origin; up is {up}"

    def from_camera(self, axes: Array) -> Array:
        """Rotation (3, 3) from the camera's axes to those that `axes` (3, 3) gives for a level camera."""
        return np.asarray(axes @ level_from_camera(self.track.up))

    def body(self) -> TrackedBody:
        """The tracked body; InputError if the folder of the run does not hold it."""
        return read_tracked_body(self.folder)

    @property
    def seconds(self) -> Array:
        """Times (F,) that still increase strictly when written in microseconds, as other programs require."""
        return rising(np.round(self.track.time_s, 6))

    @property
    def rate(self) -> float:
        """Frames per second: the inverse of the median time between frames."""
        return round(rate_of(self.seconds), 6)


def read_run(folder: Path, smooth_hz: float | None = None) -> RecordedRun:
    """The run in a folder, low-pass filtered if requested; InputError if it is missing or damaged."""
    finish_killed(folder)
    found = read_track(folder)
    track = filled(found)
    if smooth_hz is not None:
        from gepf.coordinator.exports.smoothing import smooth_track  # loads slowly

        track = smooth_track(track, read_tracked_body(folder).model, smooth_hz)
    return RecordedRun(folder.resolve().name, track, folder, found.placed, smooth_hz)
