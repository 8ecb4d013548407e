"""Several people from Python."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gepf
from tests.support.pairs import pair
from tests.support.people import SETTINGS


def test_two_people_are_tracked_and_saved(tmp_path: Path) -> None:
    """A list of estimates a frame; each person's run is loaded again."""
    first, _ = pair()
    with gepf.PeopleTracker(2, SETTINGS) as tracker:
        frames = list(tracker.follow(first.frames[:3]))
        assert tracker.found == 2
        folders = tracker.save(frames, tmp_path / "run")
    assert [len(estimates) for estimates in frames] == [2, 2, 2]
    runs = [gepf.load(folder) for folder in folders]
    for place, run in enumerate(runs):
        np.testing.assert_array_equal(run.joint("head")[2], frames[2][place].joint("head"))
    apart = runs[0].joint("pelvis") - runs[1].joint("pelvis")
    assert np.linalg.norm(apart, axis=1) == pytest.approx(1.02, abs=0.06)


def test_nobody_is_refused() -> None:
    """Zero people to track, and no estimates to save."""
    with pytest.raises(gepf.InputError, match="would track no one"):
        gepf.PeopleTracker(0)
    with pytest.raises(gepf.InputError, match="no person to save"):
        gepf.PeopleTracker(2).save([], "nowhere")
