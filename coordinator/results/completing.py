"""Tracks of before, with what tracks have now."""

from __future__ import annotations

from pathlib import Path

from coordinator.results.model_file import MODEL_FILE, read_tracked_body
from coordinator.results.track import Track, read_track


def read_track_with_angles(folder: Path) -> Track:
    """The track of a run's folder; angles that it was written without follow from the body, if that is there.

    InputError if there is no track or it is damaged.
    """
    track = read_track(folder)
    if track.angle is not None or not (folder / MODEL_FILE).exists():
        return track
    from coordinator.bodies.angles import angles_of
    from coordinator.results.uncertainty import with_angles

    body = read_tracked_body(folder)
    return with_angles(track, angles_of(body.model, body.held, track.up))
