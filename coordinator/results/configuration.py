"""The configuration of a run, which determines its results. A run is resumed only with the same one."""

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

if TYPE_CHECKING:  # it loads the compiler, which is slow
    from coordinator.bodies.tracked import Bodies
    from coordinator.scene.scope import Scope
    from coordinator.sources.live_stream import LiveCamera

PACKAGES = ("gepf", "eclipse-zenoh", "msgpack", "msgspec", "numba", "numpy", "scipy")
PEOPLE = "people"  # the requested number, if it is not one
PATH = "path"  # of the sequence, for later reference; it does not affect results
GIVEN = "camera_given"  # by the user
AUTOMATIC = "auto"  # the start is detected

RunConfiguration = dict[str, Any]
"""Nested names and values of JSON."""


def versions() -> dict[str, str]:
    """Versions of Python and of the installed packages that affect results."""
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
    """A hash of the depth and camera of a frame."""
    camera = repr((*msgspec.structs.astuple(frame.intrinsics), frame.depth_scale, frame.time_s))
    return digest(camera.encode() + frame.depth.tobytes())


def digest_rig(frame: DepthFrame) -> str:
    """A hash of the frames of all cameras of a rig, and their poses."""
    views = [(view.camera, view.T_rig_camera.tolist(), digest_frame(view)) for view in frame.views]
    return digest(repr(views).encode())


def digest(content: bytes) -> str:
    """A short hash of the content."""
    return hashlib.sha256(content).hexdigest()[:12]


@dataclass(frozen=True, slots=True)
class Asked:
    """The options of a run that affect its results, apart from its input."""

    settings: Settings
    bodies: Bodies
    model: str  # as the user named it
    active: Sequence[str] | None
    start: Mapping[str, float] | None  # None to detect it
    deadline: float | None  # seconds
    scope: Scope
    joint_states: str | None  # a hash of the encoders' values
    people: int  # largest number


def run_configuration(
    sequence: Path,
    first: DepthFrame,
    numbers: Sequence[int],
    asked: Asked,
    given: CameraOptions = AS_RECORDED,
) -> RunConfiguration:
    """The configuration of a run, without workers and output folder."""
    recording: RunConfiguration = {
        "sequence": sequence.resolve().name,
        PATH: str(sequence.resolve()),
        "first_frame": digest_frame(first),
        "frame_range": f"{numbers[0]}:{numbers[-1] + 1}",
    }
    if first.camera:
        recording["rig"] = digest_rig(first)
    if given != AS_RECORDED:
        recording[GIVEN] = {
            "lens": given.intrinsics and list(given.intrinsics),
            "depth_scale": given.depth_scale,
        }
    return recording | requested_configuration(asked)


def live_run_configuration(sequence: str, cameras: Sequence[LiveCamera], asked: Asked) -> RunConfiguration:
    """The configuration of a run on live input, which cannot be resumed."""
    placed = {each.camera: [each.key, each.T_rig_camera.tolist(), each.offset_s] for each in cameras}
    rig = {name: place for name, place in placed.items() if name}
    return {"sequence": sequence, **({"rig": rig} if rig else {})} | requested_configuration(asked)


def requested_configuration(asked: Asked) -> RunConfiguration:
    """The part of a configuration that does not depend on the input."""
    content, start = asked.bodies.content, asked.start
    configuration = {
        "model": {
            "name": Path(asked.model).name,
            "content": None if content is None else content[:12],
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
    """The first difference from the recorded configuration, by dotted name, and the number of others.

    `recorded` may contain additional entries.
    """
    before, now = dict(flatten(recorded)), dict(flatten(asked))
    found = [
        f"{key} (recorded {before.get(key, 'not given')}, now {value})"
        for key, value in now.items()
        if key != PATH and (key not in before or before[key] != value)
    ]
    return "".join(found[:1]) + (f" and {len(found) - 1} more" if len(found) > 1 else "")
