"""The subject is cut out of a room, and of every other pixel it is known what it says about the subject."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from common.frame import EMPTY, HIDDEN, SUBJECT, UNKNOWN, UNMEASURED, DepthFrame
from coordinator.scene.cutting import CLOSE, REACH, Cut, cut_mask, cut_out
from coordinator.scene.nearness import CAP, CELL, surround
from coordinator.scene.scene import Scene
from tests.support.rooms import CABINET, HEIGHT, TABLE, Box, Room

PERSON = (-0.4, 2.6)


def whole(cut: Cut, shape: tuple[int, int]) -> NDArray[np.uint8]:
    """Kinds of the whole picture (H, W), UNKNOWN outside what was looked at."""
    kinds = np.full(shape, UNKNOWN, dtype=np.uint8)
    left, top, right, bottom = cut.window
    kinds[top:bottom, left:right] = cut.kinds
    return kinds


def cut_from(room: Room, frame: DepthFrame, off: float = 0.0) -> NDArray[np.uint8]:
    """Kinds of a frame's pixels, cut with a body that is so far off its place, metres."""
    view = Scene().see(frame)
    return whole(cut_out(view, room.surface((PERSON[0] + off, PERSON[1]))), view.depth.shape)


@pytest.mark.parametrize("boxes", [(), (CABINET,), (TABLE, CABINET)])
@pytest.mark.parametrize("off", [0.0, 0.06])
def test_the_subject_is_cut_out(boxes: tuple[Box, ...], off: float) -> None:
    """Precision 0.98 and recall 0.95, with a body where the person was two frames before."""
    room = Room(boxes, pitch=0.1, noise=0.0015)
    frame, truth = room.see(PERSON)
    mine = cut_from(room, frame, off) == SUBJECT
    assert np.sum(mine & truth) / mine.sum() > 0.98
    assert np.sum(mine & truth) / truth.sum() > 0.95


def test_a_table_hides_and_a_wall_does_not() -> None:
    """Pixels of a table before the person are HIDDEN, those of the wall behind and of the floor are EMPTY."""
    room = Room((TABLE,))
    frame, truth = room.see(PERSON)
    kinds, depth = cut_from(room, frame), frame.metres()
    looked_at = kinds != UNKNOWN
    assert set(kinds[looked_at & (depth > 0) & (depth < 2.1)]) == {HIDDEN}
    assert set(kinds[looked_at & (depth > 3.5)]) == {EMPTY}
    bare = Room()
    floor = bare.see(None).frame.metres()
    kinds = cut_from(bare, bare.see(PERSON).frame)
    assert not np.any(kinds[(floor < 3.5) & ~truth] == HIDDEN)


def test_furniture_whose_edge_flickers_is_not_the_subjects() -> None:
    """A few pixels that are new do not take a cabinet in; an arm of which most is new is taken."""
    beside: Box = ((PERSON[0] + 0.34, -0.3, 2.55), (PERSON[0] + 0.45, HEIGHT, 2.65))
    room = Room((beside,), noise=0.001)
    frame, truth = room.see(PERSON)
    view = Scene().see(frame)
    empty = room.see(None).frame.metres()
    thing = (empty > 2.5) & (empty < 2.7) & ~truth
    taken = []
    for share in (0.05, 1.0):
        new = thing & (np.random.default_rng(0).random(thing.shape) < share)
        background = np.where(new, np.float32(3.5), np.float32(0.0))
        kinds = whole(cut_out(replace(view, background=background), room.surface(PERSON)), truth.shape)
        taken.append(float(np.mean(kinds[thing] == SUBJECT)))
    assert taken[0] == 0.0
    assert taken[1] > 0.2


def test_what_is_not_measured_is_told_apart_in_a_room_and_empty_where_nothing_else_is_seen() -> None:
    """A camera's shadow beside the person is a kind of its own; in a cut-out recording it is empty."""
    room = Room()
    frame, truth = room.see(PERSON)
    shadow = np.roll(truth, 4, axis=1) & ~truth
    kinds = cut_from(room, replace(frame, depth=np.where(shadow, np.uint16(0), frame.depth)))
    assert set(kinds[shadow]) == {UNMEASURED}
    alone = replace(frame, depth=np.where(truth, frame.depth, np.uint16(0)))
    view = Scene().see(alone)
    assert not view.furnished
    assert set(cut_out(view, room.surface(PERSON)).kinds.ravel()) == {SUBJECT, EMPTY}


@pytest.mark.parametrize(
    ("of_body", "of_room", "expected"),
    [(0.0, 0.0, (0.0, 0.5)), (0.0, 0.1, (0.8, 1.0)), (0.05, 0.15, (0.4, 0.6)), (0.3, 0.1, (0.0, 0.0))],
)
def test_unmeasured_pixels_are_as_empty_as_room_and_body_say(
    of_body: float, of_room: float, expected: tuple[float, float]
) -> None:
    """(r - b) / (r + b) of their unmeasured shares: nothing where the body is missed as often."""
    room = Room()
    frame, truth = room.see(PERSON)
    missed = np.random.default_rng(0).random(truth.shape) < np.where(truth, of_body, of_room)
    gone = replace(frame, depth=np.where(missed, np.uint16(0), frame.depth))
    cut = cut_out(Scene().see(gone), room.surface(PERSON))
    assert expected[0] <= cut.emptiness <= expected[1]


def test_who_was_not_followed_yet_may_be_where_nothing_is_measured() -> None:
    """Of somebody who is only just found nobody knows where the camera misses the body."""
    room = Room()
    frame, truth = room.see(PERSON)
    holes = (np.random.default_rng(0).random(truth.shape) < 0.1) & ~truth
    view = Scene().see(replace(frame, depth=np.where(holes, np.uint16(0), frame.depth)))
    assert cut_mask(view, truth).emptiness == 0.0


def test_pixels_that_are_known_are_the_subject() -> None:
    """Of somebody whose pixels are given, these are the subject and no others."""
    room = Room((TABLE,), noise=0.001)
    frame, truth = room.see(PERSON)
    kinds = whole(cut_mask(Scene().see(frame), truth), truth.shape)
    np.testing.assert_array_equal(kinds == SUBJECT, truth)
    assert np.any(kinds == HIDDEN)
    assert np.any(kinds == EMPTY)


def test_distances_are_those_to_the_nearest_point() -> None:
    """Squared distances between cells are exact up to the farthest of interest."""
    points = np.random.default_rng(3).uniform(-0.2, 0.3, (60, 3)) + np.array([0.1, -0.2, 2.0])
    near = surround(points)
    cells = np.floor((points - near.low) / CELL)
    here = np.argwhere(np.ones(near.squares.shape))
    exact = np.rint(cKDTree(cells).query(here)[0] ** 2).reshape(near.squares.shape)
    within = exact < CAP * CAP
    np.testing.assert_array_equal(near.squares[within], exact[within])
    assert np.all(near.squares[~within] >= CAP * CAP)
    assert CLOSE < REACH < CAP * CELL
