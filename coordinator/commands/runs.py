"""`gepf track`: one run, or several at once."""

from __future__ import annotations

import sys

from gepf.coordinator.commands.console import NOT_TRACKED
from gepf.coordinator.commands.job import choose_job, is_several
from gepf.coordinator.commands.options import CameraOptions, SecurityOptions, TrackOptions
from gepf.coordinator.commands.progress import Show
from gepf.coordinator.commands.track import track
from gepf.coordinator.files import SUMMARY_FILE
from gepf.coordinator.pool.zenoh_refiner import Connect


def run_track(
    options: TrackOptions, camera: CameraOptions, security: SecurityOptions, show: Show, connect: Connect
) -> int:
    """Track; returns the exit code. Raises InputError for invalid options, before anything is read.

    Several recordings are tracked in parallel, each into its own folder.
    """
    job = choose_job(options, camera, security)
    if is_several(options):
        from gepf.coordinator.commands.many import choose_runs, track_many  # loads what one run does not need

        jobs = choose_runs(job, options.sequences)
        code = track_many(jobs, show)
    else:
        jobs, code = [job], 0 if track(job, show, connect) else NOT_TRACKED
    if options.as_json:
        files = [each.folder / SUMMARY_FILE for each in jobs]
        texts = ",\n".join(file.read_text(encoding="utf-8").strip() for file in files if file.exists())
        sys.stdout.write(f"[{texts}]\n" if is_several(options) else f"{texts}\n")
    return code
