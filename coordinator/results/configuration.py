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

PACKAGES = ("gepf", "eclipse-zenoh", "msgpack", "msgspec", "numba", "numpy", "open3d", "scipy")


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


PATH = "path"  # where the sequence was, for later reference; it does not influence results
LETTERS = 12  # of a hash


def digest_frame(frame: DepthFrame) -> str:
    """A hash of a frame: of its depth and its camera."""
    camera = repr((*msgspec.structs.astuple(frame.intrinsics), frame.depth_scale, frame.time_s))
    return digest(camera.encode() + frame.depth.tobytes())


def digest(content: bytes) -> str:
    """A few letters that stand for the content."""
    return hashlib.sha256(content).hexdigest()[:LETTERS]


if TYPE_CHECKING:  # it brings the compiler, which takes long to load
    from coordinator.bodies.tracked import Bodies
    from coordinator.scene.scope import Scope

RunConfiguration = dict[str, Any]
"""Nested names and values, as JSON holds them."""

OPTIONS = {
    "sequence": "the sequence",
    "first_frame": "the sequence's first frame",
    "settings.method": "--method",
    "settings.preset": "--preset",
    "settings.filter.particles": "--particles",
    "settings.points": "--points",
    "settings.refine.noise_depth": "--noise-depth",
    "settings.refine.noise_lateral": "--noise-lateral",
    "settings.seed": "--seed",
    "settings.rotate_deg": "--rotate",
    "model.name": "--model",
    "model.content": "the content of --model",
    "dof": "--dof",
    "init": "--init",
    "joint_states": "--joint-states",
    "frame_range": "--frames",
    "deadline_ms": "--deadline",
    "scene.person": "--person",
    "scene.near": "--near",
    "scene.far": "--far",
    "scene.roi": "--roi",
    "scene.background": "--background",
    "scene.up": "the camera's way up",
    "versions.gepf": "gepf's version",
}
"""Dotted name -> what the user calls it. Names that are not listed are settings without an option."""

GIVEN = "camera_given"  # what the user said of the camera

AUTOMATIC = "auto"  # a start that is found

NAMED = 3  # differences that a message names


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
    joint_states: str | None = None  # a hash of what encoders say


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
        "model": {"name": Path(asked.model).name, "content": None if content is None else content[:LETTERS]},
        "dof": None if asked.active is None else ",".join(asked.active),
        "init": AUTOMATIC if start is None else digest(json.dumps(start, sort_keys=True).encode()),
        "joint_states": asked.joint_states,
        "settings": msgspec.to_builtins(asked.settings),
        "scene": asked.scope.describe(),
        "deadline_ms": None if asked.deadline is None else 1000 * asked.deadline,
        "versions": {"gepf": versions().get("gepf")},
    }
    plain: RunConfiguration = msgspec.json.decode(msgspec.json.encode(configuration))
    return plain


def differences(recorded: Mapping[str, Any], asked: RunConfiguration) -> str:
    """What differs from the recorded configuration, in the user's words; `recorded` may hold more."""
    before, now = dict(flatten(recorded)), dict(flatten(asked))
    order = [*(key for key in OPTIONS if key in now), *(key for key in now if key not in {*OPTIONS, PATH})]
    found = [
        f"{OPTIONS.get(key, 'setting ' + key.removeprefix('settings.'))} "
        f"(recorded {describe_value(before.get(key))}, now {describe_value(now[key])})"
        for key in order
        if key not in before or before[key] != now[key]
    ]
    more = f" and {len(found) - NAMED} more" if len(found) > NAMED else ""
    return ", ".join(found[:NAMED]) + more


def describe_value(value: object) -> str:
    """A value as a message shows it."""
    return "not given" if value is None else str(value)
