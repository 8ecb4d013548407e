"""The trackers of the library."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import fields, replace
from functools import cache, partial
from itertools import groupby
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from rich.progress import track as progress
from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]

from gepf.common.body import BodyModel
from gepf.common.camera import Intrinsics
from gepf.common.closing import Closing
from gepf.common.cores import usable_cores
from gepf.common.errors import InputError
from gepf.common.frame import Frame, check_frame
from gepf.common.packages import MissingPackage
from gepf.coordinator.bodies.choice import choose_bodies, choose_model
from gepf.coordinator.bodies.families import family_of
from gepf.coordinator.bodies.family import Bodies
from gepf.coordinator.bodies.human.dofs import HUMAN
from gepf.coordinator.bodies.human.measures import Measures
from gepf.coordinator.bodies.human.people import PEOPLE
from gepf.coordinator.bodies.human.shape_space import Size
from gepf.coordinator.colour.agreement import ColourStates, describe_changes
from gepf.coordinator.colour.finder import KeypointFinder, without_colour
from gepf.coordinator.files import with_parent
from gepf.coordinator.results.log import assemble, floor_up
from gepf.coordinator.results.recorder import save_run
from gepf.coordinator.results.summary import PERSON
from gepf.coordinator.results.track import TrackedBody
from gepf.coordinator.security.access import TlsFiles
from gepf.coordinator.settings import Settings, preset
from gepf.coordinator.sources import open_source
from gepf.coordinator.sources.arrays import ArraySource, median_depth
from gepf.coordinator.sources.camera import DEFAULT_FPS
from gepf.coordinator.sources.source import FARTHEST_M
from gepf.coordinator.tracking import tracker as tracking
from gepf.coordinator.tracking.estimate import Estimate as PlainEstimate
from gepf.coordinator.tracking.reporting import TrackedPerson
from gepf.coordinator.tracking.state import read_start, start_at
from gepf.coordinator.tracking.target import resolve
from gepf.live_source import LiveSource
from gepf.named import Estimate
from gepf.refiners import Workers, log, open_refiner
from gepf.run import Run, load

Body = str | Path | Measures | BodyModel
Start = Mapping[str, float] | str | Path
Item = TypeVar("Item")


class FrameLoop(Closing):
    """Base class of the trackers of one body and of several people: frames in, estimates out."""

    def __init__(  # noqa: PLR0913 one parameter an input
        self,
        bodies: Bodies,
        settings: Settings,
        workers: Workers | None,
        tls: TlsFiles | None,
        camera: ArrayLike | None,
        depth_scale: float | None,
        people: int = 1,
        start: Mapping[str, float] | None = None,
        *,
        color: bool,
    ) -> None:
        settings = resolve(settings, bodies.family)
        finder, self._unused = None, ""  # why colour is not used, until the user has been told
        if color and bodies.family.has_keypoints and settings.refine.sensor == "camera":
            try:
                finder = KeypointFinder()
            except MissingPackage as missing:
                self._unused = f"{without_colour(missing)}; or color=False"
        self._settings, self._frames = settings, 0
        self._camera, self._depth_scale, self._cameras = camera, depth_scale, dict[str, Intrinsics]()
        self._stack = ExitStack()
        refiner = open_refiner(workers, tls, self._stack)
        self._make = partial(
            tracking.Tracker, refiner, settings, bodies, people=people, start=start, colour=finder
        )
        self._tracker, self._colours = self._make(), ColourStates()

    def close(self) -> None:
        """Stop the workers that this tracker started, and leave the pool."""
        self._stack.close()

    def _track(self, depth: Frame | ArrayLike, time_s: float | None) -> list[Estimate]:
        (estimates,) = self._follow([self._frame_of(depth, time_s)], look_ahead=False)
        return estimates

    def _follow(self, frames: Iterable[Frame], *, look_ahead: bool = True) -> Iterator[list[Estimate]]:
        """Track a source. Each stream of live input gets a new tracker; its frames are tracked on arrival."""
        live = frames if isinstance(frames, LiveSource) else None
        checked = frames if live is not None else (check_frame(each, self._cameras) for each in frames)
        frames = map(self._say_unused, checked)
        if live is not None and self._frames == 0:  # load now, so that no live frame has to wait for it
            self._tracker.prepare()
        last = 0 if live is None else live.stream
        for stream, part in groupby(frames, lambda _: 0 if live is None else live.stream):
            if stream != last:
                self._tracker, last = self._make(), stream
            tracked_frames = self._tracker.follow(part, look_ahead=look_ahead, live=live)
            for tracked in with_one_blas_thread(tracked_frames):
                if tracked.state.colours != self._colours:
                    for line in describe_changes(self._colours, tracked.state.colours):
                        log.warning(line)
                    self._colours = tracked.state.colours
                self._frames += 1
                yield [with_body(person) for person in tracked.people]

    def _say_unused(self, frame: Frame) -> Frame:
        """Return the frame; if its colour is not used, warn once with the reason."""
        if self._unused and frame.has_colours:
            log.warning(self._unused)
            self._unused = ""
        return frame

    def _frame_of(self, depth: Frame | ArrayLike, time_s: float | None) -> Frame:
        """The frame itself, or the next frame from an array (H, W)."""
        if isinstance(depth, Frame):
            return depth
        if self._camera is None:
            raise InputError("an array has no camera; give its matrix when creating the tracker: camera=...")
        array = np.asarray(depth)
        if array.ndim != 2:
            raise InputError(f"depth has shape {array.shape}; give one frame (H, W)")
        in_metres = array.dtype.kind == "f" and median_depth(array) <= FARTHEST_M
        scale = None if in_metres else self._depth_scale
        alone = ArraySource(array[None], self._camera, scale, name="array").view(0)
        when = self._frames / DEFAULT_FPS if time_s is None else time_s
        return Frame.of(replace(alone, number=self._frames, time_s=when))

    def _save(self, estimates: Iterable[Estimate], place: int, folder: Path) -> Path:
        """Write one person's estimates as the folder of a run."""
        tracker_state = self._tracker.state
        state, up = tracker_state.people[place], floor_up(tracker_state.frame.scene_changes)
        start = state.start
        track = assemble(state.body, list(estimates), held=start.held, up=up)
        save_run(folder, track, TrackedBody(state.body, start.held), self._settings)
        return folder


