"""The subject is cut out of a depth image."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.camera import Intrinsics, back_project
from common.frame import DepthFrame
from coordinator.tracking.observation import first_from, isolate


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_what_is_kept_lies_near(seed: int) -> None:
    """A pixel is the subject's exactly if its back-projected point is within the clearance of the box."""
    rng = np.random.default_rng(seed)
    camera = Intrinsics(40, 30, 35.0, 33.0, 19.2, 14.7)
    depth = rng.integers(500, 6000, (30, 40)).astype(np.uint16) * (rng.random((30, 40)) < 0.7)
    frame = DepthFrame(0, 0.0, depth.astype(np.uint16), 1000.0, camera)
    around = rng.normal([0.0, 0.0, 2.5], 0.3, (20, 3))
    points = back_project(frame.metres(), camera)
    low, high = around.min(axis=0) - 0.8, around.max(axis=0) + 0.8
    expected = np.all((points >= low) & (points <= high), axis=-1) & (depth > 0)
    subject = isolate(frame, around, 10_000)
    assert subject is not None
    left, top, _, _ = subject.view
    kept = np.zeros_like(depth)
    rows, columns = subject.frame.depth.shape
    kept[-top : rows - top, -left : columns - left] = subject.frame.depth
    assert np.array_equal(kept, np.where(expected, depth, 0))


def test_nothing_near_is_no_subject() -> None:
    """Depth far from where the subject must be is not the subject's."""
    frame = DepthFrame(0, 0.0, np.full((4, 4), 5000, np.uint16), 1000.0, Intrinsics(4, 4, 4.0, 4.0, 2.0, 2.0))
    assert isolate(frame, np.array([[0.0, 0.0, 1.0]]), 100) is None


@pytest.mark.parametrize("scale", [1.0, 1000.0, 8000.0, 10_000.0])
def test_raw_depths_are_compared_as_metres(scale: float) -> None:
    """The least value that is so far away: by the numbers themselves, at any bound and between any two."""
    metres = np.arange(65_537).astype(np.float32) / np.float32(scale)
    bounds = [
        *np.random.default_rng(0).uniform(-1.0, 70_000.0 / scale, 200),
        *metres[:70_000:500],
        -np.inf,
        np.inf,
    ]
    for bound in np.array(bounds, np.float64):
        assert first_from(bound, np.float32(scale)) == min(65_536, int(np.searchsorted(metres, bound)))
