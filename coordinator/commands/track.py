"""A run of `gepf track`, recorded or live, one person or several: track and publish frames, record, draw."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from itertools import chain

import numpy as np

from gepf.common.errors import InputError, SilentWorkers
from gepf.common.frame import Frame
from gepf.coordinator.bodies.human.people import PEOPLE
from gepf.coordinator.colour.agreement import describe_changes as describe_colours
from gepf.coordinator.commands.console import INTERRUPTS
from gepf.coordinator.commands.finished import draw_pictures
from gepf.coordinator.commands.inputs import MEND_STREAM, LiveInput, RecordedInput
from gepf.coordinator.commands.job import Job
from gepf.coordinator.commands.progress import FrameRate, Show, counted
from gepf.coordinator.commands.publish import reach_partner
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.zenoh_refiner import Connect, ZenohRefiner
from gepf.coordinator.results.live_recorder import LiveRecorder, Unstored
from gepf.coordinator.results.live_results import LiveResults, PackedOutlet
from gepf.coordinator.results.recorder import Recorder, is_complete
from gepf.coordinator.results.ros2_results import RosOutlet
from gepf.coordinator.results.ros_humans import HumanBodies
from gepf.coordinator.results.summary import PERSON, folder_of
from gepf.coordinator.results.tally import Outcome, describe_counts
from gepf.coordinator.results.track import read_track
from gepf.coordinator.sources.doubts import describe_range, measured_depth
from gepf.coordinator.sources.live import LiveFrames
from gepf.coordinator.sources.live_stream import is_topic, live_key
from gepf.coordinator.sources.rig import live_cameras
from gepf.coordinator.sources.ros2 import Node
from gepf.coordinator.tracking.cameras import describe_changes
from gepf.coordinator.tracking.reporting import TrackedFrame
from gepf.coordinator.tracking.tracker import Tracker

AnyRecorder = Recorder | LiveRecorder | Unstored


def track(job: Job, show: Show, connect: Connect) -> bool:
    """Track recorded or live input; returns whether all found people were tracked in most frames.

    The folder of results is created when the options and the first recorded frame are valid. If the run ends
    early, because of an interrupt, a damaged frame or another error, the tracked frames are in the folder,
    and another run with `resume` continues after them. An interrupt ends live input as its publisher would.
    If all workers stop answering, the run continues over a new connection, as long as some frames are tracked
    over each connection.
    """
    cameras = live_cameras(job.sequence)
    run_input = LiveInput(job, cameras, show) if cameras else RecordedInput(job)
    if job.resume and is_complete(job.folder, run_input.configuration):
        show.say(f"all {run_input.total} frames are in {job.out} already")
        return True
    finished = False
    while not finished:
        with open_recorder(run_input) as recorder:
            recorded, finished = record(run_input, recorder, show, connect)
        run_input.job = replace(run_input.job, resume=True)
    if isinstance(run_input, LiveInput) and not recorded:
        raise InputError(f"no depth came on {run_input.keys} before the stream's end; {MEND_STREAM}")
    draw(run_input, recorded, show)
    tracked = conclude(run_input, recorded, show)
    if not tracked and run_input.source is not None:
        where = describe_range(measured_depth(run_input.source))
        show.say(f"{where}; if that is wrong, correct --depth-scale N, the units per metre, or --intrinsics")
    return tracked


def open_recorder(run_input: RecordedInput | LiveInput) -> AnyRecorder:
    """What keeps the results of a run."""
    job = run_input.job
    if job.out is None:
        return Unstored()
    if isinstance(run_input, LiveInput):
        return LiveRecorder(job.out, run_input.configuration, describe_pool(job.pool))
    return Recorder(job.out, run_input.configuration, resume=job.resume)


def describe_pool(pool: Pool) -> dict[str, object]:
    """The options of a pool, for the summary."""
    asked = {name: getattr(pool, name) for name in ("workers", "listen", "connect", "worker_timeout")}
    return {**asked, "encrypted": pool.security is not None}


def record(
    run_input: RecordedInput | LiveInput, recorder: AnyRecorder, show: Show, connect: Connect
) -> tuple[dict[int, Outcome], bool]:
    """Track the frames that are not recorded yet, and always write the files of the recorded frames.

    Returns the recorded frames of each person, and False if another connection must be tried.
    """
    out, total, rate, finished = run_input.job.out, run_input.total, FrameRate(), False
    show.say(run_input.announce(recorder.frames))
    try:
        finished = recorder.frames == total or track_frames(run_input, recorder, rate, show, connect)
    except KeyboardInterrupt:
        if total is not None or not recorder.frames:
            raise
        INTERRUPTS.noted, finished = False, True  # the end of live input
    finally:
        complete = finished if total is None else recorder.frames == total
        if total is None and out is not None and recorder.frames:
            show.say(f"writing the results of {counted(recorder.frames, 'frame')}")
        facts = {"complete": complete, "pool": describe_pool(run_input.job.pool), **run_input.facts()}
        recorded = recorder.finish(facts, rate.per_second or 0.0)
        if recorded and not complete:
            kept = max(each.tally.frames for each in recorded.values())  # as in the log
            if total is None:
                show.say(f"ended early with {counted(kept, 'frame')}" + (f" in {out}" if out else ""))
            else:
                show.say(f"ended early with {kept} of {total} frames in {out}; --resume continues")
    return recorded, finished


def track_frames(
    run_input: RecordedInput | LiveInput, recorder: AnyRecorder, rate: FrameRate, show: Show, connect: Connect
) -> bool:
    """Track the frames; each is recorded while the workers refine the next, live only if one is waiting.

    Each stream of live input gets a new tracker. So do the live frames that follow after no worker has
    answered for long. Returns False if all workers stopped answering after some frames of a recording.
    """
    job, before, goes_on = run_input.job, recorder.frames, False
    latest: TrackedFrame | None = None
    with (
        open_node(job, show) as node,
        connect(job.pool, show.say) as workers,
        show.steps("frame", before, run_input.total, keep=True) as advance,
    ):
        outlets, streams = open_outlets(run_input, workers, node), run_input.streams(workers, node, before)
        make = partial(
            Tracker,
            workers,
            job.settings,
            run_input.bodies,
            people=job.people,
            scope=run_input.scope,
            start=run_input.start,
            motion=job.joint_states,
            colour=run_input.finder,
            state=recorder.state,
        )
        if run_input.live is not None:
            make().prepare()  # so that no frame waits for it, nor for the first worker
            workers.wait_for(1)
            gc.freeze()  # garbage collection of the loaded modules would take 0.1 s each time
        try:
            for tracked in chain.from_iterable(
                follow(make, frames, run_input.live, show) for frames in streams
            ):
                publish(tracked, outlets)
                for line in changes(latest, tracked):
                    show.say(line)
                latest, live = tracked, run_input.live
                number = tracked.people[0].estimate.frame
                rate.count(None if live is None else live.received_at(number))
                recorder.append(tracked, workers.statistics, rate.seconds)
                advance(recorder.frames, run_input.total, run_input.describe(tracked, rate))
                if recorder.frames == before + 2:
                    gc.freeze()
        except SilentWorkers:
            goes_on = run_input.total is not None and recorder.frames > before
            if not goes_on:
                raise
            show.say("workers are connected, but none answers; reconnecting to continue this run")
        finally:
            streams.close()
            if not goes_on:
                for outlet in outlets:
                    outlet.end()
    return not goes_on


def follow(
    make: Callable[[], Tracker], frames: Iterator[Frame], live: LiveFrames | None, show: Show
) -> Iterator[TrackedFrame]:
    """Track the frames of a stream. If workers do not answer, live frames continue with a new tracker.

    Raises SilentWorkers in a recording, and if no worker has answered since the tracker began.
    """
    while True:
        answered = False
        try:
            for tracked in make().follow(frames, live=live):
                yield tracked
                answered = True
        except SilentWorkers as error:
            if live is None or not answered:
                raise
            show.say(f"{error}; tracking starts again with the next frame")
        else:
            return


def changes(before: TrackedFrame | None, now: TrackedFrame) -> list[str]:
    """Messages on what a frame changed in the cameras and in the use of their colour."""
    faults = {} if before is None else before.people[0].estimate.faults
    colours = {} if before is None else before.state.colours
    return [
        *describe_changes(faults, now.people[0].estimate.faults),
        *describe_colours(colours, now.state.colours),
    ]


def publish(tracked: TrackedFrame, outlets: Sequence[LiveResults]) -> None:
    """Publish a frame of all people who have been found; for a single person every frame."""
    for person, outlet in zip(tracked.people, outlets, strict=False):
        start = person.state.start
        if len(tracked.people) == 1 or start.found:
            outlet.put(person.estimate, start.model, start.held, person.state.shape)


@contextmanager
def open_node(job: Job, show: Show) -> Iterator[Node | None]:
    """The node of ROS 2 through which frames come or results go; None without ROS.

    It has its own session: trackers and ROS nodes are peers, and routers do not forward between peers.
    """
    if not job.uses_ros:
        yield None
        return
    partner, topic = "subscriber", job.results
    if is_topic(key := live_key(job.sequence)):
        partner, topic = "publisher", key
    with reach_partner(replace(job.pool, listen=None), partner, topic or "", show) as bus:
        yield Node(bus, job.domain)


def open_outlets(
    run_input: RecordedInput | LiveInput, workers: ZenohRefiner, node: Node | None
) -> list[LiveResults]:
    """The outlets that publish estimates, one per person; empty if not requested."""
    job = run_input.job
    if job.results is None:
        return []
    names = [job.results]
    if job.people > 1:
        names = [f"{job.results}/{PERSON}{number}" for number in range(1, job.people + 1)]
    if node is not None and is_topic(job.results):
        humans = HumanBodies(node) if run_input.bodies.family is PEOPLE else None
        return [LiveResults(RosOutlet(node, name, humans)) for name in names]
    return [
        LiveResults(PackedOutlet(workers.speak(name), as_json=job.results_json), run=workers.run)
        for name in names
    ]


def draw(run_input: RecordedInput | LiveInput, recorded: Mapping[int, Outcome], show: Show) -> None:
    """Draw pictures of a finished run, and print where the results are."""
    job = run_input.job
    max_live_frames = 108_000  # an hour; curves of longer runs are unreadable, and need much memory
    for number, each in recorded.items():
        frames, status = counted(each.tally.frames, "frame"), describe_counts(each.tally.status)
        if isinstance(run_input, LiveInput):
            frames = f"{each.tally.frames} of {counted(run_input.live.counts['received'], 'frame')}"
        if job.out is None:
            show.say(f"{frames} were tracked, but not stored: {status}")
            continue
        out = folder_of(job.out, job.people, number)
        drawn, later = "", f"; gepf pictures {out} draws pictures" if run_input.source else ""
        try:
            if job.pictures and (run_input.source or each.tally.frames <= max_live_frames):
                files = draw_pictures(
                    read_track(out), run_input.source, out, show, run_input.truth, run_input.colours
                )
                drawn, later = f" and {counted(len(files), 'picture')}", ""
        finally:
            show.say(f"{frames}{drawn} are in {out}: {status}{later}")


def conclude(run_input: RecordedInput | LiveInput, recorded: Mapping[int, Outcome], show: Show) -> bool:
    """Warn of people who were not tracked in most frames; returns whether all were tracked.

    The first of several people has a run even if no one was found.
    """
    job = run_input.job
    several = job.people > 1
    detected = sum(person.found for person in recorded.values())
    if several and detected < job.people:
        show.say(f"{detected} of up to {job.people} people were found")
    tracked = True
    for number, each in recorded.items():
        # one of several people may be absent at times
        tally = each.tally
        seen = tally.frames - (tally.statuses["absent"] if several else 0)
        if 2 * tally.known < max(1, seen):
            tracked = False
            why = tally.describe_failure()
            show.say(f"person {number}: {why}" if several else why, "bold red")
    if not tracked and isinstance(run_input, LiveInput) and run_input.is_too_slow:
        show.say(TOO_SLOW)
        return tracked
    advice = advise_rotation(recorded[1], is_tracked=tracked)
    if advice and run_input.bodies.family.axis and run_input.scope.up is None:
        show.say(advice)
    return tracked


TOO_SLOW = (
    "most frames were left out for newer ones: this machine is too slow for their rate; send fewer frames a "
    "second, give fewer --particles or --points, or connect more workers"
)


def advise_rotation(person: Outcome, *, is_tracked: bool) -> str:
    """Advice in case the camera's rotation was guessed wrong; empty if there is no reason to doubt it."""
    turn = round(np.degrees(person.start.roll))
    if is_tracked and turn:
        return (
            f"the person was taken to be upright in images turned clockwise by {turn} degrees; "
            "if that is wrong, give --rotate"
        )
    if not is_tracked and person.up is None:
        return "no floor was found; if the camera is rotated, give --rotate 90, 180 or 270"
    return ""
