"""The families of bodies. A new one is a module and an entry in FAMILIES."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.errors import InputError
from gepf.coordinator.bodies.angles import Angles
from gepf.coordinator.bodies.family import BodyFamily
from gepf.coordinator.bodies.human.people import PEOPLE
from gepf.coordinator.bodies.mechanisms import MECHANISMS

FAMILIES: tuple[BodyFamily, ...] = (PEOPLE, MECHANISMS)
"""The first that reads a file is its family."""


def family_of(model: BodyModel) -> BodyFamily:
    """The family of a body; InputError if this version does not know it."""
    for family in FAMILIES:
        if family.name == model.family:
            return family
    names = ", ".join(family.name for family in FAMILIES)
    raise InputError(
        f"the body is of the unknown family '{model.family}' (this version knows {names}); "
        "use the version of gepf that tracked it"
    )


def family_that_reads(model: str) -> BodyFamily:
    """The family of the template with this name, or of the body in this file."""
    named = (family for family in FAMILIES if family.template == model)
    return next(named, None) or next(family for family in FAMILIES if family.reads(Path(model)))


def angles_of(model: BodyModel, held: Mapping[str, float] | None = None, up: Array | None = None) -> Angles:
    """The angles of a tracked body, as its family defines them; see `BodyFamily.angles`.

    They are cached for the bodies that were used last.
    """
    return _angles_of(model, tuple((held or {}).items()), None if up is None else tuple(up.tolist()))


@lru_cache(maxsize=16)
def _angles_of(model: BodyModel, held: tuple[tuple[str, float], ...], up: tuple[float, ...] | None) -> Angles:
    return family_of(model).angles(model, dict(held), None if up is None else np.array(up))
