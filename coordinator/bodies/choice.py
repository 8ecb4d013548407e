"""Chooses the body and its degrees of freedom from the command line."""

from __future__ import annotations

from pathlib import Path

from gepf.common.body import ROOT_DOFS, BodyModel, unknown_dof
from gepf.common.errors import InputError
from gepf.common.packages import needs
from gepf.coordinator.bodies.human.dofs import HUMAN, HUMAN_DOFS
from gepf.coordinator.bodies.human.measures import DEVIATION, Measures
from gepf.coordinator.bodies.human.shape_space import shape_space
from gepf.coordinator.bodies.human.template import DEFAULT_ACTIVE, human, human_of
from gepf.coordinator.bodies.tracked import Bodies, Size, one_body
from gepf.coordinator.files import read_json

PERSON_SUFFIX = ".json"
JOINTS = "joints"
"""Stands for all default degrees of freedom except the root, for a body with a fixed base."""

SPINE = ("vl3_tilt", "vl3_roll", "vl3_torsion", "vc7_tilt")
"""One joint of the lower back and one of the neck represent all others: people bend, and look down."""

USUAL = {"paper": DEFAULT_ACTIVE, "default": DEFAULT_ACTIVE + SPINE}
"""Preset -> default degrees of freedom of a person."""


def choose_model(model: str) -> str:
    """The human template or an existing file."""
    if model != HUMAN and not Path(model).is_file():
        what = f"no such file: {model}" if Path(model).suffix else f"unknown model '{model}'"
        raise InputError(f"{what}; give {HUMAN}, a URDF file, or a file of a person's measures")
    return model


def choose_bodies(active: tuple[str, ...] | None, preset: str, model: str = HUMAN) -> Bodies:
    """The bodies of `model`: people of any stature, one person from a file, or a body from a URDF file.

    Only the degrees of freedom `active` move: by default those of the preset for a person, all for a URDF.
    Raises InputError for an invalid file, and for unknown degrees of freedom.
    """
    usual = USUAL[preset]
    if model == HUMAN:
        space = shape_space()
        return Bodies(space.person, usual, choose_active(active, usual, HUMAN_DOFS), space=space)
    path = Path(model)
    if path.suffix == PERSON_SUFFIX:
        return person(read_person(path), active, preset)
    return bodies_of(load_body(model), active)


def person(measures: Measures, active: tuple[str, ...] | None, preset: str) -> Bodies:
    """One person with known measures, with the surface of people of unknown size."""
    usual = USUAL[preset]
    chosen = choose_active(active, usual, HUMAN_DOFS)
    maturity = shape_space().maturity(measures.stature, measures.age)
    size = Size(measures.stature, measures.girth, maturity)
    return one_body(human_of(measures), usual, chosen, size)


def bodies_of(model: BodyModel, active: tuple[str, ...] | None) -> Bodies:
    """One body with all its degrees of freedom; all of them move by default."""
    return one_body(model, model.dof_names, choose_active(active, model.dof_names, model.dof_names))


def load_body(model: str) -> BodyModel:
    """One body with all its degrees of freedom; for people, an average person."""
    if model == HUMAN:
        return human()
    path = Path(model)
    if path.suffix == PERSON_SUFFIX:
        return human_of(read_person(path))
    with needs("robots", "a URDF file"):
        from gepf.coordinator.bodies.urdf import read_urdf

    return read_urdf(path)


def read_person(path: Path) -> Measures:
    """Measures in metres, and age in years, from a JSON file; missing ones follow from stature.

    InputError for implausible measures and unknown entries.
    """
    values = read_json(path, dict[str, float], "write {measure: metres}")
    values.pop(DEVIATION, None)
    if "stature" not in values:
        raise InputError(f"{path} has no stature; add it, in metres")
    try:
        return Measures.of(values.pop("stature"), **values)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def choose_active(
    wanted: tuple[str, ...] | None, usual: tuple[str, ...], known: tuple[str, ...]
) -> tuple[str, ...]:
    """The active degrees of freedom, `usual` for None; InputError if one is not `known`."""
    if wanted is None:
        return usual
    chosen: list[str] = []
    for name in wanted:
        chosen.extend([n for n in usual if n not in ROOT_DOFS] if name == JOINTS else [name])
    for name in chosen:
        if name not in known:
            raise unknown_dof(name, known)
    if not chosen:
        raise InputError("this body has no joints; without --dof its position and orientation are tracked")
    return tuple(chosen)
