"""The tracker that users of the library hold: it brings its own workers, or has none."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.body import BodyModel
from common.errors import InputError
from common.frame import DepthFrame
from common.settings import Settings, preset
from coordinator.bodies.choice import bodies_of, choose_bodies, choose_model, person
from coordinator.bodies.human.measures import Measures
from coordinator.bodies.human.mpeg4 import HUMAN
from coordinator.bodies.tracked import Bodies
from coordinator.filters.methods import apply_method
from coordinator.pool.options import Pool
from coordinator.pool.zenoh_refiner import ZenohRefiner
from coordinator.results.model_file import TrackedBody
from coordinator.results.recording.recorded import assemble, certainty_of, floor_up
from coordinator.results.recording.saving import save_run
from coordinator.security.tls import TlsFiles, choose_security
from coordinator.sources.arrays import camera_of, whole_depth
from coordinator.sources.camera_file import DEFAULT_FPS
from coordinator.tracking.estimate import Estimate as PlainEstimate
from coordinator.tracking.pipeline import follow
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.starting.start import given_start
from coordinator.tracking.starting.start_file import read_start
from coordinator.tracking.tracker import Tracker as FrameTracker
from gepf.direct import DirectRefiner
from gepf.named import Estimate, named

log = logging.getLogger("gepf")

Body = str | Path | Measures | BodyModel
Workers = int | str | Pool
Start = Mapping[str, float] | str | Path


class Tracker:
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
    ) -> None:
        settings = apply_method(settings or preset("default"))  # checked before any worker starts
        bodies = bodies_to_track(model, active, settings.preset)
        given = read_start(Path(start), bodies.dof_names) if isinstance(start, str | Path) else start
        self._images = Images(camera, depth_scale)
        self._settings, self._frames = settings, 0
        if given is not None:
            given_start(given, bodies)  # checked before any worker starts
        self._stack = ExitStack()
        self._tracker = FrameTracker(open_refiner(workers, self._stack), settings, bodies, given)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the workers that were started, and leave the pool."""
        self._stack.close()

    @property
    def model(self) -> BodyModel:
        """The body that is tracked, with the names of its degrees of freedom; there after the first frame.

        A person's becomes another one, of the same names, a few times in the first seconds.
        """
        return self._tracker.model

    @property
    def size(self) -> tuple[float, float] | None:
        """The person's stature, metres, and girth as known by now; None before, and of other bodies."""
        start = self._tracker.start
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
        return self._named(self._tracker.track(frame))

    def follow(self, frames: Iterable[DepthFrame]) -> Iterator[Estimate]:
        """Track the frames of a source: the estimates of `track`, sooner where there are workers.

        Each estimate is given out while the workers are busy with the next frame. Raises as `track` does.
        """
        for estimate, _ in follow(self._tracker, frames):
            self._frames += 1
            yield self._named(estimate)

    def save(self, estimates: Iterable[Estimate], folder: str | Path) -> Path:
        """Write estimates as the folder of a run, for `gepf.load`, `gepf report` and `gepf export`.

        Raises InputError where the folder holds something already, or there are no estimates.
        """
        given = list(estimates)
        if not given:
            raise InputError("there is nothing to save; give the estimates that `track` returned")
        start = self._tracker.start
        track = assemble(
            start.model, given, held=start.held, up=floor_up(self._tracker.state.checkpoint.scene)
        )
        save_run(Path(folder), track, TrackedBody(start.model, start.held), self._settings)
        return Path(folder)

    def joint_deviation(self, estimate: Estimate) -> NDArray[np.float64]:
        """Expected distance (J,) of an estimate's joints from the true ones, metres; NaN where it is lost."""
        return certainty_of(self.model, estimate).deviation

    def _named(self, estimate: PlainEstimate) -> Estimate:
        start = self._tracker.start
        return named(estimate, start.model, start.held)


@dataclass(frozen=True, slots=True)
class Images:
    """The camera of arrays: its matrix (3, 3), and units per metre of whole numbers."""

    camera: ArrayLike | None
    depth_scale: float | None

    def frame(self, depth: DepthFrame | ArrayLike, number: int, time_s: float | None) -> DepthFrame:
        """A frame as it is, or an array (H, W) as the frame of this number."""
        if isinstance(depth, DepthFrame):
            return depth
        image = np.asarray(depth)
        if self.camera is None:
            raise InputError("an array comes without its camera; give Tracker(camera=...) its matrix")
        if image.ndim != 2 or 0 in image.shape:
            raise InputError(f"depth has shape {image.shape}; give rows of columns (H, W)")
        units, scale = whole_depth(image, self.depth_scale, "depth")
        camera = camera_of(np.asarray(self.camera), image.shape[1], image.shape[0], "camera")
        when = number / DEFAULT_FPS if time_s is None else time_s
        return DepthFrame(number, when, units, scale, camera)


def open_refiner(workers: Workers | None, stack: ExitStack) -> Refiner:
    """Who refines, until the stack is closed."""
    if workers is None:
        return DirectRefiner()
    return stack.enter_context(ZenohRefiner(choose_workers(workers), log.info))


def bodies_to_track(model: Body, active: tuple[str, ...] | None, preset_name: str) -> Bodies:
    """The bodies that `model` stands for."""
    match model:
        case Measures():
            return person(model, active, preset_name)
        case BodyModel():
            return bodies_of(model, active)
        case _:
            return choose_bodies(active, preset_name, choose_model(str(model)))


def choose_workers(workers: Workers) -> Pool:
    """A pool from its short forms; InputError for one that nobody could join."""
    match workers:
        case Pool():
            return workers
        case str():
            return Pool(0, connect=workers, security=choose_security(None, workers, TlsFiles()))
        case _ if workers < 1:
            raise InputError(f"workers={workers} would refine nothing; give None, 1 or more, or a Pool")
        case _:
            return Pool(workers)
