"""The recordings of the benchmarks, and their reference joints.

UTD-MHAD has 27 actions of real people and a vendor's skeletons; the skinned people have exact joints. The
vendor's reference is wrong in many of the worst frames. A joint lies inside the body. So at its pixel the
surface is in front of it, at most by the thickness of a trunk, and its bone has the same length as in the
other frames. If the depth image contradicts this, the reference of the joint is not valid.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy.io
from scipy.ndimage import distance_transform_edt

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.camera import pixels_at
from gepf.common.errors import InputError
from gepf.common.frame import Frame
from gepf.coordinator.results.evaluation import read_truth
from gepf.coordinator.sources import open_source

SKINNED = ("dance", "turn", "dance_clean")
HARD_ACTIONS = (5, 12, 14, 15, 17, 21, 25, 26)
"""Fast motion, and limbs that hide each other."""

JOINTS = (
    "head", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist",
    "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle",
)  # fmt: skip
"""The joints of UTD-MHAD that count."""

UPPER_JOINTS = JOINTS[:7]
"""Those that are in view if an image ends below the hips."""
CUTS_M = {"hips": ("hip", 0.05), "knees": ("knee", 0.0)}
"""Where an image is cut: the joint, and how far below it."""
CUT_FRAMES = 5  # the first ones with a reference, which say where the joint is

SKELETON_LEAD = 2  # frames: depth frame t belongs to skeleton frame t - 2
SURFACE_BEFORE_M, SURFACE_BEHIND_M = 0.28, 0.08  # how far the surface may be in front of a joint, and behind
BESIDE_PX = 4.0  # largest distance of a joint outside the silhouette
BONE_CHANGE = 0.2  # of its median length

_ROWS = (
    "head", "shoulder_center", "spine", "hip_center",
    "left_shoulder", "left_elbow", "left_wrist", "left_hand",
    "right_shoulder", "right_elbow", "right_wrist", "right_hand",
    "left_hip", "left_knee", "left_ankle", "left_foot",
    "right_hip", "right_knee", "right_ankle", "right_foot",
)  # fmt: skip
_UPPER = {"elbow": "shoulder", "wrist": "elbow", "knee": "hip", "ankle": "knee"}
"""The joint at the upper end of a joint's bone."""
_DEPTH = re.compile(r"(a(\d+)_s(\d+))_t1_depth\.mat")


