"""`gepf track`: its options checked, then done on a recording or on live input."""

from __future__ import annotations

import sys
from dataclasses import replace

import msgspec

from common.errors import InputError
from coordinator.bodies.choice import choose_model
from coordinator.commands.batch.recordings import Entry, choose_entries, is_several
from coordinator.commands.console.progress import Show
from coordinator.commands.exit_codes import DONE, NOT_TRACKED
from coordinator.commands.options.choices import (
    at_least,
    choose_deadline,
    choose_dofs,
    choose_idle_timeout,
    choose_pool,
    choose_settings,
    secure,
    set_noise,
    set_rotation,
)
from coordinator.commands.options.job import Job
from coordinator.commands.options.scope import choose_scope
from coordinator.commands.options.track_arguments import TrackOptions
from coordinator.commands.people.choice import choose_people, track_live, track_recording
from coordinator.commands.results_stream import check_results
from coordinator.commands.workers import Connect, ListeningRefiner, end_as_interrupted
from coordinator.results.summary import SUMMARY_FILE
from coordinator.sources.camera import parse_camera_options
from coordinator.sources.joint_states import JointStates, read_joint_states
from coordinator.sources.live import live_key


def run_track(options: TrackOptions, show: Show, connect: Connect[ListeningRefiner]) -> int:
    """Track; gives the exit code. Raises InputError for options that make no sense, before anything is read.

    Several recordings or seeds are tracked side by side, each into a folder of its own.
    """
    job = choose_job(options)
    check_results(job)
    end_as_interrupted()
    if is_several(options.input.sequences, options.method.seeds):
        return track_several(options, job, show)
    return DONE if track_single(options, job, show, connect) else NOT_TRACKED


def track_single(options: TrackOptions, job: Job, show: Show, connect: Connect[ListeningRefiner]) -> bool:
    """Track one recording, or live input; gives whether most of its frames were tracked."""
    if live_key(job.sequence) is None:
        tracked = track_recording(job, show, connect)
    else:
        tracked = track_live(job, show, connect)
    if options.output.as_json:
        sys.stdout.write((job.out / SUMMARY_FILE).read_text(encoding="utf-8"))
    return tracked


def track_several(options: TrackOptions, job: Job, show: Show) -> int:
    """Track recordings and seeds as `job` says, over one pool; gives the exit code."""
    from coordinator.commands.batch.runs import track_many

    at_once = options.pool.at_once
    entries = choose_entries(options.input.sequences, options.method.seed, options.method.seeds)
    if any(live_key(entry.sequence) is not None for entry in entries):
        raise InputError("live input is tracked alone; give zenoh:KEY and nothing else")
    if at_once is not None:
        at_least(1, "--at-once", at_once)
    code = track_many([one_of(job, entry) for entry in entries], at_once, show)
    if options.output.as_json:
        found = [job.out / entry.name / SUMMARY_FILE for entry in entries]
        texts = [file.read_text(encoding="utf-8").strip() for file in found if file.exists()]
        sys.stdout.write("[" + ",\n".join(texts) + "]\n")
    return code


def one_of(job: Job, entry: Entry) -> Job:
    """The job of one of several recordings."""
    settings = msgspec.structs.replace(job.settings, seed=entry.seed)
    return replace(job, sequence=entry.sequence, out=job.out / entry.name, settings=settings)


def choose_job(options: TrackOptions) -> Job:
    """What the options ask for; InputError for what makes no sense."""
    source, method, pool = options.input, options.method, options.pool
    settings = choose_settings(method.method, method.preset, method.particles, method.points, method.seed)
    settings = set_noise(settings, method.noise_depth, method.noise_lateral)
    settings = set_rotation(settings, source.rotate)
    security = secure(options.security, pool.listen, pool.connect)
    deadline = choose_deadline(method.deadline, method.method)
    return Job(
        sequence=source.sequences[0],
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
        given=parse_camera_options(source.camera.intrinsics, source.camera.depth_scale),
        scope=choose_scope(options.scene),
        people=choose_people(options.scene.people, choose_model(source.model), source.init),
        joint_states=choose_joint_states(options),
        pictures=options.output.pictures,
        idle_timeout=choose_idle_timeout(source.idle_timeout),
    )


def choose_joint_states(options: TrackOptions) -> JointStates | None:
    """What --joint-states says; InputError where it cannot belong to what is tracked."""
    path, source = options.input.joint_states, options.input
    if path is None:
        return None
    if is_several(source.sequences, None) or live_key(source.sequences[0]) is not None:
        raise InputError("--joint-states belongs to one recording; track it alone")
    if options.scene.people > 1:
        raise InputError("--joint-states belongs to one body; leave --people out")
    return read_joint_states(path)
