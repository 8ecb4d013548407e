"""From a depth frame to observed points: none lost, none moved, neighbours together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from gepf.common.camera import Intrinsics, back_project, project
from gepf.common.frame import EMPTY, HIDDEN, SUBJECT, UNKNOWN, UNMEASURED, SubjectFrame, SubjectView, View
from gepf.common.nearest_pixels import nearest_occupied_pixels
from gepf.worker.kernel.observation import observe

CAMERA = Intrinsics(40, 30, 35.0, 36.0, 18.2, 14.9)


def frame_of(depth: NDArray[np.uint16], picked: NDArray[np.uint32]) -> SubjectFrame:
    """A frame in millimetres, all of which the camera saw."""
    view = SubjectView(View(0, 0.0, depth, 1000.0, CAMERA), picked, (0, 0, 40, 30))
    return SubjectFrame(0, 0.0, (view,))


def some_depth(seed: int) -> NDArray[np.uint16]:
    """A few pixels between 1 and 3 metres."""
    rng = np.random.default_rng(seed)
    measured = rng.random((30, 40)) < rng.uniform(0.02, 0.9)
    measured[3, 5] = True
    return np.where(measured, rng.integers(1000, 3000, size=(30, 40)), 0).astype(np.uint16)


@given(st.integers(0, 2**32 - 1))
def test_every_picked_pixel_becomes_one_point(seed: int) -> None:
    """The points project back onto their pixels at their depth; padding aside, there are no others."""
    depth = some_depth(seed)
    picked = np.flatnonzero(depth)[::2].astype(np.uint32)
    (observed,) = observe(frame_of(depth, picked)).views
    assert observed.count == len(picked)
    points = observed.points[: observed.count]
    columns, rows = np.rint(project(points, CAMERA)).astype(int).T
    np.testing.assert_array_equal(np.sort(rows * 40 + columns), picked)
    np.testing.assert_allclose(points[:, 2], depth[rows, columns] / 1000.0, rtol=1e-6)
    expected = back_project(depth / 1000.0, CAMERA)[rows, columns]
    np.testing.assert_allclose(points, expected, rtol=1e-5, atol=1e-6)
    assert np.all(observed.points[observed.count :] == points[-1])


@given(st.integers(0, 2**32 - 1))
def test_what_may_hide_the_subject_is_no_evidence_against_it(seed: int) -> None:
    """The body is excluded from empty pixels only; the nearest pixel is the nearest that is not empty."""
    depth = some_depth(seed)
    other = np.random.default_rng(seed).choice([UNKNOWN, EMPTY, HIDDEN, UNMEASURED], size=depth.shape)
    labels = np.where(depth > 0, SUBJECT, other).astype(np.uint8)
    frame = frame_of(depth, np.flatnonzero(depth).astype(np.uint32))
    (plain,) = observe(frame).views
    (observed,) = observe(replace(frame, views=(replace(frame.largest, labels=labels),))).views
    np.testing.assert_array_equal(observed.empty, labels == EMPTY)
    np.testing.assert_array_equal(observed.nearest, nearest_occupied_pixels(labels != EMPTY))
    np.testing.assert_array_equal(observed.points, plain.points)
