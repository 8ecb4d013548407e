"""People of whom the image, or something nearer, shows only a part."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from gepf.common.arrays import Array, Mask
from gepf.common.body import BodyModel
from gepf.common.camera import project
from gepf.common.frame import EMPTY, HIDDEN, SUBJECT, Frame
from gepf.coordinator.bodies.human.shape_space import Size
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.scene.noise import NO_NOISE
from gepf.coordinator.scene.planes import Planes
from gepf.coordinator.tracking.detector import Detector
from gepf.coordinator.tracking.observation import in_view
from gepf.coordinator.tracking.segmenter import UntrackedPerson
from gepf.refiners import DirectRefiner
from tests.support.people import (
    CAMERA,
    SETTINGS,
    OnePerson,
    alone,
    changed,
    complete,
    frame_of,
    people,
    show,
    subject_of,
)

FRAMES = 6
NOISE_M = 0.006  # of depth
ARMS: dict[str, dict[str, float]] = {
    "arms hang": {"r_shoulder_abduct": 0.2, "l_shoulder_abduct": 0.2},
    "typing": dict.fromkeys((f"{side}_elbow_flexion" for side in "lr"), 1.4),
    "waving": {"r_shoulder_abduct": 1.4, "r_elbow_flexion": 1.2},
}


class Part(NamedTuple):
    """Frames of a person who waves a little, cut, and the joints (F, J, 3); those in view (F, J)."""

    frames: list[Frame]
    joints: Array
    seen: Array


def crop(frame: Frame, window: tuple[int, int, int, int]) -> Frame:
    """What a camera with a smaller image shows: left, top, right and bottom, half-open."""
    left, top, right, bottom = window
    (view,) = frame.views
    camera = view.intrinsics.crop(left, top, right - left, bottom - top)
    return changed(frame, depth=view.depth[top:bottom, left:right].copy(), intrinsics=camera)


def noisy(frame: Frame, rng: np.random.Generator) -> Frame:
    """The frame with noise in depth."""
    (view,) = frame.views
    depth = view.depth + np.rint(1e3 * NOISE_M * rng.standard_normal(view.depth.shape))
    return changed(frame, depth=np.where(view.depth > 0, depth, 0).astype(np.uint16))


def part_of(model: BodyModel, values: dict[str, float], side: str, joint: str, beyond_m: float) -> Part:
    """A person of whom the images end at a side, so far beyond a joint."""
    bent = values.get("l_elbow_flexion", 0.2) + 0.03 * np.arange(FRAMES)
    poses = np.array([name_pose(model, {**values, "l_elbow_flexion": angle}) for angle in bent])
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


Case = tuple[float, dict[str, float], str, str, float]
CASES: dict[str, Case] = {
    "below the hips": (1.74, {"root_tz": 2.2, "root_ry": 0.3, **ARMS["waving"]}, "bottom", "left_hip", 0.05),
    "at the knees": (1.74, {"root_tz": 2.6, **ARMS["arms hang"]}, "bottom", "left_knee", 0.02),
    "a child": (1.1, {"root_tz": 1.8, **ARMS["typing"]}, "bottom", "left_hip", 0.05),
    "at a desk": (1.76, {"root_tz": 0.9, "root_ty": 0.5, **ARMS["typing"]}, "bottom", "pelvis", -0.13),
    "at a desk, turned round": (
        1.76,
        {"root_tz": 0.9, "root_ty": 0.5, "root_ry": np.pi, **ARMS["typing"]},
        "bottom",
        "pelvis",
        -0.13,
    ),
    "at the left": (1.74, {"root_tz": 2.6, **ARMS["arms hang"]}, "left", "right_shoulder", 0.02),
    "at the right": (1.74, {"root_tz": 2.6, **ARMS["arms hang"]}, "right", "left_shoulder", 0.02),
    "below the head": (1.74, {"root_tz": 2.6, **ARMS["arms hang"]}, "top", "neck", 0.02),
}


@pytest.mark.parametrize("case", CASES)
def test_who_is_partly_outside_the_image_is_tracked_by_what_is_in_view(case: str) -> None:
    """Joints in view are right from the first frame on, and so is the stature; the others count as unseen."""
    stature, values, side, joint, beyond = CASES[case]
    part = part_of(people().for_start(stature, 1.05), values, side, joint, beyond)
    tracker = OnePerson(DirectRefiner(), SETTINGS, people())
    for frame, joints, seen in zip(part.frames, part.joints, part.seen, strict=True):
        estimate = tracker.track(frame)
        assert estimate.status == "tracked"
        assert not estimate.why
        off = np.linalg.norm(estimate.joint_positions - joints, axis=-1)
        assert off[seen].max() < 0.08
        outside = ~shown_at(estimate.joint_positions, frame)
        assert outside.any()
        assert not estimate.certainty.seen[outside].any()
        assert not any(share[outside].any() for share in estimate.seen_by.values())
    assert Size(*tracker.start.size).stature == pytest.approx(stature, rel=0.07)


def shown_at(joints: Array, frame: Frame) -> Mask:
    """Which joints (J, 3) are inside of an image."""
    camera = frame.views[0].intrinsics
    u, v = np.rint(project(joints, camera)).T
    return np.asarray((u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height))


def test_legs_out_of_view_keep_still() -> None:
    """Nothing is seen of them, so nothing moves them: on average by less than a centimetre between frames."""
    part = part_of(people().for_start(1.74, 1.05), *CASES["below the hips"][1:])
    tracker = OnePerson(DirectRefiner(), SETTINGS, people())
    names = tracker.model.joint_names
    legs = [names.index(f"{side}_{joint}") for side in ("left", "right") for joint in ("knee", "ankle")]
    joints = np.array([tracker.track(frame).joint_positions[legs] for frame in part.frames])
    assert np.linalg.norm(np.diff(joints, axis=0), axis=-1).mean() < 0.01


def test_a_board_before_the_legs_is_no_evidence_against_them() -> None:
    """What is behind something nearer is labelled as hidden, and is searched for as outside of an image."""
    model = people().for_start(1.74, 1.05)
    pose = name_pose(model, CASES["at the knees"][1])
    whole = show(model, pose[None])
    (view,) = subject_of(whole.frames[0], 2_000).views
    depth, kinds = view.image.depth.copy(), np.full(view.image.depth.shape, EMPTY, dtype=np.uint8)
    row = int(0.55 * len(depth))
    depth[row:], kinds[row:] = 0, HIDDEN
    kinds[depth > 0] = SUBJECT
    picked = np.flatnonzero(depth).astype(np.uint32)[::4]
    behind = alone(replace(view, image=replace(view.image, depth=depth), labels=kinds, picked=picked))
    search = Detector(people(), DirectRefiner(), SETTINGS).detect(UntrackedPerson(behind), NO_NOISE, Planes())
    found = complete(search)
    seen = in_view(behind, whole.joints[0])
    assert found.gate.passes
    assert 8 <= np.count_nonzero(seen) <= 11
    assert np.linalg.norm(found.candidates.joints[0] - whole.joints[0], axis=-1)[seen].max() < 0.08
    assert Size(*found.start.size).stature == pytest.approx(1.74, rel=0.07)


@pytest.mark.parametrize("deep", [0.0, 0.3], ids=["board", "cupboard"])
def test_furniture_at_the_border_is_no_part_of_a_person(deep: float) -> None:
    """A board, or a cupboard of which two sides are seen, as wide as a person and cut at its lower end."""
    x = (np.arange(CAMERA.width) - CAMERA.cx) / CAMERA.fx * 2.0
    front = np.where(
        np.abs(x) < 0.3, 2.0, np.where((x >= 0.3) & (x < 0.3 + 0.5 * deep), 2.0 + 2.0 * (x - 0.3), 0.0)
    )
    depth = np.tile(front, (CAMERA.height, 1))
    depth[:60] = 0.0
    tracker = OnePerson(DirectRefiner(), SETTINGS, people())
    assert tracker.track(noisy(frame_of(0, depth), np.random.default_rng(2))).status == "searching"