def with_body(tracked: TrackedPerson) -> Estimate:
    """An estimate with its body."""
    state, start = tracked.state, tracked.state.start
    values = {f.name: getattr(tracked.estimate, f.name) for f in fields(PlainEstimate)}
    shape = state.shape.copy()  # so that it does not share memory with the tracker's state
    shape.setflags(write=False)
    return Estimate(**values, flexible=start.model, shape=shape, held=start.held)


def with_one_blas_thread(items: Iterator[Item]) -> Iterator[Item]:
    """The items, each computed with one thread of BLAS.

    More threads do not speed up small matrices, and take the processor cores from the workers. Between the
    items the number of threads is that of the caller.
    """
    while True:
        with blas_libraries().limit(limits=1):
            item = next(items, None)
        if item is None:
            return
        yield item


@cache
def blas_libraries() -> ThreadpoolController:
    """The BLAS libraries loaded by the first frame. Cached: finding them takes a tenth of a frame's time."""
    return ThreadpoolController().select(user_api="blas")


def settings_or_default(settings: Settings | None) -> Settings:
    """These settings, or the usual ones; InputError for anything else."""
    if settings is None:
        return preset("default")
    if not isinstance(settings, Settings):
        raise InputError(
            f"settings is a {type(settings).__name__}, not a preset; give gepf.preset('paper'), or change a"
            " preset: msgspec.structs.replace(gepf.preset('default'), seed=1)"
        )
    return settings


