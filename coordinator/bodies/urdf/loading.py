"""A URDF file as yourdfpy reads it."""

from __future__ import annotations

import logging
from functools import partial
from pathlib import Path

import yourdfpy

from common.errors import InputError


def load(path: Path, **what: bool) -> yourdfpy.URDF:
    """The parsed file with `what` yourdfpy is to load of it; whatever goes wrong is the file's fault."""
    logging.getLogger("yourdfpy").setLevel(logging.CRITICAL)  # what matters is raised here
    try:
        return yourdfpy.URDF.load(str(path), filename_handler=partial(find_mesh, path=path), **what)
    except InputError:
        raise
    except Exception as error:
        raise InputError(
            f"{path} is no URDF that can be read ({type(error).__name__}: {error}); check the file"
        ) from error


def find_mesh(fname: str, path: Path) -> str:
    """Where a mesh is: as named, or below the URDF's folder or one above it, without its package."""
    found: str = yourdfpy.urdf.filename_handler_magic(fname, str(path.parent.absolute()))
    if not Path(found).is_file():
        raise InputError(f"{path} names the mesh {fname}, which is not there; put it beside or mend the name")
    return found
