"""The tracker that users of the library hold: it brings its own workers, or has none."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.body import BodyModel
from common.closing import Closing
from common.errors import InputError
from common.frame import DepthFrame
from common.settings import Settings, preset
from coordinator.bodies.choice import bodies_of, choose_bodies, choose_model, person
from coordinator.bodies.human.dofs import HUMAN
from coordinator.bodies.human.measures import Measures
from coordinator.bodies.tracked import Bodies
from coordinator.filters.methods import apply_method
from coordinator.results.log import assemble, certainty_of, floor_up
from coordinator.results.recorder import save_run
from coordinator.results.track import TrackedBody
from coordinator.security.access import TlsFiles
from coordinator.tracking.estimate import Estimate as PlainEstimate
from coordinator.tracking.pace import keep_up
from coordinator.tracking.start import Start as DetectedStart
from coordinator.tracking.start import given_start
from coordinator.tracking.start_file import read_start
from coordinator.tracking.tracker import Tracker as FrameTracker
from gepf.images import Images
from gepf.live_source import LiveSource
from gepf.named import Estimate, named
from gepf.refiners import Workers, open_refiner

Body = str | Path | Measures | BodyModel
Start = Mapping[str, float] | str | Path


class Tracker(Closing):
    """Follows one body through depth frames.

    Args:
        model: "human" for a person of any stature, a URDF file, a file of `gepf fit`, a person's measures,
            or any body with all its degrees of freedom.
        settings: What to compute; None for `preset("default")`.
        workers: Who refines: None for this process, on one core; a number of lanes of a local worker; the
            endpoint of a router where workers are; or a Pool. The results are the same, bit for bit.
        start: Values of degrees of freedom in the first frame, metres and radians, or a file of them; None
            to find them, which can be done for people only.
        active: Degrees of freedom to track, None for the usual ones.
        camera: Matrix (3, 3), fx 0 cx, 0 fy cy, 0 0 1 in pixels; needed to track arrays only.
        depth_scale: Units per metre of arrays of whole numbers.
        tls: The authority's certificate, the coordinator's, and its key, for workers at tls/HOST:PORT.

    A context manager: at its end, or with `close`, the workers that it started end. Raises InputError for
    what cannot be tracked.
    """

    def __init__(
        self,
        model: Body = HUMAN,
        settings: Settings | None = None,
        workers: Workers | None = None,
        start: Start | None = None,
        *,
        active: tuple[str, ...] | None = None,
        camera: ArrayLike | None = None,
        depth_scale: float | None = None,
        tls: TlsFiles | None = None,
    ) -> None:
        settings = apply_method(settings or preset("default"))  # checked before any worker starts
        bodies = bodies_to_track(model, active, settings.preset)
        given = read_start(Path(start), bodies.dof_names) if isinstance(start, str | Path) else start
        self._images = Images(camera, depth_scale)
        self._settings, self._frames = settings, 0
        if given is not None:
            given_start(given, bodies)  # checked before any worker starts
        self._stack = ExitStack()
        refiner = open_refiner(workers, tls, self._stack)
        self._made = partial(FrameTracker, refiner, bodies=bodies, start=given)
        self._tracker = self._made(settings)

    def close(self) -> None:
        """End the workers that were started, and leave the pool."""
        self._stack.close()

    @property
    def model(self) -> BodyModel:
        """The body that is tracked, with the names of its degrees of freedom; there after the first frame.

        A person's becomes another one, of the same names, a few times in the first seconds.
        """
        return self._start.model

    @property
    def size(self) -> tuple[float, float] | None:
        """The person's stature, metres, and girth as known by now; None before, and of other bodies."""
        start = self._start
        return (start.stature, start.girth) if np.isfinite(start.stature) else None

    def track(self, depth: DepthFrame | ArrayLike, time_s: float | None = None) -> Estimate:
        """Follow the body into the next frame.

        Args:
            depth: A frame of a source, or an array (H, W): metres as float, or whole numbers in units of
                `depth_scale`; 0 or NaN where nothing was measured.
            time_s: When an array was taken, seconds; None for 30 a second.

        Raises InputError if the first frame shows nothing, or an array is no depth image.
        """
        frame = self._images.frame(depth, self._frames, time_s)
        self._frames += 1
        return self._named(self._tracker.track(frame)[0].estimate)

    def follow(self, frames: Iterable[DepthFrame]) -> Iterator[Estimate]:
        """Track the frames of a source: the estimates of `track`, sooner where there are workers.

        Each estimate is given out while the workers are busy with the next frame; on live input before the
        next frame is taken, which is the newest then. Raises as `track` does.
        """
        if isinstance(frames, LiveSource):
            self._keep_up()
            yield from map(self.track, frames)
            return
        for tracked in self._tracker.follow(frames):
            self._frames += 1
            yield self._named(tracked[0].estimate)

    def save(self, estimates: Iterable[Estimate], folder: str | Path) -> Path:
        """Write estimates as the folder of a run, for `gepf.load`, `gepf report` and `gepf export`.

        Raises InputError where the folder holds something already, or there are no estimates.
        """
        given = list(estimates)
        if not given:
            raise InputError("there is nothing to save; give the estimates that `track` returned")
        start = self._start
        track = assemble(
            start.model, given, held=start.held, up=floor_up(self._tracker.states[0].checkpoint.scene)
        )
        save_run(Path(folder), track, TrackedBody(start.model, start.held), self._settings)
        return Path(folder)

    def joint_deviation(self, estimate: Estimate) -> NDArray[np.float64]:
        """Expected distance (J,) of an estimate's joints from the true ones, metres; NaN where it is lost."""
        return certainty_of(self.model, estimate).deviation

    def _keep_up(self) -> None:
        """Before the first frame, spend no more time on frames that come late, and load what it needs."""
        if self._frames == 0:
            self._settings = keep_up(self._settings)
            self._tracker = self._made(self._settings)
            self._tracker.prepare()

    @property
    def _start(self) -> DetectedStart:
        return self._tracker.states[0].start

    def _named(self, estimate: PlainEstimate) -> Estimate:
        start = self._start
        return named(estimate, start.model, start.held)


def bodies_to_track(model: Body, active: tuple[str, ...] | None, preset_name: str) -> Bodies:
    """The bodies that `model` stands for."""
    match model:
        case Measures():
            return person(model, active, preset_name)
        case BodyModel():
            return bodies_of(model, active)
        case _:
            return choose_bodies(active, preset_name, choose_model(str(model)))
