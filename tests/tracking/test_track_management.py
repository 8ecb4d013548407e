"""When a tracked body is looked for elsewhere, and when a detection takes the track's place."""

from __future__ import annotations

import numpy as np

from gepf.common.settings import RefineSettings
from gepf.coordinator.tracking.gating import Gate, gate_pose
from gepf.coordinator.tracking.track_management import TrackManagement


def searched(management: TrackManagement, residual: float, frames: int) -> list[int]:
    """Numbers of the frames with a search, of a number of frames with this residual."""
    numbers = []
    for number in range(frames):
        if management.check_due:
            numbers.append(number)
        management = management.updated(Gate(residual), 1000, redetected=False)
    return numbers


def test_a_new_track_is_compared_with_a_search_and_later_only_while_in_doubt() -> None:
    """Once soon after the detection, then at intervals if it is explained badly."""
    sure = searched(TrackManagement(), 0.5, 60)
    assert len(sure) == 1
    assert max(sure) < 15
    assert sure[0] > 0
    doubtful = searched(TrackManagement(), 1.2, 60)
    assert len(doubtful) > len(sure)
    assert max(doubtful) >= 50
    assert np.diff(doubtful).min() > 1
    both_ways = searched(TrackManagement(ambiguous_facing=True), 0.5, 60)
    assert max(both_ways) >= 50


def test_a_body_that_is_not_explained_is_looked_for_after_some_frames() -> None:
    """One bad frame changes nothing; several in a row do, and a good one ends the search."""
    management = TrackManagement().updated(Gate(2.0), 1000, redetected=False)
    assert not management.is_lost
    for _ in range(5):
        management = management.updated(Gate(2.0, "why"), 1000, redetected=False)
    assert management.is_lost
    assert management.reason == "why"
    assert not management.updated(Gate(0.5), 1000, redetected=True).is_lost


def test_an_unknown_body_is_searched_for_at_once_and_then_now_and_then() -> None:
    """A search takes longer than a frame; after an empty frame, the next person is searched at once."""
    management, searches = TrackManagement(), list[int]()
    for number in range(12):
        if management.search_due:
            searches.append(number)
        management = management.not_found("nothing")
    assert searches[0] == 0
    assert 1 < len(searches) < 6
    assert management.nothing_seen().search_due


def test_the_noise_of_the_depth_is_no_loss() -> None:
    """A residual that the assumed noise explains can be believed; without that noise it cannot."""
    noisy = RefineSettings(noise_depth=0.15, noise_lateral=0.15)
    assert gate_pose(-1.0, 0.12, noisy).passes
    assert not gate_pose(-1.0, 0.12, RefineSettings()).passes
    assert not gate_pose(float("nan"), float("nan"), noisy).passes


def test_a_pose_that_something_else_rules_out_does_not_pass() -> None:
    """The first reason is kept; no reason changes nothing."""
    gate = Gate(0.8)
    assert gate.against("") == gate
    assert not gate.against("a board").passes
    assert gate.against("a board").against("floats").why == "a board"
    assert Gate(0.8, "bad").against("a board").why == "bad"
