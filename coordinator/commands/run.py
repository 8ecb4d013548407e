"""`gepf track`: its options checked, then done on a recording or on live input."""

from __future__ import annotations

import sys

from coordinator.bodies.choice import choose_model
from coordinator.commands.job import Job
from coordinator.commands.options import (
    choose_deadline,
    choose_dofs,
    choose_pool,
    choose_settings,
    secure,
    set_noise,
)
from coordinator.commands.progress import Show
from coordinator.commands.results_stream import check_results
from coordinator.commands.scope import choose_scope
from coordinator.commands.track import track_sequence
from coordinator.commands.track_arguments import TrackOptions
from coordinator.commands.track_live import track_stream
from coordinator.commands.workers import Connect, ListeningRefiner, end_as_interrupted
from coordinator.results.summary import SUMMARY_FILE
from coordinator.sources.given import parse_given
from coordinator.sources.live import live_key


def run_track(options: TrackOptions, show: Show, connect: Connect[ListeningRefiner]) -> None:
    """Track. Raises InputError for options that make no sense, before anything is read or written."""
    job = choose_job(options)
    check_results(job)
    end_as_interrupted()
    if live_key(job.sequence) is None:
        track_sequence(job, show, connect)
    else:
        track_stream(job, show, connect)
    if options.output.as_json:
        sys.stdout.write((job.out / SUMMARY_FILE).read_text(encoding="utf-8"))


def choose_job(options: TrackOptions) -> Job:
    """What the options ask for; InputError for what makes no sense."""
    source, method, pool = options.input, options.method, options.pool
    settings = choose_settings(method.method, method.preset, method.particles, method.points, method.seed)
    settings = set_noise(settings, method.noise_depth, method.noise_lateral)
    security = secure(options.security, pool.listen, pool.connect)
    deadline = choose_deadline(method.deadline, method.method)
    return Job(
        sequence=source.sequence,
        out=options.output.out,
        settings=settings,
        pool=choose_pool(pool.workers, pool.listen, pool.connect, security, pool.worker_timeout, deadline),
        model=choose_model(source.model),
        active=choose_dofs(source.dof),
        init=source.init,
        frames=source.frames,
        resume=options.output.resume,
        colour=source.color,
        results=options.output.results,
        results_json=options.output.results_json,
        given=parse_given(source.camera.intrinsics, source.camera.depth_scale),
        scope=choose_scope(options.scene),
        pictures=options.output.pictures,
    )
