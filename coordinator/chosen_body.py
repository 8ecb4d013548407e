"""The body that the command line names, and its degrees of freedom."""

from __future__ import annotations

from difflib import get_close_matches

from common.body import ROOT_DOFS
from common.errors import InputError
from coordinator.bodies import Bodies
from coordinator.models.human import DEFAULT_ACTIVE, human
from coordinator.models.mpeg4 import JOINT_ANGLES

HUMAN_DOFS = (*ROOT_DOFS, *JOINT_ANGLES)


TRUNK = ("vl3_tilt", "vl3_roll", "vl3_torsion")
"""One joint in the small of the back stands in for the spine: people who bend at the waist need it."""

USUAL = {"paper": DEFAULT_ACTIVE, "default": DEFAULT_ACTIVE + TRUNK}
"""Preset -> what is active unless the user says otherwise."""


def choose_bodies(active: tuple[str, ...] | None, preset: str) -> Bodies:
    """People of any stature; only the degrees of freedom `active` move, by default the preset's."""
    for name in active or ():
        require_dof(name)
    usual = USUAL[preset]
    return Bodies(human, usual, usual if active is None else active)


def require_dof(name: str) -> None:
    """InputError unless the human template has this degree of freedom; names what may have been meant."""
    if name not in HUMAN_DOFS:
        near = get_close_matches(name, HUMAN_DOFS, n=3)
        meant = f"did you mean {' or '.join(near)}? " if near else ""
        raise InputError(
            f"unknown degree of freedom '{name}'; {meant}choose from {', '.join(DEFAULT_ACTIVE + TRUNK)}, "
            "or any other joint angle of MPEG-4"
        )
