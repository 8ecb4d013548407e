"""Short forms of `chaos`, `resume_kills` and `two_runs`: real processes, really killed."""

from __future__ import annotations

from tests.disturbance import chaos, resume_kills, two_runs


def test_workers_that_are_killed_frozen_and_slowed_change_no_byte() -> None:
    """No frame is lost, though requests died with their workers and were sent again."""
    result = chaos.compare(frames=60, seed=1, bound=240.0)
    assert result["identical"], result
    assert result["frames_lost"] == 0
    assert result["acts"] > 0
    assert result["batches_sent_again"] > 0


def test_a_killed_coordinator_goes_on_with_the_same_bytes() -> None:
    """Whether it had begun or not, whatever it was doing."""
    killed = resume_kills.try_all(kills=2, frames=40, seed=2, longest=0.05)
    assert all(each.identical for each in killed), killed
    assert any(each.recorded > 0 for each in killed)


def test_two_runs_on_one_pool_end_as_each_alone() -> None:
    """Two workers linked to two coordinators at once."""
    assert two_runs.compare(frames=6, rounds=1)["identical"]
