"""One frame of a filter on its own, without workers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.refinement import Refined
from gepf.coordinator.filters.belief import Belief, Observation, Proposal
from gepf.coordinator.filters.gradient_enhanced import MergedEarly, update
from gepf.coordinator.filters.methods import METHODS, Method
from gepf.coordinator.settings import FilterSettings

INTERVAL = 0.1  # seconds between frames
NOTHING_SEEN = Observation(np.empty((0, 3)), INTERVAL, None, 1)

Merging = Callable[[BodyModel, Proposal, Refined, FilterSettings, np.random.Generator], Belief]


def advance(
    method: str | Method,
    model: BodyModel,
    past: Any,
    refine: Callable[[Array], Refined],
    settings: FilterSettings,
    rng: np.random.Generator,
    sighting: Observation = NOTHING_SEEN,
    *,
    merges_early: bool = False,
) -> Any:
    """The belief after a frame in which particles (N, D) are refined by a function."""
    steps = METHODS[method] if isinstance(method, str) else method
    found: Any = replace(steps.propose(model, past, sighting, settings, rng), merges_early=merges_early)
    while isinstance(found, Proposal):
        found = steps.update(model, found, refine(found.poses), settings, rng)
    return found


def update_twice(
    model: BodyModel, proposal: Proposal, after: Refined, settings: FilterSettings, rng: np.random.Generator
) -> Belief:
    """The belief if particles are merged early, and further iterations change nothing."""
    early = update(model, replace(proposal, merges_early=True), after, settings, rng)
    assert isinstance(early, MergedEarly)
    kept = [int(np.flatnonzero(np.all(after.poses == pose, axis=1))[0]) for pose in early.poses]
    early = replace(early, log_prior=proposal.log_prior)
    belief = update(model, early, after.take(np.array(kept)), settings, rng)
    assert isinstance(belief, Belief)
    return belief


def update_once(
    model: BodyModel, proposal: Proposal, after: Refined, settings: FilterSettings, rng: np.random.Generator
) -> Belief:
    """The belief if particles are merged once."""
    belief = update(model, proposal, after, settings, rng)
    assert isinstance(belief, Belief)
    return belief
