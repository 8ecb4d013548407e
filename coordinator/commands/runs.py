"""`gepf track`: one run, or several at once."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from gepf.common.errors import InputError
from gepf.coordinator.commands.console import ExitCode
from gepf.coordinator.commands.job import Job, choose_job, is_several, recordings_of
from gepf.coordinator.commands.options import CameraOptions, SecurityOptions, TrackOptions
from gepf.coordinator.commands.progress import Show
from gepf.coordinator.commands.track import track
from gepf.coordinator.files import SUMMARY_FILE
from gepf.coordinator.pool.zenoh_refiner import Connect


def run_track(
    options: TrackOptions, camera: CameraOptions, security: SecurityOptions, show: Show, connect: Connect
) -> int:
    """Track; returns the exit code. Raises InputError for invalid options, before anything is read.

    Several recordings are tracked in parallel, each into its own folder; of a list, one may be chosen.
    """
    job = choose_job(options, camera, security)
    jobs, single = [job], not is_several(options)
    if not single:
        from gepf.coordinator.commands.many import choose_runs, track_many  # not needed for a single run

        jobs = choose_runs(job, recordings_of(options))
        if options.index is not None:
            jobs, single = [listed_at(options.index, jobs)], True
    if single:
        code: int = ExitCode.DONE if track(jobs[0], show, connect) else ExitCode.NOT_TRACKED
    else:
        code = track_many(jobs, show)
    if options.as_json:
        files = [each.folder / SUMMARY_FILE for each in jobs]
        texts = ",\n".join(file.read_text(encoding="utf-8").strip() for file in files if file.exists())
        sys.stdout.write(f"{texts}\n" if single else f"[{texts}]\n")
    return code


def listed_at(index: int, jobs: Sequence[Job]) -> Job:
    """The run with an index; InputError if the list is shorter."""
    if index >= len(jobs):
        raise InputError(f"--index {index} is beyond the end of the list; give 0 to {len(jobs) - 1}")
    return jobs[index]
