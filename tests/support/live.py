"""Live frames of a plate: published and tracked over the real bus, and what others hear of it."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gepf.common.body import BodyModel
from gepf.common.frame import View
from gepf.common.kernel import Kernel
from gepf.common.refinement import Particles, Refined
from gepf.common.transport.bus import Bus
from gepf.common.transport.opening import open_worker
from gepf.coordinator.results.live_recorder import read_frames
from gepf.coordinator.tracking.warm_up import unmoved
from gepf.worker.service import Service
from gepf.worker.warm_up import tiny_frame
from tests.support.processes.instant_worker import KERNEL
from tests.support.processes.programs import in_thread
from tests.support.processes.serving import running
from tests.support.recordings import write_open3d

KEY = "camera/depth"
CAMERA = tiny_frame().largest.image.intrinsics
PLATE = """<robot name="plate"><link name="plate"><visual>
<geometry><box size="0.2 0.2 0.1"/></geometry>
</visual></link></robot>"""
AT_TWO_METRES = np.array([0.0, 0.0, 2.05, 0.0, 0.0, 0.0])  # the plate's pose in every frame

Rest = Callable[[threading.Event], object]  # ends when the event is set


def plate_image(number: int, depth: int = 2000, time_s: float | None = None) -> View:
    """A plate in the middle of 32 by 32 pixels, with no depth around it."""
    seen = np.zeros((CAMERA.height, CAMERA.width), dtype=np.uint16)
    seen[8:24, 8:24] = depth
    return View(number, number / 30 if time_s is None else time_s, seen, 1000.0, CAMERA)


class Finder:
    """A worker that finds the plate, slowly."""

    def __init__(self, seconds_per_particle: float = 0.0) -> None:
        self.seconds_per_particle = seconds_per_particle

    def refine(self, _model: BodyModel, _observation: object, particles: Particles) -> Refined:
        """Every particle where the plate is, all equally likely."""
        count = len(particles.poses)
        time.sleep(self.seconds_per_particle * count)
        return unmoved(replace(particles, poses=np.tile(AT_TWO_METRES, (count, 1))))


def joined(where: str, stop: threading.Event) -> Bus:
    """A session that waits for a listener, until the event is set; then the thread ends."""

    def give_up() -> None:
        if stop.is_set():
            raise SystemExit

    return open_worker([where], on_silence=give_up)


@contextmanager
def at_work(where: str, worker: Finder | None = None) -> Iterator[None]:
    """A worker that joins when there is a listener."""
    kernel = Kernel(KERNEL.observe, (worker or Finder()).refine)

    def work(stop: threading.Event) -> None:
        with joined(where, stop) as bus, running(Service(bus, "w", kernel)):
            stop.wait()

    with in_thread(work):
        yield


@contextmanager
def publishing(
    where: str, keys: Iterable[str], steps: Iterable[Mapping[str, bytes]], rest: Rest = bool
) -> Iterator[None]:
    """Publishers, which send steps (messages by key) to listeners, with a rest after each."""

    def publish(stop: threading.Event) -> None:
        with ExitStack() as stack:
            publishers = {key: stack.enter_context(joined(where, stop)).publish(key) for key in keys}

            def heard() -> bool:
                return all(each.has_subscriber for each in publishers.values()) or stop.wait(0.01)

            while not heard():
                pass
            for step in steps:  # made when it is sent
                while not heard():
                    pass
                if stop.is_set():  # nobody may be left who listens
                    return
                for key, message in step.items():
                    publishers[key].put_blocking(message)
                rest(stop)
            stop.wait()

    with in_thread(publish):
        yield


class Listener:
    """What is published on some keys: key, time of reception, message."""

    def __init__(self) -> None:
        self.heard: list[tuple[str, float, bytes]] = []
        self.ready = threading.Event()

    def on(self, key: str) -> list[bytes]:
        """The messages on a key."""
        return [payload for at, _, payload in self.heard if at == key]


@contextmanager
def listening(where: str, *keys: str, opened: Callable[[list[str]], Any] = open_worker) -> Iterator[Listener]:
    """A listener with its own session."""
    listener = Listener()

    def listen(stop: threading.Event) -> None:
        with opened([where]) as bus:
            for key in keys:
                bus.subscribe(key, lambda key, payload: listener.heard.append((key, time.time(), payload)))
            stop.wait(0.5)  # until publishers know of it
            listener.ready.set()
            stop.wait()

    with in_thread(listen):
        yield listener


def recorded_frames(out: Path) -> int:
    """Number of whole frames in the container of a live run."""
    return sum(1 for _ in read_frames(out / "live.mcap"))


def until_recorded(out: Path) -> Rest:
    """A rest until one more frame has been recorded, or the run is over."""
    shown = 0

    def recorded() -> int:
        try:
            return recorded_frames(out)
        except FileNotFoundError:
            return shown

    def rest(stop: threading.Event) -> None:
        nonlocal shown
        shown += 1
        while recorded() < shown and not stop.wait(0.01):
            pass

    return rest


def until_released(semaphore: threading.Semaphore) -> Rest:
    """A rest until this is released once."""

    def rest(stop: threading.Event) -> None:
        while not semaphore.acquire(timeout=0.01) and not stop.is_set():
            pass

    return rest


def tracking(what: str, out: Path, *extra: str, **options: object) -> list[str]:
    """`gepf track` of the plate in a stream, on the workers of others."""
    (out.parent / "plate.urdf").write_text(PLATE)
    (out.parent / "init.json").write_text(json.dumps({"root_tz": AT_TWO_METRES[2]}))
    given: dict[str, object] = {"model": out.parent / "plate.urdf", "init": out.parent / "init.json"}
    given |= {"idle_timeout": 60} | options  # should the end be lost, no test waits for ever
    named = [part for name, value in given.items() for part in (f"--{name.replace('_', '-')}", str(value))]
    return ["track", what, "--out", str(out), "--workers", "0", *named, *extra]


def summary_of(out: Path) -> dict[str, Any]:
    """The summary of a run."""
    content: dict[str, Any] = json.loads((out / "summary.json").read_text())
    return content


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Forty frames of a plate at two metres."""
    depth = np.array([plate_image(number).depth for number in range(40)])
    return write_open3d(tmp_path / "plate", depth, CAMERA)
