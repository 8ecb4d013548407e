"""A recording with several people, from its options to its files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from coordinator.bodies.choice import choose_bodies
from coordinator.bodies.tracked import Bodies
from coordinator.commands.console.interrupts import INTERRUPTS
from coordinator.commands.console.progress import FrameMeter, Show, counted
from coordinator.commands.finished.pictures import draw_pictures
from coordinator.commands.garbage import leave_loaded_alone
from coordinator.commands.options.job import Job
from coordinator.commands.people.group import Group, advance, open_all_results, open_group, put_all
from coordinator.commands.track import describe_pool
from coordinator.commands.workers import Connect, PooledRefiner
from coordinator.results.configuration import run_configuration
from coordinator.results.log import Recorded
from coordinator.results.people import is_complete, person_folder, was_found
from coordinator.results.summary import count_doubts, describe_status
from coordinator.results.track import TrackedBody, read_track
from coordinator.scene.room.furniture import furniture
from coordinator.scene.scope import Scope
from coordinator.sources import Source, open_source
from coordinator.sources.colour_folder import ColourFolder
from coordinator.sources.source import select_frames
from coordinator.tracking.estimate import Estimate
from coordinator.tracking.people.crowd import Crowd
from coordinator.tracking.people.pipeline import follow_all

LOOKED_AT = 24  # frames before the first is tracked, for furniture


@dataclass(frozen=True, slots=True)
class PeopleRun:
    """What one run works with."""

    job: Job
    source: Source
    numbers: Sequence[int]
    bodies: Bodies
    scope: Scope
    group: Group


def track_people(job: Job, show: Show, connect: Connect[PooledRefiner]) -> bool:
    """Do a `gepf track --people N`; gives whether all who were found were tracked most of the time.

    Each person's folder is a run of its own. If the run ends early, the frames so far are kept, and another
    one with `resume` goes on from the last that is there of all.
    """
    source = open_source(job.sequence, job.given)
    numbers = select_frames(source.numbers, job.frames)
    bodies = choose_bodies(job.active, job.settings.preset, job.model)
    colours = ColourFolder(job.colour, source.intrinsics, numbers) if job.colour else None
    scope = furnished(job.scope.read(source), source, numbers)
    asked = job.asked(bodies, None, scope)
    configuration = run_configuration(job.sequence, source.frame(numbers[0]), numbers, asked, job.given)
    if job.resume and is_complete(job.out, configuration, job.people):
        show.say(f"all {len(numbers)} frames are in {job.out} already")
        return True
    with open_group(job, configuration) as group:
        run = PeopleRun(job, source, numbers, bodies, scope, group)
        meter = show.frames(len(numbers), group.frames)
        show.say(announce(run))
        try:
            if group.frames < len(numbers):
                track_frames(run, meter, show, connect)
        finally:
            found = finish(run, meter, show)
    draw(run, found, colours, show)
    return conclude(found, job, show)


def furnished(scope: Scope, source: Source, numbers: Sequence[int]) -> Scope:
    """The scope with the furniture that some frames show, unless a room without anybody is given."""
    if scope.background is not None:
        return scope
    chosen = np.unique(np.linspace(0, len(numbers) - 1, LOOKED_AT).astype(int)).tolist()
    frames = (scope.limits.keep(source.frame(numbers[n])) for n in chosen)
    return replace(scope, background=furniture(frames))


def announce(run: PeopleRun) -> str:
    """What is about to be done."""
    job, done = run.job, run.group.frames
    if done:
        return f"going on with frame {done} of {len(run.numbers)} in {job.out}"
    frames = counted(len(run.numbers), "frame")
    return f"tracking {frames} of {job.sequence} into {job.out}: up to {job.people} people"


def track_frames(run: PeopleRun, meter: FrameMeter, show: Show, connect: Connect[PooledRefiner]) -> None:
    """Track frame after frame; each is recorded while the workers are busy with the next."""
    job, group = run.job, run.group
    with connect(job.pool, show) as refiner, meter, open_all_results(job, refiner) as outlets:
        crowd = Crowd(refiner, job.settings, run.bodies, job.people, run.scope, group.states)
        frames = (run.source.frame(number) for number in run.numbers[group.frames :])
        for results in leave_loaded_alone(follow_all(crowd, frames)):
            advance(meter, results)
            put_all(results, crowd, outlets)
            group.append(results, refiner.statistics, meter.seconds)
            INTERRUPTS.check()


def finish(run: PeopleRun, meter: FrameMeter, show: Show) -> dict[int, Recorded]:
    """Write the final files of what was recorded, be it all or not; gives who was found, by number."""
    complete = run.group.frames == len(run.numbers)
    colour = None if run.job.colour is None else str(run.job.colour)
    said = {
        "complete": complete,
        "frame_rate": meter.rate,
        "pool": describe_pool(run.job.pool),
        "color": colour,
    }
    found = run.group.finish(said, complete=complete)
    if found and not complete:
        show.say(
            f"ended early with {run.group.frames} of {len(run.numbers)} frames in {run.job.out}; "
            "the same command with --resume goes on"
        )
    return found


def draw(run: PeopleRun, found: Mapping[int, Recorded], colours: ColourFolder | None, show: Show) -> None:
    """Pictures of each person's run, without a truth: a sequence's own does not say whose it is."""
    if not run.job.pictures:
        return
    for number, recorded in found.items():
        folder = person_folder(run.job.out, number)
        body = TrackedBody(recorded.state.start.model, recorded.state.start.held)
        draw_pictures(run.source, body, read_track(folder), folder, show, None, colours)


def conclude(found: Mapping[int, Recorded], job: Job, show: Show) -> bool:
    """Say how each was tracked; warn of who mostly was not, or has nobody's size; gives whether all were.

    The first person has a run even where nobody was found.
    """
    for number, recorded in found.items():
        show.say(f"{person_folder(job.out, number)}: {describe_status(recorded.estimates)}")
    there = sum(was_found(recorded) for recorded in found.values())
    if there < job.people:
        show.say(f"{there} of up to {job.people} people were found")
    failed = [number for number, each in found.items() if not followed(each.estimates)]
    for number in failed:
        doubts = count_doubts(found[number].estimates)
        why = f": {next(iter(doubts))}" if doubts else ""
        show.warn(f"person {number} is not tracked in most frames{why}")
    return not failed


def followed(estimates: Sequence[Estimate]) -> bool:
    """Whether a person is tracked in half of the frames or more in which it is there."""
    there = [estimate.status for estimate in estimates if estimate.status != "absent"]
    known = sum(status in ("tracked", "ambiguous") for status in there)
    return bool(there) and 2 * known >= len(there)