class Tracker(FrameLoop):
    """Tracks one body through depth frames.

    Args:
        model: "human" for a person of any stature, a URDF file, a file with a person's measures, `Measures`,
            or a `BodyModel` with all its degrees of freedom.
        settings: What to compute; None for `preset("default")`.
        workers: Where particles are refined: None for this process, on one core; the number of lanes of a
            local worker; the endpoint of a router with workers; or a Pool. The results are the same, bit for
            bit.
        start: Values of degrees of freedom in the first frame, metres and radians, or a file of them; None
            to detect the body.
        active: Degrees of freedom to track; None for the default ones.
        camera: Matrix (3, 3), fx 0 cx, 0 fy cy, 0 0 1 in pixels; needed only for arrays.
        depth_scale: Units per metre of integer arrays.
        color: Whether colour of frames is used, for people; needs the extra `color`.
        tls: The authority's certificate, the coordinator's, and its key, for workers at tls/HOST:PORT.

    A context manager: its workers end with it, or with `close`. Raises InputError for an invalid model, start
    or setting.
    """

    def __init__(  # noqa: PLR0913 one parameter an input
        self,
        model: Body = HUMAN,
        settings: Settings | None = None,
        workers: Workers | None = None,
        start: Start | None = None,
        *,
        active: tuple[str, ...] | None = None,
        camera: ArrayLike | None = None,
        depth_scale: float | None = None,
        color: bool = True,
        tls: TlsFiles | None = None,
    ) -> None:
        settings = settings_or_default(settings)
        bodies = bodies_to_track(model, active, settings.preset)
        given = read_start(Path(start), bodies.dof_names) if isinstance(start, str | Path) else start
        if given is not None:
            start_at(given, bodies)  # checked before any worker starts
        super().__init__(bodies, settings, workers, tls, camera, depth_scale, start=given, color=color)

    @property
    def model(self) -> BodyModel:
        """The tracked body, with the names of its degrees of freedom; valid after the first frame.

        If a person's size is estimated, each frame gives another model with the same names.
        """
        return self._tracker.state.people[0].body

    @property
    def size(self) -> tuple[float, float] | None:
        """Estimated stature of the person, metres, and girth; None before detection, and for other bodies."""
        person = self._tracker.state.people[0]
        if person.start.family is not PEOPLE or not person.size:
            return None
        size = Size(*person.size)
        return size.stature, size.girth

    def track(self, depth: Frame | ArrayLike, time_s: float | None = None) -> Estimate:
        """Track the body in the next frame.

        Args:
            depth: A frame of a source, or an array (H, W): metres as float, or integers in units of
                `depth_scale`; 0 or NaN for no depth.
            time_s: Time of an array, seconds; None for 30 frames per second.

        Raises InputError if the first frame has no depth, an array is not a depth image, or a frame is
        invalid or comes from a different camera than the earlier frames.
        """
        return self._track(depth, time_s)[0]

    def follow(self, frames: Iterable[Frame]) -> Iterator[Estimate]:
        """Track the frames of a source: the estimates of `track`, but faster with workers.

        Each estimate is yielded while the workers refine the next frame. With live input, it is yielded at
        once, the newest frame is tracked next, and each new stream starts tracking again. Raises the errors
        of `track`.
        """
        for (estimate,) in self._follow(frames):
            yield estimate

    def save(self, estimates: Iterable[Estimate], folder: str | Path) -> Path:
        """Write estimates as the folder of a run, for `gepf.load`, `gepf report` and `gepf export`.

        Raises InputError if the folder is not empty, or there are no estimates.
        """
        given = list(estimates)
        if not given:
            raise InputError("there is nothing to save; give the estimates that `track` returned")
        return self._save(given, 0, Path(folder))


