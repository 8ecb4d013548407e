"""Estimated joints held against others: a vendor's skeleton, or the exact truth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.utd import JOINTS, SKELETON_LEAD, distances, paired, read_skeleton
from common.errors import InputError
from coordinator.results.evaluation import Errors, lost_from, positions, read_truth

Array = NDArray[np.float64]
Frames = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Distances of J joints in the F frames that both sides have, metres."""

    joint_names: tuple[str, ...]  # (J,)
    frame: Frames  # (F,)
    raw: Array  # (F, J)
    offset_removed: Array  # (F, J) without each joint's constant median offset
    visible: NDArray[np.bool_] | None = None  # (F, J) joints that the camera sees, where that is known

    @property
    def lost_from(self) -> int | None:
        """First frame from which on the tracking is lost to the end, as `gepf evaluate` has it."""
        no_angles = np.empty((len(self.frame), 0))
        return lost_from(Errors(self.frame, (), no_angles, no_angles, self.raw))

    def only(self, joint: str) -> Comparison:
        """The same of a single joint."""
        column = [self.joint_names.index(joint)]
        return replace(
            self,
            joint_names=(joint,),
            raw=self.raw[:, column],
            offset_removed=self.offset_removed[:, column],
            visible=None if self.visible is None else self.visible[:, column],
        )


def compare_people(path: Path, names: tuple[str, ...], joints: Array, frame: Frames) -> Comparison:
    """Joints (F, J, 3) named `names` against a skeleton of UTD-MHAD, which is shifted in time."""
    mine, theirs = paired(joints[:, positions(names, JOINTS)], read_skeleton(path))
    return compare(JOINTS, frame[SKELETON_LEAD : SKELETON_LEAD + len(mine)], mine, theirs)


def compare_skinned(path: Path, names: tuple[str, ...], joints: Array, frame: Frames) -> Comparison:
    """Joints (F, J, 3) named `names` against a truth file that also tells which joints are visible."""
    truth = read_truth(path)
    with np.load(path) as content:
        visible = content["visible"].astype(bool)
    common, mine, theirs = np.intersect1d(frame, truth.frame, return_indices=True)
    estimated = joints[mine][:, positions(names, truth.joint_names)]
    compared = compare(truth.joint_names, common, estimated, truth.joint_positions[theirs])
    return replace(compared, visible=visible[theirs])


def compare(names: tuple[str, ...], frame: Frames, mine: Array, theirs: Array) -> Comparison:
    """Joints (F, J, 3) of both sides at the same moments; InputError if there is no such moment."""
    if not len(frame):
        raise InputError("track and joints have no frame in common; give the joints of the same sequence")
    return Comparison(
        joint_names=names,
        frame=frame,
        raw=distances(mine, theirs, remove_offset=False),
        offset_removed=distances(mine, theirs, remove_offset=True),
    )
