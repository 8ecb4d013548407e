"""The annealed particle filter (Deutscher, Blake and Reid, CVPR 2000), a baseline.

Each frame the particles pass through layers. In each they are weighed by a power of the likelihood, drawn
by weight and diffused, less from layer to layer. The power of a layer is the one that lets a given share of
the particles survive: with normalised weights w, 1 / sum w^2 = share * N. What is reported is the weighted
mean of the last layer. A frame costs `particles` evaluations of the likelihood in each of its layers.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.kinematics import retract
from common.refinement import Refined
from common.settings import FilterSettings
from coordinator.filters.belief import Belief
from coordinator.filters.condensation import diffusion, weigh
from coordinator.filters.motion import propagate
from coordinator.filters.resampling import effective_sample_size, normalise, systematic

Array = NDArray[np.float64]

LARGEST_POWER = 1e9


def advance(
    model: BodyModel,
    past: Belief,
    assess: Callable[[Array], Refined],
    settings: FilterSettings,
    rng: np.random.Generator,
) -> Belief:
    """One frame, layer by layer. `assess` gives the likelihood of poses (N, D)."""
    spread = diffusion(model, settings)
    shape = (settings.particles, past.poses.shape[1])
    ancestors = systematic(past.weights, settings.particles, rng)
    moving = settings.velocity_share * past.velocities[ancestors]
    poses = propagate(model, past.poses[ancestors], moving, spread * rng.standard_normal(shape))
    ancestors, measured, log_weights = measure(ancestors, assess(poses), settings.survival_rate)
    for _ in range(settings.layers - 1):
        survivors = systematic(normalise(log_weights), settings.particles, rng)
        spread = spread * np.sqrt(settings.survival_rate)  # P_m = (alpha_M ... alpha_m) P_0
        poses = retract(model, measured.poses[survivors], spread * rng.standard_normal(shape))
        ancestors, measured, log_weights = measure(
            ancestors[survivors], assess(poses), settings.survival_rate
        )
    return weigh(model, past.poses[ancestors], measured, log_weights)


def measure(
    ancestors: NDArray[np.int64], assessed: Refined, survival_rate: float
) -> tuple[NDArray[np.int64], Refined, Array]:
    """The particles that were answered, where they came from, and their annealed log weights."""
    answered = assessed.answered
    measured = assessed.take(answered)
    return ancestors[answered], measured, anneal(measured.log_likelihood, survival_rate)


def anneal(log_likelihood: Array, survival_rate: float) -> Array:
    """Log weights (N,) by which that share of the particles survives."""
    return find_power(log_likelihood, survival_rate) * log_likelihood


def find_power(log_likelihood: Array, survival_rate: float) -> float:
    """The power of the likelihoods (N,) with which the survival rate is reached, by bisection.

    The rate falls from 1 at power 0 to the share of the likeliest; where that is higher already than what
    is asked for, the largest power.
    """
    low, high = 0.0, 1.0
    while survival(log_likelihood, high) > survival_rate and high < LARGEST_POWER:
        low, high = high, 2.0 * high
    for _ in range(60):
        middle = 0.5 * (low + high)
        if survival(log_likelihood, middle) > survival_rate:
            low = middle
        else:
            high = middle
    return high


def survival(log_likelihood: Array, power: float) -> float:
    """Effective share of particles that survive a draw by a power of their likelihoods (N,)."""
    return effective_sample_size(normalise(power * log_likelihood)) / len(log_likelihood)
