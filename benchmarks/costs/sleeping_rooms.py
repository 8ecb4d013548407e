"""Workers and coordinators that sleep instead of computing, each the body of a process."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from benchmarks.costs.waiting_workers import serve, waiting
from gepf.common.activation import activate
from gepf.common.body import BodyModel
from gepf.common.camera import Intrinsics
from gepf.common.frame import SUBJECT, SubjectFrame, SubjectView, View
from gepf.common.refinement import Particles
from gepf.coordinator.bodies.human.template import DEFAULT_ACTIVE, human
from gepf.coordinator.pool import scheduler
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from gepf.coordinator.settings import preset

PARTICLES, POINTS, SHAPE = 20, 5_000, (220, 130)  # of a person, in an image of 320 x 240
BEFORE_S, AFTER_S = 0.008, 0.002  # of the tracker before and after the refinement of a frame
FLOOD, FLOOD_PARTICLES = 64, 1_000  # requests at each worker


def work(endpoint: str, name: str, lanes: int, particle_s: float) -> None:
    """A worker whose lanes sleep."""
    serve(endpoint, name, waiting(particle_s, lanes))


def person() -> tuple[BodyModel, SubjectFrame, Particles]:
    """A body, a frame of its size, and particles."""
    template = human()
    model = activate(template, DEFAULT_ACTIVE, np.zeros(len(template.dof_names)))
    depth: NDArray[np.uint16] = np.random.default_rng(0).integers(1900, 2100, SHAPE, dtype=np.uint16)
    camera = Intrinsics(SHAPE[1], SHAPE[0], 290.0, 290.0, SHAPE[1] / 2, SHAPE[0] / 2)
    picked = np.linspace(0, depth.size - 1, POINTS).astype(np.uint32)
    kinds = np.full(SHAPE, SUBJECT, np.uint8)
    view = SubjectView(View(0, 0.0, depth, 1000.0, camera), picked, (0, 0, SHAPE[1], SHAPE[0]), kinds)
    poses = np.zeros((PARTICLES, len(model.dof_names)))
    poses[:, 2] = 2.0
    return model, SubjectFrame(0, 0.0, (view,)), Particles(poses, preset("default").refine, covariance=True)


def track(endpoint: str, file: Path, name: str, fps: float, slow: float) -> None:
    """A coordinator that takes the newest of its frames; writes when each came, and how soon it was known.

    What it sleeps for takes `slow` times as long, and so do the times that the scheduler compares.
    """
    usual = scheduler.LIMITS
    slower = {name: getattr(usual, name) * slow for name in ("long_wait_s", "rest_s", "tick_s")}
    vars(scheduler)["LIMITS"] = msgspec.structs.replace(usual, **slower)
    model, subject, particles = person()
    with ZenohRefiner(Pool(0, connect=endpoint, run=name)) as refiner, file.open("w", buffering=1) as log:
        log.write(f"{fps}\n")
        refiner.wait_for(1)
        phase = int(name.strip("abcdefghijklmnopqrstuvwxyz")) / 8  # cameras are not synchronous
        begin, last = time.monotonic() + phase / fps, -1
        while True:
            number = int((time.monotonic() - begin) * fps)
            if number <= last:
                time.sleep(max(0.0, begin + (last + 1) / fps - time.monotonic()))
                continue
            time.sleep(BEFORE_S * slow)
            shown = replace(subject, number=number)
            refiner.submit(shown, model, particles).result()
            time.sleep(AFTER_S * slow)
            at, last = begin + number / fps, number
            log.write(json.dumps([at, time.monotonic() - at]) + "\n")


def flood(endpoint: str, name: str) -> None:
    """A coordinator that keeps far more requests at each worker than one may, and large ones."""
    vars(scheduler)["LIMITS"] = msgspec.structs.replace(scheduler.LIMITS, max_in_flight=FLOOD)
    model, subject, particles = person()
    many = replace(particles, poses=np.repeat(particles.poses, FLOOD_PARTICLES // PARTICLES, axis=0))
    with ZenohRefiner(Pool(0, connect=endpoint, run=name)) as refiner:
        refiner.wait_for(1)
        pending = [refiner.submit(subject, model, many) for _ in range(FLOOD)]
        while True:
            pending.pop(0).result()
            pending.append(refiner.submit(subject, model, many))
