"""`gepf fit`: track a person through a few frames, then fit the template's measures to what was seen."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from common.activation import activate
from common.body import BodyModel
from common.errors import InputError
from common.settings import Settings
from coordinator.bodies.choice import PERSON_SUFFIX, USUAL, choose_bodies, write_person
from coordinator.bodies.human.dofs import HUMAN_DOFS
from coordinator.bodies.human.measures import Measures
from coordinator.bodies.human.shape_space import shape_space
from coordinator.bodies.tracked import name_pose
from coordinator.commands.console.progress import Show
from coordinator.commands.options.arguments import FitOptions
from coordinator.commands.options.choices import choose_pool, choose_settings
from coordinator.commands.track import choose_start
from coordinator.commands.workers import Connect, end_as_interrupted
from coordinator.pool.options import Pool
from coordinator.sources import Source, open_source
from coordinator.sources.camera import AS_RECORDED, CameraOptions, parse_camera_options
from coordinator.sources.source import select_frames
from coordinator.tracking.known import Known
from coordinator.tracking.observing.isolation import Isolation, PosedBody
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.single import SingleTracker as Tracker
from coordinator.tracking.starting.fitting import MEASURES, WHOLE_FIT, Fit, Fitter, Posed, Sweeps

USED = 20  # frames that are fitted to, spread over those that are explained well
TRACKED = 90  # frames at most, by default


@dataclass(frozen=True, slots=True)
class FitJob:
    """One `gepf fit`."""

    sequence: Path
    out: Path
    settings: Settings
    pool: Pool
    init: str | None = None
    frames: str | None = None
    given: CameraOptions = AS_RECORDED


def run_fit(options: FitOptions, show: Show, connect: Connect[Refiner], sweeps: Sweeps = WHOLE_FIT) -> None:
    """Do a `gepf fit`. Raises InputError for options that make no sense, before anything is read."""
    settings = choose_settings("gepf", "default", None, None, options.seed)
    pool = choose_pool(options.workers, None, None)
    given = parse_camera_options(options.camera.intrinsics, options.camera.depth_scale)
    end_as_interrupted()
    fit_sequence(
        FitJob(options.sequence, options.out, settings, pool, options.init, options.frames, given),
        show,
        connect,
        sweeps,
    )
    if options.as_json:
        sys.stdout.write(options.out.read_text(encoding="utf-8"))


def fit_sequence(job: FitJob, show: Show, connect: Connect[Refiner], sweeps: Sweeps) -> tuple[Fit, Fit]:
    """Fit, report what was found, and write the measures; gives the fit before and after.

    The options and the first frame are checked before anything is tracked.
    """
    require_place(job.out)
    source = open_source(job.sequence, job.given)
    numbers = select_frames(source.numbers, job.frames)
    if job.frames is None:
        numbers = numbers[:TRACKED]
    with connect(job.pool, show) as refiner:
        tracker, frames = follow(job, source, numbers, refiner, show)
        start = tracker.start
        build = builder(start.held, job.settings.preset)
        fitter = Fitter(frames, build, refiner, tracker.rules, sweeps)
        with show.steps("fitting measures") as advance:
            before, after = fitter.fit(Measures.of(start.stature, start.girth), advance)
    write_person(after.measures, job.out)
    for line in describe_fit(before, after):
        show.say(line)
    show.say(f"the measures are in {job.out}; track with --model {job.out}")
    return before, after


def require_place(out: Path) -> None:
    """InputError unless the measures can be written to `out`, and be read from there by --model."""
    if out.suffix != PERSON_SUFFIX:
        raise InputError(f"--out {out} is no name for a person's measures; end it in {PERSON_SUFFIX}")
    there = next(folder for folder in out.absolute().parents if folder.exists())
    if out.is_dir() or not there.is_dir() or not os.access(there, os.W_OK):
        raise InputError(f"cannot write {out}; choose another --out")


def follow(
    job: FitJob, source: Source, numbers: Sequence[int], refiner: Refiner, show: Show
) -> tuple[Tracker, list[Posed]]:
    """Track, and keep some of the frames in which the person was seen well."""
    bodies = choose_bodies(None, job.settings.preset)
    known = Known(choose_start(job.init, source, HUMAN_DOFS))
    tracker = Tracker(refiner, job.settings, bodies, known)
    isolation = Isolation(job.settings.points)
    seen = []
    with show.frames(len(numbers)) as meter:
        for number in numbers:
            frame = source.frame(number)
            estimate = tracker.track(frame)
            meter.advance(estimate)
            if estimate.status != "tracked":
                continue
            subject = isolation.cut(frame, PosedBody(tracker.model, estimate.pose)).subject
            if subject is not None:
                seen.append((estimate.residual, Posed(subject, estimate.pose)))
    if not seen:
        raise InputError(f"the person is tracked in no frame of {source.name}; give other --frames")
    return tracker, spread(explained_well(seen), USED)


def explained_well(seen: Sequence[tuple[float, Posed]]) -> list[Posed]:
    """The frames with the smaller half of the residuals: in the others the pose may be what is wrong."""
    usual = float(np.median([residual for residual, _ in seen]))
    return [frame for residual, frame in seen if residual <= usual]


def spread(frames: Sequence[Posed], count: int) -> list[Posed]:
    """At most `count` frames, evenly spread."""
    chosen = np.unique(np.linspace(0, len(frames) - 1, count).round().astype(int))
    return [frames[n] for n in chosen.tolist()]


def builder(held: Mapping[str, float], preset_name: str) -> Callable[[Measures], BodyModel]:
    """Makes tracked bodies from measures; what does not move is held.

    All have the same vertices, moved: of bodies that were meshed anew each, the likelihood would rather say
    how their vertices happen to lie.
    """

    def build(measures: Measures) -> BodyModel:
        full = shape_space().person(measures)
        return activate(full, USUAL[preset_name], name_pose(full, held))

    return build


def describe_fit(before: Fit, after: Fit) -> list[str]:
    """What was found, as lines for people."""
    old, new = asdict(before.measures), asdict(after.measures)
    changes = [f"{name} {old[name]:.3f} -> {new[name]:.3f}" for name in MEASURES]
    then, now = 1000.0 * before.residual.mean(), 1000.0 * after.residual.mean()
    return [
        f"fitted to {len(after.residual)} frames: {', '.join(changes)}",
        f"mean residual {then:.2f} mm before, {now:.2f} mm after",
    ]
