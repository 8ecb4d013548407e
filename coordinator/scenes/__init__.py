"""Scenes that `gepf synth` knows, by name."""

from __future__ import annotations

from coordinator.scenes.arm import arm
from coordinator.scenes.turn import turn

SCENES = {"arm": arm, "turn": turn}
