"""Short sequences to start in, and where the joints are in each of their frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.utd import JOINTS, SKELETON_LEAD, read_skeleton
from common.camera import Intrinsics
from common.frame import DepthFrame
from coordinator.results.evaluation import read_truth
from coordinator.sources import open_source

Array = NDArray[np.float64]

EVERY = 15  # frames between two starts
AFTER = 10  # frames in which a start has to be right
GAP = (10, 25)  # frames that show nothing
EXACT, VENDORS = 0.10, 0.14  # metres of the mean joint that are right; a vendor's joints lie apart themselves


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """Frames to be tracked from the first on, and joints (J, 3) by frame number; none where nobody is."""

    name: str
    frames: list[DepthFrame]
    joints: dict[int, Array]
    names: tuple[str, ...]
    near: float = EXACT


@dataclass(frozen=True, slots=True, eq=False)
class Footage:
    """A recording with its joints."""

    name: str
    frames: list[DepthFrame]
    joints: dict[int, Array]
    names: tuple[str, ...]
    near: float

    def cut(self, first: int, count: int, name: str | None = None) -> Case:
        """The frames from one on, as many as there are up to a count."""
        frames = self.frames[first : first + count]
        return Case(name or f"{self.name} {first}", frames, self.joints, self.names, self.near)


def read_skinned(folder: Path) -> Footage:
    """A rendered person with exact joints."""
    truth = read_truth(folder / "truth.npz")
    joints = dict(zip(truth.frame.tolist(), truth.joint_positions, strict=True))
    return Footage(folder.name, list(open_source(folder)), joints, truth.joint_names, EXACT)


def read_real(data: Path, action: int, subject: int) -> Footage:
    """A real person with a vendor's joints."""
    name = f"a{action}_s{subject}"
    skeleton = read_skeleton(data / "utd_mhad" / "skeleton" / f"{name}_t1_skeleton.mat")
    joints = {n + SKELETON_LEAD: each for n, each in enumerate(skeleton)}
    frames = list(open_source(data / "utd_mhad" / "depth" / f"{name}_t1_depth.mat"))
    return Footage(name, frames, joints, JOINTS, VENDORS)


