"""Rendered people on furniture: bodies rest on it and are not inside of it, and are scored."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.furniture.footage import Footage, Recorder, record
from benchmarks.furniture.parts import block, deepest
from benchmarks.furniture.people import SIZES, draw_measures, posed
from benchmarks.furniture.scores import score, score_table
from benchmarks.furniture.seats import seat_down
from benchmarks.furniture.situations import SITUATIONS
from benchmarks.running import screen
from benchmarks.tracking import follow, prepare
from gepf.common.camera import Intrinsics
from gepf.coordinator.bodies.human.template import human, human_of
from gepf.coordinator.settings import preset
from gepf.coordinator.tracking.tracker import Tracker
from gepf.refiners import DirectRefiner

FRAMES, FEW, CENTIMETRE = 14, 4, 0.01
SMALL = Recorder(camera=Intrinsics(256, 212, 182.5, 182.5, 127.5, 105.5))


@pytest.mark.parametrize("name", SITUATIONS)
def test_a_body_rests_on_its_furniture_and_is_not_inside(name: str) -> None:
    """No vertex is 2 cm inside of a part or below the floor, and some touch a part."""
    rng = np.random.default_rng(3)
    situation = SITUATIONS[name](human(1.70), FRAMES, rng)
    for body in (situation.person, *situation.others):
        assert deepest(situation.furniture, body.vertices) < 2.0 * CENTIMETRE
        assert body.vertices[..., 1].max() < CENTIMETRE
    assert deepest(situation.furniture, situation.person.vertices[0]) > 0.0


def test_depth_inside_a_box() -> None:
    """The distance to the nearest side, and 0 outside."""
    part = block((-1.0, 1.0), (0.0, 1.0), (0.0, 2.0))
    points = np.array([[0.0, -0.3, 0.5], [0.9, -1.0, 0.5], [0.0, -2.1, 0.5], [0.0, 0.1, 0.5]])
    assert np.allclose(part.depth_of(points), [0.3, 0.1, 0.0, 0.0])


def test_a_child_hangs_its_feet_from_a_seat_for_adults() -> None:
    """A high seat is as high as asked; without one, the feet are on the floor."""
    person = posed(
        human(1.2), {"hip_flexion": (90, 91), "knee_flexion": (90, 91)}, 2, np.random.default_rng(0)
    )
    assert seat_down(person, 0.45) == pytest.approx(0.45)
    assert person.vertices[..., 1].max() < -5.0 * CENTIMETRE
    assert seat_down(person, None) < 0.4
    assert person.vertices[..., 1].max() == pytest.approx(0.0, abs=1e-6)


def test_a_person_on_a_box_is_found_and_scored() -> None:
    """In front of the camera the joints are visible; the tracker finds them, and the table says so."""
    rng = np.random.default_rng([1, 1])
    measures = draw_measures(*SIZES["man"], rng)
    footage = record(SITUATIONS["box"](human_of(measures), FEW, rng), 0.0, rng, SMALL)
    assert footage.visible.mean() > 0.8
    prepared = prepare()
    found, _ = follow(Tracker(DirectRefiner(), preset("default"), prepared), footage.frames)
    scored = score("box", "box 0 man", footage, found, measures)
    assert scored.found
    console = screen()
    with console.capture() as shown:
        console.print(score_table([scored]))
    assert [line.split()[1] for line in shown.get().splitlines() if "100.0" in line] == ["box", "all"]


def test_what_a_desk_hides_is_not_visible() -> None:
    """A board in front of the legs hides knees and ankles, and not the head."""
    rng = np.random.default_rng(0)
    situation = SITUATIONS["box"](human(1.75), FEW, rng)
    situation.furniture.append(block((-1.0, 1.0), (-0.75, -0.7), (0.0, 0.85)))
    footage: Footage = record(situation, 0.0, rng, SMALL)
    shown = dict(zip(footage.names, footage.visible.mean(axis=0), strict=True))
    assert shown["left_knee"] + shown["left_ankle"] + shown["right_ankle"] == 0.0
    assert shown["head"] == shown["left_shoulder"] == 1.0
