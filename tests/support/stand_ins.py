"""Replacements of workers: defined by their answer, or with particles that do not move."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
from numpy.typing import NDArray

from gepf.common.body import BodyModel
from gepf.common.camera import Intrinsics
from gepf.common.frame import SubjectFrame
from gepf.common.refinement import Particles, Refined
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.cli import main
from gepf.coordinator.pool.options import Pool, PoolStatistics
from gepf.coordinator.tracking.refiner import LocalRefiner, Request
from gepf.coordinator.tracking.warm_up import unmoved
from gepf.refiners import DirectRefiner
from tests.support.people import rendered
from tests.support.recordings import write_open3d


def no_workers(*_: object) -> NoReturn:
    """In place of workers where none may be started."""
    raise AssertionError("workers were asked for")


class StandIn(LocalRefiner):
    """A Refiner that ignores frames."""

    statistics = PoolStatistics()
    run = "none"

    def wait_for(self, lanes: int) -> None:
        """They are there."""
        del lanes

    def listen(self, key: str, on_message: Callable[[bytes], None]) -> None:
        """Do nothing."""
        del key, on_message

    def speak(self, key: str) -> Any:
        """There is no bus."""
        raise NotImplementedError(key)

    @contextmanager
    def connect(self, pool: Pool, report: Callable[[str], None]) -> Iterator[Any]:
        """Stand in for a pool of workers."""
        del pool
        report("workers are there")
        yield self


class Direct(StandIn, DirectRefiner):
    """Refines in this process."""

    statistics = PoolStatistics(workers_seen=("here",))


CAMERA = Intrinsics(64, 48, 50.0, 50.0, 32.0, 24.0)
START = {"root_tz": 2.0, "r_elbow_flexion": 0.5}


class StillWorkers(StandIn):
    """Leaves particles where they are; before frame `fail_at` it raises `failure`."""

    statistics = PoolStatistics(("one", "two"), {"batches_sent_again": 3}, ("zen3",))

    def __init__(self, fail_at: int | None = None, failure: BaseException | None = None) -> None:
        self.fail_at = fail_at
        self.failure = failure
        self.asked = Pool()
        self.before: Callable[[int], object] = lambda _: None  # a frame

    def submit(self, subject: SubjectFrame, model: BodyModel, particles: Particles) -> Request:
        """Keep the particles; or fail, if it is time."""
        number = subject.number
        self.before(number)
        if number == self.fail_at and self.failure is not None:
            raise self.failure
        assert particles.poses.shape[1] == len(model.dof_names)
        assert particles.settings.noise_depth >= particles.settings.noise_lateral
        return super().submit(subject, model, particles)

    def refine(self, _subject: SubjectFrame, _model: BodyModel, particles: Particles) -> Refined:
        """The same poses, all equally likely."""
        return unmoved(particles)

    def track(self, sequence: Path, out: Path, *options: str) -> int:
        """The exit code of `gepf track` by these, without pictures."""
        return main(["track", str(sequence), "--out", str(out), "--no-pictures", *options], self.connect)

    @contextmanager
    def connect(self, pool: Pool, report: Callable[[str], None]) -> Iterator[Any]:
        """Note what pool is asked for."""
        self.asked = pool
        with super().connect(pool, report):
            yield self


@pytest.fixture
def workers() -> StillWorkers:
    """Workers for whoever calls `gepf track`."""
    return StillWorkers()


class Desk:
    """Where a user types `gepf track`: a recording, workers, a folder for the results, and what was said."""

    def __init__(
        self, sequence: Path, workers: StillWorkers, out: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        self.sequence = sequence
        self.workers = workers
        self.out = out
        self._capsys = capsys

    def track(self, *options: str, out: Path | None = None) -> int:
        """The exit code of a run, without pictures."""
        return self.workers.track(self.sequence, out or self.out, *options)

    def fail(self, at: int | None, failure: BaseException | None = None) -> None:
        """Have the workers fail at a frame, or no more."""
        self.workers.fail_at, self.workers.failure = at, failure or KeyboardInterrupt()

    def said(self) -> list[str]:
        """Lines on stderr since the last look."""
        return self._capsys.readouterr().err.splitlines()

    @property
    def summary(self) -> dict[str, Any]:
        """The summary of the run."""
        content: dict[str, Any] = json.loads((self.out / "summary.json").read_text())
        return content

    def files(self) -> dict[Path, bytes]:
        """What the folder of results holds."""
        return {path: path.read_bytes() for path in self.out.iterdir()}


@pytest.fixture
def desk(sequence: Path, workers: StillWorkers, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Desk:
    """A desk with five frames of a person."""
    return Desk(sequence, workers, tmp_path / "out", capsys)


@pytest.fixture
def sequence(tmp_path: Path) -> Path:
    """Five frames of a person at two metres, with a start; nothing is seen in frame 3."""
    depth = np.repeat(standing()[None], 5, axis=0)
    depth[3] = 0
    folder = write_open3d(tmp_path / "person", depth, CAMERA)
    (folder / "init.json").write_text(json.dumps(START))
    return folder


@cache
def standing() -> NDArray[np.uint16]:
    """The person as it starts, in millimetres."""
    (depth,) = rendered(human(), name_pose(human(), START)[None], CAMERA)
    return np.rint(1000.0 * depth).astype(np.uint16)
