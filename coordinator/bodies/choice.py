"""Chooses the body and its degrees of freedom from the command line."""

from __future__ import annotations

from pathlib import Path

from gepf.common.body import BodyModel
from gepf.common.errors import InputError
from gepf.coordinator.bodies.families import FAMILIES, family_that_reads
from gepf.coordinator.bodies.family import Bodies
from gepf.coordinator.bodies.human.dofs import HUMAN


def choose_model(model: str) -> str:
    """The name of a template, or an existing file."""
    templates = [family.template for family in FAMILIES if family.template]
    if model not in templates and not Path(model).is_file():
        what = f"no such file: {model}" if Path(model).suffix else f"unknown model '{model}'"
        names = ", ".join(templates)
        raise InputError(f"{what}; give {names}, a URDF file, or a file of a person's measures")
    return model


def choose_bodies(active: tuple[str, ...] | None, preset: str, model: str = HUMAN) -> Bodies:
    """The bodies of `model`: people of any stature, one person from a file, or a body from a URDF file.

    Only the degrees of freedom `active` move: by default those of the preset for a person, all for a URDF.
    Raises InputError for an invalid file, and for unknown degrees of freedom.
    """
    return family_that_reads(model).bodies(model, active, preset)


def load_body(model: str) -> BodyModel:
    """One body with all its degrees of freedom; for people, an average person."""
    return family_that_reads(model).load(model)
