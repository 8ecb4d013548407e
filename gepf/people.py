"""Several people at once, for users of the library."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from numpy.typing import ArrayLike

from common.closing import Closing
from common.errors import InputError
from common.frame import DepthFrame
from common.settings import Settings, preset
from coordinator.bodies.choice import choose_bodies
from coordinator.bodies.human.dofs import HUMAN
from coordinator.filters.methods import apply_method
from coordinator.results.log import assemble, floor_up
from coordinator.results.people import person_folder
from coordinator.results.recorder import save_run
from coordinator.results.track import TrackedBody
from coordinator.security.access import TlsFiles
from coordinator.tracking.estimate import Estimate as PlainEstimate
from coordinator.tracking.pace import keep_up
from coordinator.tracking.tracker import Tracker
from gepf.images import Images
from gepf.live_source import LiveSource
from gepf.named import Estimate, named
from gepf.refiners import Workers, open_refiner


class PeopleTracker(Closing):
    """Follows up to so many people through depth frames; all of them are found, with their measures.

    Args:
        people: How many at the most.
        settings: What to compute, for each; None for `preset("default")`.
        workers: Who refines, as for `Tracker`.
        active: Degrees of freedom to track, None for the usual ones.
        camera: Matrix (3, 3) in pixels; needed to track arrays only.
        depth_scale: Units per metre of arrays of whole numbers.
        tls: The authority's certificate, the coordinator's, and its key, for workers at tls/HOST:PORT.

    A context manager: at its end, or with `close`, the workers that it started end. The first person is who
    was found first. Raises InputError for what cannot be tracked.
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
        tls: TlsFiles | None = None,
    ) -> None:
        if people < 1:
            raise InputError(f"people={people} would track nobody; give 1 or more")
        self._settings = apply_method(settings or preset("default"))
        bodies = choose_bodies(active, self._settings.preset, HUMAN)
        self._images, self._frames = Images(camera, depth_scale), 0
        self._stack = ExitStack()
        refiner = open_refiner(workers, tls, self._stack)
        self._made = partial(Tracker, refiner, bodies=bodies, people=people)
        self._tracker = self._made(self._settings)

    def close(self) -> None:
        """End the workers that were started, and leave the pool."""
        self._stack.close()

    @property
    def found(self) -> int:
        """How many people have been found so far: the first so many of each list of estimates."""
        return sum(state.start.found for state in self._tracker.states)

    def track(self, depth: DepthFrame | ArrayLike, time_s: float | None = None) -> list[Estimate]:
        """Follow all into the next frame, as `Tracker.track` does; an estimate a person, found or not."""
        frame = self._images.frame(depth, self._frames, time_s)
        self._frames += 1
        return self._named([each.estimate for each in self._tracker.track(frame)])

    def follow(self, frames: Iterable[DepthFrame]) -> Iterator[list[Estimate]]:
        """Track the frames of a source: the estimates of `track`, sooner where there are workers.

        On live input each frame is the newest when the one before is done.
        """
        if isinstance(frames, LiveSource):
            self._keep_up()
            yield from map(self.track, frames)
            return
        for tracked in self._tracker.follow(frames):
            self._frames += 1
            yield self._named([each.estimate for each in tracked])

    def save(self, estimates: Iterable[list[Estimate]], folder: str | Path) -> list[Path]:
        """Write the run of each person who was found into `person1/`, ... in the folder; gives these.

        Raises InputError where one holds something already, or nobody was found.
        """
        given = list(estimates)
        if not given or not self.found:
            raise InputError("there is nobody to save; give the estimates that `track` returned")
        scene, folders = self._tracker.states[0].checkpoint.scene, list[Path]()
        for place in range(self.found):
            start = self._tracker.states[place].start
            own = [frame[place] for frame in given]
            track = assemble(start.model, own, held=start.held, up=floor_up(scene))
            folders.append(person_folder(Path(folder), place + 1))
            save_run(folders[-1], track, TrackedBody(start.model, start.held), self._settings)
        return folders

    def _keep_up(self) -> None:
        """Before the first frame, spend no more time on frames that come late, and load what it needs."""
        if self._frames == 0:
            self._settings = keep_up(self._settings)
            self._tracker = self._made(self._settings)
            self._tracker.prepare()

    def _named(self, estimates: list[PlainEstimate]) -> list[Estimate]:
        starts = [state.start for state in self._tracker.states]
        return [named(e, s.model, s.held) for e, s in zip(estimates, starts, strict=True)]
