"""Settings to measure with: those that `gepf track` has by itself, and single ones in their place."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import msgspec

from common.errors import InputError
from common.settings import Settings
from coordinator.commands.job import choose_settings


def settings_with(changes: Sequence[str], particles: int | None = None) -> Settings:
    """The default settings after changes of the form `key=value`; InputError for one that makes no sense.

    `preset` and `method` mean what they mean to `gepf track`; all other keys are fields of the settings.
    """
    given = dict(split(change) for change in changes)
    method, preset = given.pop("method", "gepf"), given.pop("preset", "default")
    plain = msgspec.to_builtins(choose_settings(str(method), str(preset), particles, None, 0))
    for key, value in given.items():
        section_of(key, plain)[key] = value
    try:
        return msgspec.convert(plain, Settings)
    except msgspec.ValidationError as error:
        raise InputError(f"--set {' '.join(changes)} does not fit: {error}; give a fitting value") from error


def split(change: str) -> tuple[str, Any]:
    """Key and value; what is not JSON is a text."""
    key, equals, text = change.partition("=")
    if not equals:
        raise InputError(f"--set {change} is not of the form key=value; write e.g. --set particles=20")
    try:
        return key, json.loads(text)
    except json.JSONDecodeError:
        return key, text


def section_of(key: str, plain: dict[str, Any]) -> dict[str, Any]:
    """The part of the settings that has this key."""
    sections: list[dict[str, Any]] = [plain, plain["refine"], plain["filter"]]
    for section in sections:
        if key in section and not isinstance(section[key], dict):
            return section
    known = [name for section in sections for name, value in section.items() if not isinstance(value, dict)]
    raise InputError(f"no setting '{key}'; choose from {', '.join(known)}")
