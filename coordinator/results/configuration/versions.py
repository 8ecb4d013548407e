"""Versions of what decides results."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

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
