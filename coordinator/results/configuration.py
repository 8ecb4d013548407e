"""The configuration of a run, which determines its results. A run is resumed only with the same one."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterator, Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import msgspec

from gepf.common.frame import View

PACKAGES = ("gepf", "eclipse-zenoh", "msgpack", "msgspec", "numba", "numpy", "scipy")
PEOPLE = "people"  # the requested number of people, only if it is above 1
PATH = "path"  # of the sequence, for later reference; it does not affect results
CAMERA_GIVEN = "camera_given"  # by the user
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


def digest_view(view: View) -> str:
    """A hash of the depth and camera of an image."""
    camera = repr((*msgspec.structs.astuple(view.intrinsics), view.depth_scale, view.time_s))
    return digest(camera.encode() + view.depth.tobytes())


def digest(content: bytes) -> str:
    """A short hash of the content."""
    return hashlib.sha256(content).hexdigest()[:12]


def digest_of(configuration: RunConfiguration) -> str:
    """A hash of what determines the results of a run, the same wherever its sequence lies."""
    facts = {key: value for key, value in flatten(configuration) if key != PATH}
    return digest(msgspec.json.encode(facts, order="deterministic"))


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
