"""Scenes that `gepf synth` knows, by name."""

from __future__ import annotations

from coordinator.synthesis.scenes.arm import arm
from coordinator.synthesis.scenes.turn import turn

SCENES = {"arm": arm, "turn": turn}
