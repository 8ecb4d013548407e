"""Packages that an extra installs: what to say if one is missing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from gepf.common.errors import InputError


class MissingPackage(InputError, ImportError):
    """A package of an extra is not installed; the message has the command that installs it."""


@contextmanager
def needs(extra: str, what: str) -> Iterator[None]:
    """Context in which `what` imports packages of an extra; MissingPackage if one is not installed."""
    try:
        yield
    except ModuleNotFoundError as error:
        if isinstance(error, MissingPackage) or not error.name or error.name.startswith("gepf."):
            raise
        package = error.name.partition(".")[0]
        raise MissingPackage(
            f"{what} needs the package {package}, which is not installed; pip install 'gepf[{extra}]'"
        ) from error