class PeopleTracker(FrameLoop):
    """Tracks several people through depth frames; they are detected, and their sizes are estimated.

    Args:
        people: Largest number of people.
        settings: What to compute, for each person; None for `preset("default")`.
        workers: Where particles are refined, as for `Tracker`.
        active: Degrees of freedom to track; None for the default ones.
        camera: Matrix (3, 3) in pixels; needed only for arrays.
        depth_scale: Units per metre of integer arrays.
        color: Whether colour of frames is used, for people; needs the extra `color`.
        tls: The authority's certificate, the coordinator's, and its key, for workers at tls/HOST:PORT.

    A context manager: its workers end with it, or with `close`. People are numbered in the order of their
    detection. Raises InputError for invalid settings.
    """

    def __init__(
        self,
        people: int = 2,
        settings: Settings | None = None,
        workers: Workers | None = None,
        *,
        active: tuple[str, ...] | None = None,
        camera: ArrayLike | None = None,
        depth_scale: float | None = None,
        color: bool = True,
        tls: TlsFiles | None = None,
    ) -> None:
        if people < 1:
            raise InputError(f"people={people} would track no one; give 1 or more")
        settings = settings_or_default(settings)
        bodies = choose_bodies(active, settings.preset, HUMAN)
        super().__init__(bodies, settings, workers, tls, camera, depth_scale, people, color=color)

    @property
    def found(self) -> int:
        """Number of people found so far; their estimates come first in each list."""
        return sum(person.start.found for person in self._tracker.state.people)

    def track(self, depth: Frame | ArrayLike, time_s: float | None = None) -> list[Estimate]:
        """Track all people in the next frame, as `Tracker.track`; one estimate per person, found or not."""
        return self._track(depth, time_s)

    def follow(self, frames: Iterable[Frame]) -> Iterator[list[Estimate]]:
        """Track the frames of a source: the estimates of `track`, but faster with workers.

        With live input, the newest frame is always tracked next.
        """
        return self._follow(frames)

    def save(self, estimates: Iterable[list[Estimate]], folder: str | Path) -> list[Path]:
        """Write the run of each found person into `person1/`, ... in the folder; returns these folders.

        Raises InputError if one of them is not empty, or no person was found.
        """
        given, folder = list(estimates), Path(folder)
        if not given or not self.found:
            raise InputError("there is no person to save; give the estimates that `track` returned")
        return [
            self._save((frame[place] for frame in given), place, folder / f"{PERSON}{place + 1}")
            for place in range(self.found)
        ]


def track(
    recording: str | Path,
    out: str | Path | None = None,
    *,
    color: bool | str | Path = True,
    quiet: bool = False,
    **options: Any,
) -> Run:
    """Track a recording, with a progress bar, and return its run.

    Args:
        recording: Any format that `open_source` opens.
        out: New folder for the run; None for a temporary one.
        color: Whether the recording's colour is used to track people; or a folder with other colour images.
        quiet: Show no progress.
        options: Arguments of `Tracker`; `workers` is one lane per core by default.

    Raises InputError for an invalid recording or option before anything is tracked. After a later error
    or interrupt, the folder holds a run with the frames tracked until then.
    """
    source = open_source(recording, color=color)
    folder = Path(tempfile.mkdtemp(prefix="gepf-")) / "run" if out is None else Path(out)
    with_parent(folder)
    options = {"workers": usable_cores(), "start": source.init, "color": color is not False} | options
    with Tracker(**options) as tracker:
        frames = tracker.follow(source)
        estimates = list[Estimate]()
        try:
            estimates.extend(progress(frames, "tracking", len(source), transient=True, disable=quiet))
        except BaseException:
            if estimates:
                with suppress(InputError):
                    saved = tracker.save(estimates, folder)
                    log.warning("tracking ended early; its first %d frames are in %s", len(estimates), saved)
            raise
        return load(tracker.save(estimates, folder))


def bodies_to_track(model: Body, active: tuple[str, ...] | None, preset_name: str) -> Bodies:
    """The bodies that `model` describes."""
    match model:
        case Measures():
            return PEOPLE.measured(model, active, preset_name)
        case BodyModel():
            return family_of(model).given(model, active, preset_name)
        case _:
            return choose_bodies(active, preset_name, choose_model(str(model)))
