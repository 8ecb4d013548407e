"""People of whom the image, or something nearer, shows only a part."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.camera import project
from gepf.common.frame import DepthFrame
from gepf.common.kinematics import joint_positions
from gepf.coordinator.bodies.tracked import Size, name_pose
from gepf.coordinator.tracking.estimate import Estimate
from gepf.refiners import DirectRefiner
from tests.support.people import CAMERA, SETTINGS, OnePerson, people, show

FRAMES = 8
NOISE_M = 0.006  # of depth
ARMS = {
    "arms hang": {"r_shoulder_abduct": 0.2, "l_shoulder_abduct": 0.2},
    "typing": dict.fromkeys((f"{side}_elbow_flexion" for side in "lr"), 1.4),
    "waving": {"r_shoulder_abduct": 1.4, "r_elbow_flexion": 1.2},
    "hands on hips": {
        **dict.fromkeys((f"{side}_shoulder_abduct" for side in "lr"), 0.7),
        **dict.fromkeys((f"{side}_elbow_flexion" for side in "lr"), 1.3),
    },
}


class Part(NamedTuple):
    """Frames of a person who waves a little, cut, and the joints (F, J, 3); those in view (F, J)."""

    frames: list[DepthFrame]
    joints: Array
    seen: Array


def crop(frame: DepthFrame, window: tuple[int, int, int, int]) -> DepthFrame:
    """What a camera with a smaller image shows: left, top, right and bottom, half-open."""
    left, top, right, bottom = window
    camera = frame.intrinsics.crop(left, top, right - left, bottom - top)
    return replace(frame, depth=frame.depth[top:bottom, left:right].copy(), intrinsics=camera)


def noisy(frame: DepthFrame, rng: np.random.Generator) -> DepthFrame:
    """The frame with noise in depth."""
    depth = frame.depth + np.rint(1e3 * NOISE_M * rng.standard_normal(frame.depth.shape))
    return replace(frame, depth=np.where(frame.depth > 0, depth, 0).astype(np.uint16))


def part_of(model: BodyModel, values: dict[str, float], side: str, joint: str, beyond_m: float) -> Part:
    """A person of whom the images end at a side, so far beyond a joint."""
    poses = np.array(
        [name_pose(model, {**values, "l_elbow_flexion": values.get("l_elbow_flexion", 0.2) + 0.03 * n}) for n in range(FRAMES)]
    )
    whole, rng = show(model, poses), np.random.default_rng(4)
    place = whole.joints[0, model.joint_names.index(joint)].copy()
    step = {"bottom": (0, 1), "top": (0, -1), "left": (-1, 0), "right": (1, 0)}[side]
    place[:2] += beyond_m * np.array(step)
    column, row = np.rint(project(place, CAMERA)).astype(int).tolist()
    window = {
        "bottom": (0, 0, CAMERA.width, row),
        "top": (0, row, CAMERA.width, CAMERA.height),
        "left": (column, 0, CAMERA.width, CAMERA.height),
        "right": (0, 0, column, CAMERA.height),
    }[side]
    u, v = np.moveaxis(project(whole.joints, CAMERA), -1, 0)
    seen = (u >= window[0]) & (u < window[2]) & (v >= window[1]) & (v < window[3])
    return Part([crop(noisy(each, rng), window) for each in whole.frames], whole.joints, seen)


def follow(part: Part) -> tuple[list[Estimate], OnePerson]:
    """The estimates of an unknown person in these frames."""
    tracker = OnePerson(DirectRefiner(), SETTINGS, people())
    return [tracker.track(frame) for frame in part.frames], tracker


@pytest.mark.parametrize("arms", ARMS)
@pytest.mark.parametrize("turn", [0.0, 0.6, np.pi])
def test_scan(arms: str, turn: float) -> None:
    for size in (Size(1.74, 1.05), Size(1.6, 1.1)):
        model = people().for_start(*size)
        part = part_of(model, {"root_tz": 2.2, "root_ry": turn, **ARMS[arms]}, "bottom", "left_hip", 0.05)
        report(f"{arms} {turn:.1f} {size.stature}", part)


def report(what: str, part: Part) -> None:
    estimates, tracker = follow(part)
    off = np.linalg.norm(np.array([e.joint_positions for e in estimates]) - part.joints, axis=-1)
    print(what, [e.status[:2] for e in estimates], "off", np.round(100 * np.nanmean(np.where(part.seen, off, np.nan)), 1), np.round(100 * np.nanmax(np.where(part.seen, off, np.nan)), 1), "stature", tracker.start.size.stature, "seen", np.round(estimates[-1].certainty.seen[~part.seen[-1]].max(initial=0), 2), estimates[-1].why[:60])


@pytest.mark.parametrize("case", [("left", "right_shoulder"), ("top", "neck"), ("right", "left_shoulder"), ("bottom", "left_knee"), ("bottom", "left_elbow"), ("left", "pelvis")])
def test_scan_sides(case) -> None:
    model = people().for_start(1.74, 1.05)
    part = part_of(model, {"root_tz": 2.6, **ARMS["arms hang"]}, case[0], case[1], 0.02)
    report(str(case), part)


def test_child() -> None:
    for s in (1.0, 1.2):
        for arms in ARMS:
            model = people().for_start(s, 1.05)
            part = part_of(model, {"root_tz": 1.8, **ARMS[arms]}, "bottom", "left_hip", 0.05)
            report(f"child {s} {arms}", part)


@pytest.mark.parametrize("turn", [0.0, 1.0, 2.0, np.pi, 4.0, 5.2])
def test_desk(turn) -> None:
    model = people().for_start(1.76, 1.05)
    part = part_of(model, {"root_tz": 0.85, "root_ty":0.25, "root_ry": turn, **ARMS["typing"]}, "bottom", "pelvis", -0.1)
    report(f"desk {turn}", part)