def starts(footage: Footage) -> Iterator[Case]:
    """A start in every 15th frame."""
    for first in range(0, len(footage.frames) - AFTER // 2, EVERY):
        yield footage.cut(first, AFTER + 1)


def gaps(footage: Footage) -> Iterator[Case]:
    """Ten frames, fifteen that show nothing, and ten in which the body must be found again."""
    for first in range(0, len(footage.frames) - GAP[1] - AFTER, EVERY):
        case = footage.cut(first, GAP[1] + AFTER + 1)
        frames = [blank(f) if GAP[0] <= n < GAP[1] else f for n, f in enumerate(case.frames)]
        yield replace(case, frames=frames)


def blank(frame: DepthFrame) -> DepthFrame:
    """The frame without anything in it."""
    return replace(frame, depth=np.zeros_like(frame.depth))


def empty_first(case: Case, count: int, name: str) -> Case:
    """A case with so many empty frames before it, numbered downwards."""
    first = case.frames[0]
    before = [replace(blank(first), number=first.number - n) for n in range(count, 0, -1)]
    return replace(case, name=name, frames=[*before, *case.frames])


def turned(case: Case, quarters: int, name: str) -> Case:
    """A case as a camera held another way up records it: turned to the left so many times."""
    frames, joints = case.frames, case.joints
    for _ in range(quarters):
        frames = [turn_left(frame) for frame in frames]
        joints = {n: each[:, [1, 0, 2]] * [1.0, -1.0, 1.0] for n, each in joints.items()}
    return replace(case, name=name, frames=frames, joints=joints)


def turn_left(frame: DepthFrame) -> DepthFrame:
    """A frame turned by a quarter against the clock."""
    camera = frame.intrinsics
    lens = (camera.fy, camera.fx, camera.cy, camera.width - 1 - camera.cx)
    depth = np.ascontiguousarray(np.rot90(frame.depth))
    return replace(frame, depth=depth, intrinsics=Intrinsics(camera.height, camera.width, *lens))


def rescaled(case: Case, factor: float, name: str) -> Case:
    """A case whose depth scale is wrong: nobody is there who could be right."""
    frames = [replace(f, depth_scale=f.depth_scale * factor) for f in case.frames]
    return replace(case, name=name, frames=frames, joints={})


def doubled(case: Case, aside: int, behind: int, name: str) -> Case:
    """A case with the same person once more, some columns aside and some millimetres behind."""
    return replace(case, name=name, frames=[double(frame, aside, behind) for frame in case.frames])


def double(frame: DepthFrame, aside: int, behind: int) -> DepthFrame:
    """A frame with its person twice."""
    other = np.roll(frame.depth, aside, axis=1)
    other = np.where(other > 0, other + behind, 0).astype(np.uint16)
    return replace(frame, depth=np.where(frame.depth > 0, frame.depth, other))


def things(camera: Intrinsics, count: int) -> list[Case]:
    """What is no person: boards, a box, a ball, a wall, a floor, a coat stand; with noise."""
    v, u = np.indices((camera.height, camera.width))
    board = (np.abs(u - 256) < 55) & (np.abs(v - 212) < 115)
    disc = ((u - 256) / 70.0) ** 2 + ((v - 212) / 110.0) ** 2
    ground = np.where(v > camera.cy + 3, 1.2 * camera.fy / np.maximum(v - camera.cy, 1.0), 0.0)
    shapes = {
        "board": np.where(board, 2.8, 0.0),
        "slanting board": np.where(board, 2.8 + 0.002 * (u - 200), 0.0),
        "box": np.where((np.abs(u - 256) < 75) & (np.abs(v - 260) < 65), 2.8, 0.0),
        "ball": np.where(disc < 1.0, 2.9 - 0.3 * np.sqrt(np.maximum(0.0, 1.0 - disc)), 0.0),
        "wall": np.full(v.shape, 3.0),
        "floor": np.where(ground < 6.0, ground, 0.0),
        "coat stand": np.where((np.abs(u - 251) < 11) & (np.abs(v - 225) < 105), 2.5, 0.0),
    }
    return [Case(name, noisy(shape, camera, count), {}, ()) for name, shape in shapes.items()]


def noisy(depth_m: Array, camera: Intrinsics, count: int) -> list[DepthFrame]:
    """Frames of a depth image (H, W) in metres with a time-of-flight camera's noise."""
    rng = np.random.default_rng(0)
    return [measured(n, depth_m, camera, rng) for n in range(count)]


def measured(number: int, depth_m: Array, camera: Intrinsics, rng: np.random.Generator) -> DepthFrame:
    """One frame of a depth image (H, W) in metres with that noise."""
    sigma = 0.0012 + 0.0019 * (depth_m - 0.4) ** 2
    noised = depth_m + sigma * rng.standard_normal(depth_m.shape)
    depth = np.where(depth_m > 0.0, np.rint(1000.0 * noised), 0.0).astype(np.uint16)
    return DepthFrame(number, number / 30.0, depth, 1000.0, camera)


def lowest(footage: Footage) -> int:
    """The frame in which the pelvis is lowest: a person who kneels."""
    pelvis = footage.names.index("pelvis")
    return max(footage.joints, key=lambda n: float(footage.joints[n][pelvis, 1]))


def situations(data: Path, dance: Footage, turn: Footage) -> list[Case]:
    """What can go wrong at a start, thirty frames each."""
    front, back = dance.cut(0, 30, "front"), turn.cut(75, 30, "back")
    camera = front.frames[0].intrinsics
    kneeling = max(0, min(lowest(dance) - 10, len(dance.frames) - 30))
    return [
        front,
        back,
        turn.cut(30, 30, "side"),
        dance.cut(kneeling, 30, "kneeling"),
        read_real(data, 25, 1).cut(40, 30, "sitting"),
        turned(turn.cut(0, 30), 1, "lying, head to the left"),
        turned(front, 3, "portrait"),
        turned(front, 2, "upside down"),
        turned(back, 2, "upside down, back"),
        empty_first(front, 5, "5 empty frames first"),
        empty_first(front, 50, "50 empty frames first"),
        rescaled(front, 0.1, "ten times too large"),
        rescaled(front, 10.0, "ten times too small"),
        doubled(front, 130, 200, "two people"),
        *things(camera, 30),
    ]


def all_starts(footages: Sequence[Footage]) -> list[Case]:
    """Starts of several recordings."""
    return [case for footage in footages for case in starts(footage)]
