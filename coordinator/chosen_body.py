"""The body that the command line names, and its degrees of freedom."""

from __future__ import annotations

from difflib import get_close_matches

from common.body import ROOT_DOFS
from common.errors import InputError
from coordinator.bodies import Bodies
from coordinator.models.human import DEFAULT_ACTIVE, human
from coordinator.models.mpeg4 import JOINT_ANGLES

HUMAN_DOFS = (*ROOT_DOFS, *JOINT_ANGLES)


def choose_bodies(active: tuple[str, ...] | None) -> Bodies:
    """People of any stature; only the degrees of freedom `active` move, or the usual ones if None."""
    for name in active or ():
        require_dof(name)
    return Bodies(human, DEFAULT_ACTIVE, DEFAULT_ACTIVE if active is None else active)


def require_dof(name: str) -> None:
    """InputError unless the human template has this degree of freedom; names what may have been meant."""
    if name not in HUMAN_DOFS:
        near = get_close_matches(name, HUMAN_DOFS, n=3)
        meant = f"did you mean {' or '.join(near)}? " if near else ""
        raise InputError(
            f"unknown degree of freedom '{name}'; {meant}choose from {', '.join(DEFAULT_ACTIVE)}, "
            "or any other joint angle of MPEG-4"
        )
