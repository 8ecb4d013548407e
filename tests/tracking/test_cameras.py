"""Faults of the cameras of a rig: which is found, since when, and that the others go on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.camera import Intrinsics
from gepf.common.frame import Frame, View
from gepf.common.kinematics import joint_positions
from gepf.common.kinematics.rotations import euler_matrix
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.tracking.cameras import (
    Agreement,
    CameraStates,
    camera_residuals,
    describe_changes,
    faults_of,
    update_camera_states,
)
from gepf.coordinator.tracking.estimate import Estimate
from gepf.coordinator.tracking.observation import isolate
from gepf.coordinator.tracking.track_state import Tracked
from gepf.coordinator.tracking.tracker import Tracker
from gepf.refiners import DirectRefiner
from tests.support.people import SETTINGS, STANDING, frame_of, known, rendered
from tests.support.rigs import around

TINY = Intrinsics(4, 16, 10.0, 10.0, 2.0, 1.5)
FPS = 30.0


def shown(number: int, **images: int) -> Frame:
    """A frame of cameras by name, each with an image of this depth in units."""
    views = [
        View(number, number / FPS, np.full((16, 4), depth, np.uint16), 1000.0, TINY, name)
        for name, depth in images.items()
    ]
    return Frame.of(*views)


def watched(frames: list[Frame], contradicting: dict[int, str] | None = None) -> Iterator[dict[str, str]]:
    """The lasting faults after each frame."""
    states = CameraStates()
    for frame in frames:
        states, _ = update_camera_states(states, frame, (contradicting or {}).get(frame.number, ""))
        yield {
            name: f"{kind} {since:.2f}"
            for name, (kind, since) in faults_of(states, frame.time_s, 0.5).items()
        }


@pytest.mark.parametrize(
    ("frames", "fault"),
    [
        ([shown(n, a=n + 1, b=n + 9) for n in range(60)], None),
        (
            [shown(n, a=n + 1, **({"b": n + 9} if n <= 15 else {})) for n in range(60)],
            ("b", "gives no depth"),
        ),
        ([shown(n, a=n + 1, b=n + 9 if n <= 15 else 0) for n in range(60)], ("b", "gives no depth")),
        ([shown(n, a=n // 2 + 1, b=n + 9 if n <= 15 else 0) for n in range(60)], ("b", "gives no depth")),
        ([shown(n, a=n + 1, b=min(n, 15) + 9) for n in range(60)], ("b", "repeats an image")),
        ([shown(n, a=min(n, 15) + 9, b=n + 1) for n in range(60)], ("a", "repeats an image")),
        ([shown(n, a=9, b=9) for n in range(60)], None),
        ([shown(n, a=9) for n in range(60)], None),
        ([shown(n, a=n + 1, **({"b": n + 9} if n % 4 else {})) for n in range(60)], None),
        (
            [shown(n, a=n + 1, **({"b": min(n, 15) + 9} if n % 2 else {})) for n in range(60)],
            ("b", "repeats an image"),
        ),
    ],
    ids=[
        "none",
        "dead",
        "dark",
        "dark beside half the rate",
        "frozen",
        "first",
        "all",
        "alone",
        "stutters",
        "frozen at half the rate",
    ],
)
def test_a_fault_that_lasts_is_found_with_its_start(
    frames: list[Frame], fault: tuple[str, str] | None
) -> None:
    """After half a second, until the end; never while no other camera could do without it."""
    found = list(watched(frames))
    if fault is None:
        assert not any(found)
        return
    name, kind = fault
    assert found[-1] == {name: f"{kind} 0.50"}
    assert not any(found[:28])
    assert all(each == found[-1] for each in found[32:])


def test_a_camera_that_comes_back_is_used_again() -> None:
    """One line when the fault is found, one when it has ended."""
    frames = [shown(n, a=n + 1, **({} if 10 < n < 50 else {"b": n + 9})) for n in range(60)]
    found = list(watched(frames))
    assert any(found)
    assert not any(found[50:])
    states, lines, before = CameraStates(), list[str](), dict[str, tuple[str, float]]()
    for frame in frames:
        states, _ = update_camera_states(states, frame, ())
        lines += describe_changes(before, before := faults_of(states, frame.time_s, 0.5))  # type: ignore[arg-type, assignment]
    assert lines == ["camera b has had a fault since t = 0.33 s: it gives no depth", "camera b is used again"]


def test_only_new_images_reach_the_tracker() -> None:
    """A repeated one has no depth; the others and its camera, time and number stay."""
    states, _ = update_camera_states({}, shown(0, a=5, b=7), ())
    states, frame = update_camera_states(states, shown(1, a=6, b=7), ())
    assert [view.camera for view in frame.views] == ["a", "b"]
    assert [bool(view.depth.any()) for view in frame.views] == [True, False]


@pytest.fixture(scope="module")
def seen() -> tuple[BodyModel, Array, list[dict[str, View]]]:
    """A person who moves arms and sways, poses (F, D), and in each frame the images of two cameras."""
    model = human(1.82)
    poses = np.tile(name_pose(model, STANDING), (40, 1))
    phase = 2.0 * np.pi * np.arange(40) / FPS
    for name, swing in (("l_shoulder_flexion", 0.4), ("r_elbow_flexion", 0.3), ("root_tx", 0.05)):
        poses[:, model.dof(name)] += swing * np.sin(phase)
    frames: list[dict[str, View]] = [{} for _ in poses]
    for name, placed in {"front": around(0.0), "side": around(80.0)}.items():
        for number, depth in enumerate(rendered(model, poses, placed=placed)):
            frames[number][name] = replace(frame_of(number, depth).views[0], camera=name, T_rig_camera=placed)
    return model, poses, frames


def knock(angle_deg: float, metres: float) -> Array:
    """A rotation about the camera's vertical axis and a shift to its side (4, 4)."""
    moved = np.eye(4)
    moved[:3, :3] = euler_matrix(np.array([0.0, np.radians(angle_deg), 0.0]))
    moved[0, 3] = metres
    return moved


