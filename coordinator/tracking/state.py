"""What a tracker carries from one frame to the next."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from coordinator.filters.belief import Belief
from coordinator.scene.scene import SceneChange
from coordinator.tracking.size import SizeEstimate
from coordinator.tracking.start import Start
from coordinator.tracking.track_management import TrackManagement


@dataclass(frozen=True, slots=True, eq=False)
class Checkpoint:
    """What changes with every frame, as it is recorded to resume from. A new field here is recorded, too."""

    belief: dict[str, NDArray[np.float64]]  # by field; none until the body is found
    expected: NDArray[np.float64] | None  # pose (D,) near which the next frame shows the subject
    time_s: float | None  # of the last frame that showed something
    generator: str  # the random generator's state as JSON, whose integers have any size
    scene: SceneChange  # what the frame changed in what is known of the scene; of a resumed run, all of it
    management: TrackManagement = field(default_factory=TrackManagement)
    verdict: NDArray[np.float64] | None = None  # (J, 2) about each joint, see certainty/assessment.py
    size: SizeEstimate | None = None  # of the person; None where it is not sought


@dataclass(frozen=True, slots=True, eq=False)
class TrackerState:
    """All that a tracker knows between two frames: from equal states trackers go on bit for bit."""

    start: Start  # is recorded when it changes, which is hardly ever
    checkpoint: Checkpoint


def take_checkpoint(
    belief: Belief | None,
    expected: NDArray[np.float64] | None,
    time_s: float | None,
    rng: np.random.Generator,
    scene: SceneChange,
    management: TrackManagement,
    verdict: NDArray[np.float64] | None,
    size: SizeEstimate | None,
) -> Checkpoint:
    """A belief, a pose (D,), a time, a generator and a scene as values that can be recorded."""
    names = [] if belief is None else [field.name for field in fields(belief)]
    arrays = {name: getattr(belief, name) for name in names}
    generator = json.dumps(rng.bit_generator.state)
    return Checkpoint(arrays, expected, time_s, generator, scene, management, verdict, size)


def load_generator(state: str) -> np.random.Generator:
    """A generator that goes on where another one was saved."""
    rng = np.random.default_rng()
    rng.bit_generator.state = json.loads(state)
    return rng
