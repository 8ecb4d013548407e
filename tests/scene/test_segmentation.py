"""The subject is segmented from a room, and every other pixel has the right label."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from gepf.common.camera import Intrinsics
from gepf.common.frame import EMPTY, HIDDEN, SUBJECT, UNKNOWN, UNMEASURED, View
from gepf.coordinator.scene.scene import Scene
from gepf.coordinator.scene.segmentation import (
    Segmentation,
    measure_distances,
    nearest_of,
    segment_body,
    segment_masks,
    slices,
)
from gepf.coordinator.settings import SceneSettings
from tests.support.rooms import CABINET, PERSON, TABLE, Box, Room


def whole(cut: Segmentation, shape: tuple[int, int]) -> NDArray[np.uint8]:
    """Kinds of the whole picture (H, W), UNKNOWN outside what was looked at."""
    kinds = np.full(shape, UNKNOWN, dtype=np.uint8)
    left, top, right, bottom = cut.window
    kinds[top:bottom, left:right] = cut.labels
    return kinds


def cut_from(room: Room, frame: View, off: float = 0.0) -> NDArray[np.uint8]:
    """Labels of a frame's pixels, segmented with a body that has this offset, metres."""
    view = Scene(SceneSettings()).observe(frame)
    surface = room.surface((PERSON[0] + off, PERSON[1]))
    return whole(segment_body(view, surface, measure_distances(view, surface)), view.depth.shape)


@pytest.mark.parametrize("boxes", [(), (CABINET,), (TABLE, CABINET)])
@pytest.mark.parametrize("off", [0.0, 0.06])
def test_the_subject_is_segment_body(boxes: tuple[Box, ...], off: float) -> None:
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
    floor = bare.see(None).view.metres()
    kinds = cut_from(bare, bare.see(PERSON).view)
    assert not np.any(kinds[(floor < 3.5) & ~truth] == HIDDEN)


def test_what_is_not_measured_is_told_apart_in_a_room_and_empty_where_nothing_else_is_seen() -> None:
    """The camera's shadow beside the person is UNMEASURED; in a segmented recording it is empty."""
    room = Room()
    frame, truth = room.see(PERSON)
    shadow = np.roll(truth, 4, axis=1) & ~truth
    kinds = cut_from(room, replace(frame, depth=np.where(shadow, np.uint16(0), frame.depth)))
    assert set(kinds[shadow]) == {UNMEASURED}
    alone = replace(frame, depth=np.where(truth, frame.depth, np.uint16(0)))
    view = Scene(SceneSettings()).observe(alone)
    assert not view.shows_room
    surface = room.surface(PERSON)
    assert set(segment_body(view, surface, measure_distances(view, surface)).labels.ravel()) == {
        SUBJECT,
        EMPTY,
    }


def test_pixels_that_are_known_are_the_subject() -> None:
    """If a person's pixels are given, exactly these are the subject; the rest of a wider mask is unknown."""
    room = Room((TABLE,), noise=0.001)
    frame, truth = room.see(PERSON)
    part = truth & (np.arange(truth.shape[1]) < np.argwhere(truth)[:, 1].mean())
    for mask, segmentation in zip(
        (part, truth), segment_masks(Scene(SceneSettings()).observe(frame), [part, truth]), strict=True
    ):
        kinds = whole(segmentation, truth.shape)
        np.testing.assert_array_equal(kinds == SUBJECT, mask)
        assert set(kinds[truth & ~mask]) <= {UNKNOWN}
        assert np.any(kinds == HIDDEN)
        assert np.any(kinds == EMPTY)


def test_of_two_people_each_has_the_nearest_pixels() -> None:
    """Two people side by side: almost no pixel is assigned to the other."""
    room = Room(noise=0.001)
    places = (-0.25, 2.4), (0.25, 2.6)
    seen = [room.see(place) for place in places]
    depth = np.minimum(seen[0].view.depth, seen[1].view.depth)
    truth = [one.mask & (one.view.depth == depth) for one in seen]
    view = Scene(SceneSettings()).observe(replace(seen[0].view, depth=depth))
    surfaces = [room.surface(place) for place in places]
    distances = [measure_distances(view, surface) for surface in surfaces]
    nearest = nearest_of(view, distances)
    for n in range(2):
        found = segment_body(view, surfaces[n], distances[n], distances[n] > nearest)
        mine = np.zeros(depth.shape, dtype=np.bool_)
        mine[slices(found.window)] = found.labels == SUBJECT
        assert np.mean(truth[n][mine]) > 0.97
        assert np.mean(mine[truth[n]]) > 0.9


def test_no_place_of_a_body_reads_beyond_the_picture() -> None:
    """Bodies outside of the picture, behind the camera or at its border are segmented; in plain Python."""
    code = "import tests.scene.test_segmentation as test; test.segment_everywhere()"
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)


def segment_everywhere() -> None:
    """Segment bodies beside small frames, behind them, at the camera, far away and at the border.

    One of the frames is empty. Where an index is out of bounds, this raises.
    """
    cloud = np.random.default_rng(0).uniform(-0.01, 0.01, (20, 3))
    camera = Intrinsics(16, 12, 14.0, 14.0, 7.5, 5.5)
    places = (9.0, 2.0), (0.0, -1.0), (0.0, 0.05), (0.0, 60.0), (-1.15, 2.0)
    for (x, z), units in itertools.product(places, (0, 1, 2000, 60_000)):
        surface = cloud + np.array([x, 0.0, z])
        frame = View(0, 0.0, np.full((12, 16), units, np.uint16), 1000.0, camera)
        scene = Scene(SceneSettings(), np.full((12, 16), 3.0, np.float32))
        view = scene.observe(frame)
        distances = [measure_distances(view, surface), measure_distances(view, surface + 0.1)]
        nearest = nearest_of(view, distances)
        scene.learn(view, np.isfinite(nearest))
        left, top, right, bottom = segment_body(view, surface, distances[0], distances[0] > nearest).window
        assert 0 <= left <= right <= camera.width
        assert 0 <= top <= bottom <= camera.height
