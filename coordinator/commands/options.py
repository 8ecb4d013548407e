"""What the command line's texts and numbers mean, checked before anything is read or written."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec

from common.errors import InputError
from common.settings import Settings, preset
from common.transport.session import Security
from coordinator.bodies.choice import HUMAN
from coordinator.bodies.tracked import Bodies
from coordinator.pool.options import Pool
from coordinator.results.run_configuration import Asked

LARGEST_NOISE = 1.0  # metres
BASELINES = {"condensation": 1_000, "annealed": 100}  # particles, unless told; of `annealed` in each layer
METHODS = ("gepf", "gradient", *BASELINES)
LONE_POINTS = 10_000  # for a single particle, which has time for all: few of 4 000 are on an arm
LONE_ITERATIONS = 6  # and has nobody who may be nearer
PRESETS = ("default", "paper")


@dataclass(frozen=True, slots=True)
class Job:
    """One `gepf track`."""

    sequence: Path
    out: Path
    settings: Settings
    pool: Pool
    model: str = HUMAN  # or a file
    active: tuple[str, ...] | None = None  # None for the model's own choice
    init: str | None = None  # a file, AUTOMATIC, or None for the sequence's own file if it has one
    frames: str | None = None
    resume: bool = False
    colour: Path | None = None  # frames to draw results over

    def asked(self, bodies: Bodies, start: Mapping[str, float] | None) -> Asked:
        """What decides the results besides the input."""
        return Asked(self.settings, bodies, self.model, self.active, start, self.pool.deadline)


def choose_settings(
    method: str, preset_name: str, particles: int | None, points: int | None, seed: int
) -> Settings:
    """A preset's settings with what the user asked for instead."""
    settings = preset(one_of("preset", preset_name, PRESETS))
    one_of("method", method, METHODS)
    if not 0 <= seed < 2**63:
        raise InputError(f"--seed {seed} is out of range; give 0 to {2**63 - 1}")
    if points is not None:
        settings = msgspec.structs.replace(settings, points=at_least(1, "--points", points))
    if particles is not None:
        at_least(1, "--particles", particles)
    if method == "gradient":
        if particles not in (None, 1):
            raise InputError("method gradient follows a single particle; leave --particles out")
        particles = 1
        if points is None:
            settings = msgspec.structs.replace(settings, points=max(settings.points, LONE_POINTS))
        thorough = msgspec.structs.replace(settings.refine, icp_iterations=LONE_ITERATIONS)
        settings = msgspec.structs.replace(settings, refine=thorough)
    if method in BASELINES:
        particles = BASELINES[method] if particles is None else particles
        assess = msgspec.structs.replace(settings.refine, icp_iterations=0)
        settings = msgspec.structs.replace(settings, refine=assess)
    if particles is not None:
        chosen = msgspec.structs.replace(settings.filter, particles=particles)
        settings = msgspec.structs.replace(settings, filter=chosen)
    return msgspec.structs.replace(settings, method=method, seed=seed)


def tell_noise(settings: Settings, depth: float | None, lateral: float | None) -> Settings:
    """Settings for noise that the user tells, metres; for what is not told, as the preset has it.

    Where nothing is told, it is measured.
    """
    known = {"noise_depth": depth, "noise_lateral": lateral}
    for name, value in known.items():
        if value is not None and not 0.0 < value <= LARGEST_NOISE:
            option = "--" + name.replace("_", "-")
            raise InputError(f"{option} {value:g} is out of range; give metres, above 0 and up to 1")
    given = {name: value for name, value in known.items() if value is not None}
    if not given:
        return settings
    refine = msgspec.structs.replace(settings.refine, **given)
    return msgspec.structs.replace(settings, refine=refine, measure_noise=False)


def choose_pool(
    workers: int | None,
    listen: str | None,
    connect: str | None,
    security: Security | None = None,
    worker_timeout: float | None = None,
    deadline: float | None = None,
) -> Pool:
    """Workers and endpoints; without workers of our own there must be a way for others to join."""
    if worker_timeout is not None and not 0.0 < worker_timeout < math.inf:
        raise InputError(f"--worker-timeout {worker_timeout:g} is no time to wait; give seconds above 0")
    if workers is not None:
        at_least(0, "--workers", workers)
    if workers == 0 and listen is None and connect is None:
        raise InputError("with --workers 0 nobody could join; add --listen or --connect with an endpoint")
    return Pool(workers, listen, connect, security, worker_timeout, deadline)


def choose_deadline(milliseconds: float | None, method: str) -> float | None:
    """Seconds for a frame; None for as many as it takes."""
    if milliseconds is None:
        return None
    if method in BASELINES:
        raise InputError(f"method {method} needs an answer for every particle; leave --deadline out")
    if not 0 < milliseconds < math.inf:
        raise InputError(f"--deadline {milliseconds:g} is no time for a frame; give milliseconds above 0")
    return milliseconds / 1000


def choose_dofs(names: str | None) -> tuple[str, ...] | None:
    """Names of degrees of freedom between commas; None for the model's own choice."""
    if names is None:
        return None
    listed = tuple(name.strip() for name in names.split(",") if name.strip())
    if not listed:
        raise InputError("--dof names nothing; give names between commas, such as r_elbow_flexion")
    return listed


def one_of(kind: str, name: str, choices: tuple[str, ...]) -> str:
    """`name`, if it is a choice; InputError names them all."""
    if name not in choices:
        raise InputError(f"unknown {kind} '{name}'; choose from {', '.join(choices)}")
    return name


def at_least(least: int, option: str, number: int) -> int:
    """`number`, if it is not too small."""
    if number < least:
        raise InputError(f"{option} {number} is too small; give {least} or more")
    return number