@pytest.mark.parametrize(("which", "since"), [("front", 20), ("front", 16), ("side", 20), ("side", 0)])
def test_a_camera_at_a_wrong_place_is_left_out(
    seen: tuple[BodyModel, Array, list[dict[str, View]]], which: str, since: int
) -> None:
    """By 5 degrees and 10 cm: named with its time; the other alone keeps the person.

    If they agreed before, that one is believed; else nobody knows which one is right.
    """
    model, poses, frames = seen
    found: list[Estimate] = []
    tracker = Tracker(DirectRefiner(), SETTINGS, known(), start=STANDING)
    for number, images in enumerate(frames):
        views = [
            replace(view, T_rig_camera=view.T_rig_camera @ knock(5.0, 0.1))
            if name == which and number >= since
            else view
            for name, view in images.items()
        ]
        (tracked,) = tracker.track(Frame.of(*views)).people
        found.append(tracked.estimate)
    assert all(set(each.seen_by) == {"front", "side"} for each in found[:since])
    assert not any(which in each.seen_by for each in found[since + 3 :])
    disputed = [each.why.startswith("side disagrees with front: one of them") for each in found[since + 3 :]]
    assert set(disputed) == {since == 0}
    assert since or {each.status for each in found[since + 3 :]} == {"ambiguous"}
    kind, since_s = found[-1].faults[which]
    assert set(found[-1].faults) == {which}
    assert kind == "contradicts the others"
    assert since / FPS - 0.1 < since_s < since / FPS + 0.1
    true = joint_positions(model, poses)
    off = [np.linalg.norm(each.joint_positions - true[n], axis=1).mean() for n, each in enumerate(found)]
    assert max(off[since + 8 :]) < 0.07


def test_the_body_is_searched_for_when_a_camera_is_back(
    seen: tuple[BodyModel, Array, list[dict[str, View]]],
) -> None:
    """After a fault of more than half a second; its image may show what was hidden from the other camera."""
    _, _, frames = seen
    tracker, since = Tracker(DirectRefiner(), SETTINGS, known(), start=STANDING), list[float]()
    for number, images in enumerate(frames):
        views = [view for name, view in images.items() if name == "front" or not 5 <= number < 25]
        (tracked,) = tracker.track(Frame.of(*views)).people
        assert isinstance(tracked.state.track, Tracked)
        since.append(tracked.state.track.check_clock_s)
    assert since[24:27] == pytest.approx([since[0] + 24 / FPS, 3 / FPS, 4 / FPS])


@pytest.mark.parametrize(
    ("shows_m", "turned_deg", "against"),
    [(5.0, 0.0, ("side",)), (1.0, 0.0, ()), (5.0, 90.0, ()), (0.0, 0.0, ())],
)
def test_a_camera_that_sees_through_the_body_contradicts(
    seen: tuple[BodyModel, Array, list[dict[str, View]]],
    shows_m: float,
    turned_deg: float,
    against: tuple[str, ...],
) -> None:
    """If it shows a wall behind; not with an obstacle in front, with the person outside, or without depth."""
    model, poses, (images, *_) = seen
    side = replace(
        images["side"],
        depth=np.full_like(images["side"].depth, 1000.0 * shows_m),
        T_rig_camera=images["side"].T_rig_camera @ knock(turned_deg, 0.0),
    )
    subject = isolate(Frame.of(images["front"]), 1000)
    assert subject is not None
    frame = Frame.of(images["front"], side)
    residuals = camera_residuals(model, poses[0], frame, subject.views, 0.04)
    assert Agreement().after(residuals, 0.04, 0.1, 0.5).contradicting == against