@dataclass(frozen=True, slots=True)
class Recording:
    """A depth sequence, and the file with its joints."""

    name: str
    depth: Path
    joints: Path
    action: int | None = None  # of UTD-MHAD; None where the joints are exact
    subject: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Joints (F, J, 3) of the depth frames with numbers `frame` (F,), camera frame, metres."""

    names: tuple[str, ...]
    frame: Indices
    joints: Array
    holds: Mask  # (F, J)

    def take(self, names: tuple[str, ...]) -> Reference:
        """The reference of some joints."""
        columns = [self.names.index(name) for name in names]
        return Reference(names, self.frame, self.joints[:, columns], self.holds[:, columns])


def find_people(data: Path, subjects: Sequence[int] = (1, 2, 3, 4)) -> list[Recording]:
    """UTD-MHAD by action and subject; InputError if nothing is found."""
    folder = data / "utd_mhad"
    matches = [match for path in folder.glob("depth/*.mat") if (match := _DEPTH.fullmatch(path.name))]
    found = [
        Recording(
            match[1],
            folder / "depth" / match[0],
            folder / "skeleton" / f"{match[1]}_t1_skeleton.mat",
            int(match[2]),
            int(match[3]),
        )
        for match in sorted(matches, key=lambda match: (int(match[2]), int(match[3])))
    ]
    people = [recording for recording in found if recording.subject in subjects]
    if not people:
        raise InputError(f"{folder}/depth holds no recordings of these subjects; give the folder with --data")
    return people


def find_skinned(data: Path) -> list[Recording]:
    """The available synthetic people."""
    folders = [data / "skinned" / name for name in SKINNED]
    return [Recording(f.name, f, f / "truth.npz") for f in folders if f.is_dir()]


def choose(recordings: Sequence[Recording], only: Sequence[str] | None) -> list[Recording]:
    """Recordings by name: `a14_s2`, `dance`, `a14` for an action, `hard`; InputError if a name is unknown."""
    if only is None:
        return list(recordings)
    for name in only:
        if not any(is_meant(recording, name) for recording in recordings):
            raise InputError(f"no recording '{name}'; name one such as {recordings[0].name}")
    return [recording for recording in recordings if any(is_meant(recording, name) for name in only)]


def is_meant(recording: Recording, name: str) -> bool:
    """Whether a name means this recording: its own name, that of its action, or `hard`."""
    if name == "hard":
        return recording.action in HARD_ACTIONS
    return name in (recording.name, recording.name.partition("_s")[0])


def read_frames(recording: Recording) -> list[Frame]:
    """All frames, numbered from 0."""
    source = open_source(recording.depth)
    return [source.frame(number) for number in source.numbers]


def read_reference(recording: Recording, frames: Sequence[Frame]) -> Reference:
    """The reference of a recording; `frames` are all of its frames, from number 0 on."""
    if recording.action is None:
        truth = read_truth(recording.joints)
        holds = np.ones(truth.joint_positions.shape[:2], dtype=bool)
        return Reference(truth.joint_names, truth.frame, truth.joint_positions, holds)
    joints = read_skeleton(recording.joints)[: len(frames) - SKELETON_LEAD]
    fits = [fits_depth(joints[t], frames[t + SKELETON_LEAD]) for t in range(len(joints))]
    numbers = np.arange(len(joints)) + SKELETON_LEAD
    return Reference(JOINTS, numbers, joints, np.array(fits) & fits_bones(joints))


def read_skeleton(path: Path) -> Array:
    """Joints (T, 13, 3) in the camera frame, metres, in the order of JOINTS; left and right as gepf has them.

    The images of the data set are mirrored, so its skeleton's left is the person's right.
    """
    skeleton = scipy.io.loadmat(path)["d_skel"]  # (20, 3, T)
    sides = {"left": "right", "right": "left"}
    mirrored = [re.sub("^(left|right)", lambda side: sides[side[0]], name) for name in JOINTS]
    rows = [_ROWS.index(name) for name in mirrored]
    joints: Array = np.moveaxis(skeleton[rows], 2, 0) * np.array([1.0, -1.0, 1.0])  # y down
    return joints


def cut_frames(frames: Sequence[Frame], reference: Reference, cut: str) -> list[Frame]:
    """The frames of a camera whose image ends just below the `cut` joints of the first frames."""
    kind, below = CUTS_M[cut]
    columns = [n for n, name in enumerate(reference.names) if name.endswith(f"_{kind}")]
    _, y, z = np.median(reference.joints[:CUT_FRAMES, columns].max(axis=1), axis=0)  # of the lower joint
    camera = frames[0].views[0].intrinsics
    rows = min(camera.height, int(camera.cy + camera.fy * (y + below) / z))
    short = camera.crop(0, 0, camera.width, rows)
    views = (frame.views[0] for frame in frames)
    return [Frame.of(replace(view, depth=view.depth[:rows].copy(), intrinsics=short)) for view in views]


def fits_depth(joints: Array, frame: Frame) -> Mask:
    """Which joints (J, 3) agree with the surface at their pixel."""
    (view,) = frame.views
    depth = view.metres().astype(np.float64)
    away, nearest = distance_transform_edt(depth <= 0.0, return_indices=True)
    row, column, inside = pixels_at(joints, view.intrinsics)
    row, column = np.where(inside, row, 0), np.where(inside, column, 0)
    behind = joints[:, 2] - depth[nearest[0][row, column], nearest[1][row, column]]
    near = inside & (away[row, column] <= BESIDE_PX)
    fits: Mask = near & (behind <= SURFACE_BEFORE_M) & (behind >= -SURFACE_BEHIND_M)
    return fits


def fits_bones(joints: Array) -> Mask:
    """Which joints (T, J) have the usual distance from the upper end of their bone."""
    fits = np.ones(joints.shape[:2], dtype=bool)
    for column, name in enumerate(JOINTS):
        side, _, kind = name.partition("_")
        if kind in _UPPER:
            upper = JOINTS.index(f"{side}_{_UPPER[kind]}")
            length = np.linalg.norm(joints[:, column] - joints[:, upper], axis=-1)
            usual = np.median(length)
            fits[:, column] = np.abs(length - usual) <= BONE_CHANGE * usual
    return fits
