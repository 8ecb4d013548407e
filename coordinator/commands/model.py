"""`gepf model`: a body drawn, listed, or written as URDF."""

from __future__ import annotations

import sys
from pathlib import Path

from coordinator.bodies.human.dofs import HUMAN, HUMAN_DOFS
from coordinator.files import require_new


def draw_model(model: str, out: Path, *, force: bool = False) -> None:
    """Draw a body at rest from three sides; InputError for a file that is there, unless `force`."""
    require_new(out, force=force)
    from coordinator.bodies.choice import choose_model, load_body
    from coordinator.pictures.portrait import draw_portrait

    draw_portrait(load_body(choose_model(model)), out)


def list_dofs(model: str) -> None:
    """Print the names of a body's degrees of freedom, one a line."""
    sys.stdout.write("".join(f"{name}\n" for name in dofs_of(model)))


def dofs_of(model: str) -> tuple[str, ...]:
    """A body's degrees of freedom; the template's without building it, which takes seconds."""
    if model == HUMAN:
        return HUMAN_DOFS
    from coordinator.bodies.choice import choose_model, load_body

    return load_body(choose_model(model)).dof_names


def write_as_urdf(model: str, out: Path, *, force: bool = False) -> None:
    """Write a body as URDF, with a mesh for every link; InputError for a file there, unless `force`."""
    require_new(out, force=force)
    from coordinator.bodies.choice import choose_model, load_body
    from coordinator.bodies.urdf_writing import write_urdf

    write_urdf(load_body(choose_model(model)), out)
