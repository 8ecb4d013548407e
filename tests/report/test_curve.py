"""The drawings of angles: true to the numbers, right beside left, honest about what is not known."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from coordinator.report.angles import draw_angles
from coordinator.report.curve import (
    BOTTOM,
    DEGREES,
    HEIGHT,
    LEFT,
    RIGHT,
    TOP,
    Curve,
    Scale,
    draw_curve,
    thin,
    ticks,
)
from coordinator.results.track import Track

WIDTH = 300.0


def curve(degrees: list[float], deviation: float = 2.0, doubtful: tuple[int, ...] = ()) -> Curve:
    """An angle at ten frames a second."""
    value = np.array(degrees)
    shaded = np.isin(np.arange(len(value)), doubtful)
    return Curve("left knee", np.arange(len(value)) / 10.0, value, np.full(len(value), deviation), shaded)


def points_of(drawing: str, kind: str) -> list[np.ndarray]:
    """Points (N, 2) of every path of one kind."""
    paths = re.findall(rf'class="{kind}" d="M([^"HZ]*)', drawing)
    return [np.array([point.split() for point in path.split("L")], dtype=float) for path in paths]


def test_line_and_band_are_where_the_numbers_are() -> None:
    """First and last frame at the drawing's edges, greatest plus deviation at its top, and so on."""
    drawn = draw_curve(curve([0.0, 10.0, 5.0]), (-2.0, 12.0), WIDTH)
    (line,) = points_of(drawn, "line")
    assert line[0] == pytest.approx([LEFT, HEIGHT - BOTTOM - (HEIGHT - BOTTOM - TOP) * 2.0 / 14.0], abs=0.06)
    assert line[2, 0] == pytest.approx(WIDTH - RIGHT)
    (band,) = points_of(drawn, "band")
    assert len(band) == 6
    assert band[1, 1] == pytest.approx(TOP, abs=0.06)
    assert band[-1, 1] == pytest.approx(HEIGHT - BOTTOM, abs=0.06)


def test_what_is_not_known_is_not_drawn() -> None:
    """A frame without a value parts the line; one that is lost is shaded half a frame to either side."""
    drawn = draw_curve(curve([0.0, 1.0, np.nan, 3.0, 4.0], doubtful=(2,)), (0.0, 4.0), WIDTH)
    assert [len(line) for line in points_of(drawn, "line")] == [2, 2]
    (box,) = re.findall(r'class="doubt" d="M([\d.]+) [\d.]+H([\d.]+)', drawn)
    span = WIDTH - LEFT - RIGHT
    assert [float(edge) for edge in box] == pytest.approx(
        [LEFT + span * 1.5 / 4.0, LEFT + span * 2.5 / 4.0], abs=0.1
    )


def test_nothing_known_still_draws() -> None:
    """Of an angle of which no frame is known there are axes alone, and a single frame is no fault."""
    drawn = draw_curve(curve([np.nan, np.nan]), curve([np.nan, np.nan]).reach, WIDTH)
    assert "nan" not in drawn
    assert not points_of(drawn, "line")
    assert "nan" not in draw_curve(curve([5.0]), curve([5.0]).reach, WIDTH)


def test_names_are_text() -> None:
    """A joint's name that looks like HTML is shown."""
    drawn = draw_curve(replace(curve([0.0, 1.0]), name="<b>"), (0.0, 1.0), WIDTH)
    assert "&lt;b&gt;" in drawn


@pytest.mark.parametrize(
    ("least", "greatest", "texts"),
    [
        (-3.0, 95.0, ["0", "20", "40", "60", "80"]),
        (0.0, 2.0, ["0", "0.5", "1", "1.5", "2"]),
        (-200.0, 2000.0, ["0", "720", "1440"]),
    ],
)
def test_ticks_are_few_and_round(least: float, greatest: float, texts: list[str]) -> None:
    """Of degrees; each where the scale has it."""
    on = Scale(least, greatest, 0.0, 1.0)
    found = list(ticks(on, DEGREES))
    assert [text for _, text in found] == texts
    assert [place for place, _ in found] == pytest.approx(on(np.array([float(text) for text in texts])))


def test_long_recordings_keep_their_extremes() -> None:
    """Of 100 000 frames some hundreds are drawn, the ends and a peak of one frame among them."""
    values = np.sin(np.arange(100_000) / 1000.0)
    values[54_321] = 7.0
    kept = thin(np.arange(100_000), values, WIDTH)
    assert len(kept) <= 2 * WIDTH + 2
    assert {0, 54_321, 99_999} <= set(kept.tolist())
    assert np.all(np.diff(kept) > 0)


def track_of(names: tuple[str, ...], degrees: list[list[float]]) -> Track:
    """A track of some angles (F, A)."""
    angle = np.radians(np.array(degrees))
    count = len(angle)
    return Track(
        frame=np.arange(count),
        time_s=np.arange(count) / 30.0,
        dof_names=(),
        pose=np.zeros((count, 0)),
        joint_names=(),
        joint_positions=np.zeros((count, 0, 3)),
        hypothesis_pose=np.zeros((count, 1, 0)),
        hypothesis_weight=np.ones((count, 1)),
        status=np.array(["tracked"] * count),
        angle_names=names,
        angle=angle,
        angle_deviation=np.zeros_like(angle),
    )


def test_right_stands_before_left_on_one_scale() -> None:
    """An elbow that bends to 80 and one that bends to 40 degrees: half as high, in two columns."""
    names = ("left_elbow_flexion", "right_elbow_flexion")
    ((group, columns, (right, left)),) = draw_angles(track_of(names, [[0.0, 0.0], [40.0, 80.0]]))
    assert (group, columns) == ("arms", 2)
    assert "right elbow flexion" in right
    heights = [points_of(each, "line")[0] for each in (right, left)]
    assert heights[0][1, 1] == pytest.approx(TOP)
    assert heights[1][1, 1] == pytest.approx((TOP + HEIGHT - BOTTOM) / 2.0)


def test_joints_of_a_robot_have_scales_of_their_own() -> None:
    """They stand three in a row under one heading."""
    ((group, columns, drawn),) = draw_angles(track_of(("elbow", "wrist"), [[0.0, 0.0], [40.0, 80.0]]))
    assert (group, columns) == ("base and joints", 3)
    assert all(points_of(each, "line")[0][1, 1] == pytest.approx(TOP) for each in drawn)
