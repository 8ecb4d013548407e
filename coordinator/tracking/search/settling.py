"""The last of a search: a few rounds of the filter itself on one frame, and the belief to begin with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from common.body import BodyModel
from common.frame import SubjectFrame
from common.settings import FilterSettings, RefineSettings
from coordinator.filters import gradient_enhanced
from coordinator.filters.belief import Belief
from coordinator.filters.gradient_enhanced import Hypotheses
from coordinator.filters.methods import Method
from coordinator.tracking.observing.sighting import see
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.search.stages import Standing, refine

SEED = 0  # of the rounds, whatever the run's: a search draws nothing from the tracker's generator


def settle(
    refiner: Refiner,
    subject: SubjectFrame,
    model: BodyModel,
    standing: Standing,
    settings: RefineSettings,
    rounds: int,
) -> Hypotheses:
    """What the filter makes of candidates on one body after so many rounds on the published frame.

    It merges by angles, whatever the tracker's filter does: nobody is asked how sure a pose is.
    """
    filtering = FilterSettings(explore=True)
    belief, rng = believe(model, standing, filtering), np.random.default_rng(SEED)
    for _ in range(rounds):
        proposal = gradient_enhanced.propose(model, belief, see(subject, None), filtering, rng)
        refined = refine(refiner, model, proposal.poses, settings)
        belief = gradient_enhanced.update(model, proposal, refined, filtering, rng).at_rest()
    return belief


def believe(model: BodyModel, standing: Standing, settings: FilterSettings) -> Hypotheses:
    """Candidates (M) as hypotheses at rest, each as uncertain as a start."""
    first = gradient_enhanced.begin(model, standing.poses[0], settings)
    return replace(
        first,
        poses=standing.poses,
        log_weights=standing.log_likelihood,
        residual=standing.residual,
        velocities=np.zeros_like(standing.poses),
        covariances=np.repeat(first.covariances, len(standing.poses), axis=0),
    )


def begin_with(method: Method, model: BodyModel, standing: Standing, settings: FilterSettings) -> Belief:
    """The belief in candidates (M): in all of them, if the method can have several hypotheses."""
    begun = method.begin(model, standing.poses[0], settings)
    if isinstance(begun, Hypotheses) and settings.particles > 1:
        return believe(model, standing, settings)
    return replace(begun, log_weights=standing.log_likelihood[:1], residual=standing.residual[:1])
