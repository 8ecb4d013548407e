"""What the command line's texts and numbers mean, checked before anything is read or written."""

from __future__ import annotations

import math

import msgspec

from common.errors import InputError
from common.settings import Settings
from common.transport.session import COORDINATOR, Security
from coordinator.commands.options.arguments import SecurityOptions
from coordinator.filters.methods import find_method, settings_for
from coordinator.pool.options import Pool
from coordinator.security.access import TlsFiles, choose_security

LARGEST_NOISE = 1.0  # metres

QUARTERS = (0, 90, 180, 270)  # degrees that --rotate knows


def choose_settings(
    method: str, preset_name: str, particles: int | None, points: int | None, seed: int
) -> Settings:
    """A preset's settings with what the user asked for instead."""
    if not 0 <= seed < 2**63:
        raise InputError(f"--seed {seed} is out of range; give 0 to {2**63 - 1}")
    for option, number in (("--particles", particles), ("--points", points)):
        if number is not None:
            at_least(1, option, number)
    return msgspec.structs.replace(settings_for(method, preset_name, particles, points), seed=seed)


def set_rotation(settings: Settings, rotate: str) -> Settings:
    """Settings for a camera that is held the way up that --rotate says; `auto` finds it."""
    if rotate not in ("auto", *map(str, QUARTERS)):
        raise InputError(f"--rotate {rotate} makes no sense; give {', '.join(map(str, QUARTERS))} or auto")
    return msgspec.structs.replace(settings, rotate_deg=None if rotate == "auto" else int(rotate))


def set_noise(settings: Settings, depth: float | None, lateral: float | None) -> Settings:
    """Settings for a camera's noise that is known, metres; None leaves the preset's, or both are measured."""
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


def secure(
    options: SecurityOptions, listen: str | None, connect: str | None, holder: str = COORDINATOR
) -> Security | None:
    """Certificate and access rules for these endpoints; InputError where they do not fit together."""
    files = TlsFiles(options.tls_ca, options.tls_cert, options.tls_key)
    return choose_security(listen, connect, files, holder=holder, insecure=options.insecure)


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
    if not find_method(method).descends:
        raise InputError(f"method {method} needs an answer for every particle; leave --deadline out")
    if not 0 < milliseconds < math.inf:
        raise InputError(f"--deadline {milliseconds:g} is no time for a frame; give milliseconds above 0")
    return milliseconds / 1000


def choose_idle_timeout(seconds: float | None) -> float | None:
    """Seconds of silence after which live input is over; None for never."""
    if seconds is not None and not 0 < seconds < math.inf:
        raise InputError(f"--idle-timeout {seconds:g} is no time to wait; give seconds above 0")
    return seconds


def choose_dofs(names: str | None) -> tuple[str, ...] | None:
    """Names of degrees of freedom between commas; None for the model's own choice."""
    if names is None:
        return None
    listed = tuple(name.strip() for name in names.split(",") if name.strip())
    if not listed:
        raise InputError("--dof names nothing; give names between commas, such as r_elbow_flexion")
    return listed


def at_least(least: int, option: str, number: int) -> int:
    """`number`, if it is not too small."""
    if number < least:
        raise InputError(f"{option} {number} is too small; give {least} or more")
    return number
