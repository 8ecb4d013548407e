"""Which poses and subjects are rejected, and the reasons that users read."""

from __future__ import annotations

from gepf.common.settings import RefineSettings
from gepf.coordinator.settings import GatingSettings
from gepf.coordinator.tracking.judgement import Gate, gate_pose


def test_the_noise_of_the_depth_is_no_loss() -> None:
    """A residual that the assumed noise explains can be believed; without that noise it cannot."""
    noisy = RefineSettings(noise_depth=0.15, noise_lateral=0.15)
    assert gate_pose(-1.0, 0.12, noisy, GatingSettings()).passes
    assert not gate_pose(-1.0, 0.12, RefineSettings(), GatingSettings()).passes
    assert not gate_pose(float("nan"), float("nan"), noisy, GatingSettings()).passes


def test_a_pose_that_something_else_rules_out_does_not_pass() -> None:
    """The first reason is kept; no reason changes nothing."""
    gate = Gate(0.8)
    assert gate.rejected_for("") == gate
    assert not gate.rejected_for("a board").passes
    assert gate.rejected_for("a board").rejected_for("floats").why == "a board"
    assert Gate(0.8, "bad").rejected_for("a board").why == "bad"
