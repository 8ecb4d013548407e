"""A run's configuration: what decides its results. A run is resumed under the same one only."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from common.frame import DepthFrame
from common.settings import Settings
from coordinator.sources.camera import AS_RECORDED, CameraOptions

if TYPE_CHECKING:  # it brings the compiler, which takes long to load
    from coordinator.bodies.tracked import Bodies
    from coordinator.scene.scope import Scope

PACKAGES = ("gepf", "eclipse-zenoh", "msgpack", "msgspec", "numba", "numpy", "scipy")
PEOPLE = "people"  # how many were asked for, where it is not one
PATH = "path"  # where the sequence was, for later reference; it does not influence results
GIVEN = "camera_given"  # what the user said of the camera
AUTOMATIC = "auto"  # a start that is found
HASH_LETTERS = 12

RunConfiguration = dict[str, Any]
"""Nested names and values, as JSON holds them."""


def versions() -> dict[str, str]:
    """Of Python and of the packages that decide results; what is not installed is left out."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def flatten(configuration: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, object]]:
    """Pairs of dotted name and value."""
    for key, value in configuration.items():
        if isinstance(value, Mapping):
            yield from flatten(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def digest_frame(frame: DepthFrame) -> str:
    """A hash of a frame: of its depth and its camera."""
    camera = repr((*msgspec.structs.astuple(frame.intrinsics), frame.depth_scale, frame.time_s))
    return digest(camera.encode() + frame.depth.tobytes())


def digest(content: bytes) -> str:
    """A few letters that stand for the content."""
    return hashlib.sha256(content).hexdigest()[:HASH_LETTERS]


@dataclass(frozen=True, slots=True)
class Asked:
    """The request for a run, besides its input."""

    settings: Settings
    bodies: Bodies
    model: str  # as the user named it
    active: Sequence[str] | None
    start: Mapping[str, float] | None  # None for one that is found
    deadline: float | None  # seconds
    scope: Scope  # what of the scene is tracked
    joint_states: str | None  # a hash of what encoders say
    people: int  # at the most


def run_configuration(
    sequence: Path,
    first: DepthFrame,
    numbers: Sequence[int],
    asked: Asked,
    given: CameraOptions = AS_RECORDED,
) -> RunConfiguration:
    """The configuration of a run; who does the work and where the results go is not among them."""
    recording: RunConfiguration = {
        "sequence": sequence.resolve().name,
        PATH: str(sequence.resolve()),
        "first_frame": digest_frame(first),
        "frame_range": f"{numbers[0]}:{numbers[-1] + 1}",
    }
    if given != AS_RECORDED:
        recording[GIVEN] = {
            "lens": given.intrinsics and list(given.intrinsics),
            "depth_scale": given.depth_scale,
        }
    return recording | requested_configuration(asked)


def live_run_configuration(key: str, asked: Asked) -> RunConfiguration:
    """The configuration of a run on live input, which cannot be resumed."""
    return {"sequence": key} | requested_configuration(asked)


def requested_configuration(asked: Asked) -> RunConfiguration:
    """The part of a configuration that does not depend on the input."""
    content, start = asked.bodies.content, asked.start
    configuration = {
        "model": {
            "name": Path(asked.model).name,
            "content": None if content is None else content[:HASH_LETTERS],
        },
        "dof": None if asked.active is None else ",".join(asked.active),
        "init": AUTOMATIC if start is None else digest(json.dumps(start, sort_keys=True).encode()),
        "joint_states": asked.joint_states,
        "settings": msgspec.to_builtins(asked.settings),
        "scene": asked.scope.describe(),
        "deadline_ms": None if asked.deadline is None else 1000 * asked.deadline,
        "versions": {"gepf": versions().get("gepf")},
    }
    if asked.people > 1:
        configuration[PEOPLE] = asked.people
    plain: RunConfiguration = msgspec.json.decode(msgspec.json.encode(configuration))
    return plain


def differences(recorded: Mapping[str, Any], asked: RunConfiguration) -> str:
    """The first that differs from the recorded configuration, by dotted name, and how many more do.

    `recorded` may hold more than what is asked for.
    """
    before, now = dict(flatten(recorded)), dict(flatten(asked))
    found = [
        f"{key} (recorded {before.get(key, 'not given')}, now {value})"
        for key, value in now.items()
        if key != PATH and (key not in before or before[key] != value)
    ]
    return "".join(found[:1]) + (f" and {len(found) - 1} more" if len(found) > 1 else "")
