"""A run's folder from a track that is there as a whole, as programs make one from Python."""

from __future__ import annotations

from pathlib import Path

import msgspec

from common.errors import InputError
from common.settings import Settings
from coordinator.files.atomic import write_atomically
from coordinator.results.configuration.versions import versions
from coordinator.results.model_file import MODEL_FILE, TrackedBody, write_tracked_body
from coordinator.results.summary import STATUSES, SUMMARY_FILE
from coordinator.results.track import TRACK_FILE, Track, write_track


def save_run(folder: Path, track: Track, body: TrackedBody, settings: Settings) -> None:
    """Write `track.npz`, `model.npz` and `summary.json`. InputError if any of them is there."""
    present = [name for name in (TRACK_FILE, MODEL_FILE, SUMMARY_FILE) if (folder / name).exists()]
    if present:
        raise InputError(f"{folder} holds a run already ({present[0]}); choose another folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_atomically(folder / MODEL_FILE, lambda file: write_tracked_body(body, file))
        text = msgspec.json.format(msgspec.json.encode(summary_of(folder, track, body, settings)), indent=2)
        write_atomically(folder / SUMMARY_FILE, lambda file: file.write(text + b"\n"))
        write_atomically(folder / TRACK_FILE, lambda file: write_track(track, file))
    except OSError as error:
        raise InputError(f"cannot write to {folder}: {error.strerror}; choose another folder") from error


def summary_of(folder: Path, track: Track, body: TrackedBody, settings: Settings) -> dict[str, object]:
    """What is known of a run that was made from Python."""
    return {
        "sequence": folder.resolve().name,
        "model": {"name": body.model.name, "hash": body.model.hash, "active": body.model.dof_names},
        "method": settings.method,
        "preset": settings.preset,
        "seed": settings.seed,
        "settings": msgspec.to_builtins(settings),
        "versions": versions(),
        "frames": len(track.frame),
        "status": {status: int((track.status == status).sum()) for status in STATUSES},
        "particles": settings.filter.particles,
        "complete": True,
    }
