"""The truth of a sequence: what `truth.npz` holds."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.body import ROOT_DOFS
from common.errors import InputError
from coordinator.files.arrays import read_arrays
from coordinator.results.track import TRACK_FILE


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """True joints, and where known poses, of F frames; NaN where not known."""

    frame: NDArray[np.int64]  # (F,)
    joint_names: tuple[str, ...]
    joint_positions: NDArray[np.float64]  # (F, J, 3) metres, camera frame
    dof_names: tuple[str, ...]  # empty where the pose is not known
    pose: NDArray[np.float64]  # (F, D) metres and radians
    slides: tuple[str, ...] = ROOT_DOFS[:3]  # the degrees of freedom that are no angles


def read_truth(path: Path) -> Truth:
    """A truth file; without `frame`, its rows are the frames from 0. InputError if it is not one."""
    arrays = read_arrays(path)
    joint_names = arrays.names("joint_names")
    joints = _known(arrays.floats("joint_positions", (-1, len(joint_names), 3)))
    count = len(joints)
    frame = arrays.integers("frame", (count,)) if "frame" in arrays else np.arange(count, dtype=np.int64)
    dof_names = arrays.names("dof_names") if "dof_names" in arrays else ()
    pose = _known(arrays.floats("pose", (count, len(dof_names)))) if dof_names else np.empty((count, 0))
    slides = ROOT_DOFS[:3] + (arrays.names("slides") if "slides" in arrays else ())
    return Truth(frame, joint_names, joints, dof_names, pose, slides)


def check_truth_of(run: Path, truth: Path) -> None:
    """InputError where a run would be compared with itself."""
    own = run / TRACK_FILE
    if own.exists() and truth.exists() and own.samefile(truth):
        raise InputError(f"{truth} is the run's own track; give the truth of its sequence, truth.npz")


def _known(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(np.isfinite(values), values, np.nan)
