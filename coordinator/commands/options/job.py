"""One `gepf track`, as its options have it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from common.settings import Settings
from coordinator.bodies.human.dofs import HUMAN
from coordinator.bodies.tracked import Bodies
from coordinator.commands.options.scope import AskedScope
from coordinator.pool.options import Pool
from coordinator.results.configuration import Asked
from coordinator.scene.scope import Scope
from coordinator.sources.camera import AS_RECORDED, CameraOptions
from coordinator.sources.joint_states import JointStates


@dataclass(frozen=True, slots=True)
class Job:
    """One `gepf track`."""

    sequence: Path
    out: Path
    settings: Settings
    pool: Pool
    model: str = HUMAN  # or a file
    active: tuple[str, ...] | None = None  # None for the model's own choice
    init: str | None = None  # a file, AUTOMATIC, or None for the sequence's own file if it has one
    frames: str | None = None
    resume: bool = False
    colour: Path | None = None  # frames to draw results over
    given: CameraOptions = AS_RECORDED  # of the camera
    results: str | None = None  # a key on which they are published meanwhile
    results_json: bool = False
    scope: AskedScope = field(default_factory=AskedScope)  # what of the scene is tracked
    people: int = 1  # at the most, at once
    pictures: bool = True
    joint_states: JointStates | None = None  # what encoders say
    idle_timeout: float | None = None  # seconds without a frame until live input is over

    def asked(self, bodies: Bodies, start: Mapping[str, float] | None, scope: Scope) -> Asked:
        """What decides the results besides the input."""
        states = None if self.joint_states is None else self.joint_states.hash
        deadline = self.pool.deadline
        return Asked(self.settings, bodies, self.model, self.active, start, deadline, scope, states)
