"""One frame of a filter on its own, without workers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.refinement import Refined
from gepf.coordinator.filters.belief import Observation, Proposal
from gepf.coordinator.filters.methods import METHODS, Method
from gepf.coordinator.settings import FilterSettings

INTERVAL = 0.1  # seconds between frames
NOTHING_SEEN = Observation(np.empty((0, 3)), INTERVAL, None, 1)


def advance(
    method: str | Method,
    model: BodyModel,
    past: Any,
    refine: Callable[[Array], Refined],
    settings: FilterSettings,
    rng: np.random.Generator,
    sighting: Observation = NOTHING_SEEN,
) -> Any:
    """The belief after a frame in which particles (N, D) are refined by a function."""
    steps = METHODS[method] if isinstance(method, str) else method
    found: Any = steps.propose(model, past, sighting, settings, rng)
    while isinstance(found, Proposal):
        found = steps.update(model, found, refine(found.poses), settings, rng)
    return found
