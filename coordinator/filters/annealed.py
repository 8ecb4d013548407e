"""The annealed particle filter (Deutscher, Blake and Reid, CVPR 2000), a baseline.

Each frame the particles pass through layers. In each they are weighed by a power of the likelihood, drawn
by weight and diffused, less from layer to layer. The power of a layer is the one that lets a given share of
the particles survive: with normalised weights w, 1 / sum w^2 = share * N. What is reported is the weighted
mean of the last layer. A frame costs `particles` evaluations of the likelihood in each of its layers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.kinematics import retract
from common.refinement import Refined
from common.settings import FilterSettings
from coordinator.filters.belief import Belief
from coordinator.filters.condensation import CONDENSATION, Condensation, weigh
from coordinator.filters.proposal import Proposal
from coordinator.filters.resampling import effective_sample_size, normalise, systematic
from coordinator.filters.sighting import Sighting

Array = NDArray[np.float64]

LARGEST_POWER = 1e9


@dataclass(frozen=True, slots=True, eq=False)
class Layer(Proposal[Belief]):
    """The particles of one layer of a frame."""

    spread: Array  # (D,) standard deviation of the noise that they were diffused with
    left: int  # layers of the frame that are still to come


@dataclass(frozen=True, slots=True)
class Annealed:
    """The steps of the method, in each frame for layer after layer."""

    first: Condensation = CONDENSATION  # gives the first layer
    layers: int = 10
    survival_rate: float = 0.5  # of the particles, from layer to layer

    def begin(self, model: BodyModel, pose: Array, settings: FilterSettings) -> Belief:
        """As in CONDENSATION."""
        return self.first.begin(model, pose, settings)

    def propose(
        self,
        model: BodyModel,
        past: Belief,
        sighting: Sighting,
        settings: FilterSettings,
        rng: np.random.Generator,
    ) -> Layer:
        """The first layer: selected and predicted as in CONDENSATION."""
        first = self.first.propose(model, past, sighting, settings, rng)
        spread = self.first.diffusion(model)
        return Layer(past, first.ancestors, first.poses, sighting.interval, spread, self.layers - 1)

    def update(
        self,
        model: BodyModel,
        layer: Layer,
        assessed: Refined,
        settings: FilterSettings,
        rng: np.random.Generator,
    ) -> Belief | Layer:
        """The next layer from the likelihoods of this one; after the last layer the belief."""
        ancestors, measured, log_weights = measure(layer.ancestors, assessed, self.survival_rate)
        if layer.left == 0:
            found = weigh(model, layer, ancestors, measured, log_weights)
            return replace(found, log_weights=as_likely(found.log_weights, measured.log_likelihood))
        survivors = systematic(normalise(log_weights), settings.particles, rng)
        spread = layer.spread * np.sqrt(self.survival_rate)  # P_m = (alpha_M ... alpha_m) P_0
        noise = spread * rng.standard_normal((settings.particles, len(spread)))
        poses = retract(model, measured.poses[survivors], noise)
        return Layer(layer.past, ancestors[survivors], poses, layer.interval, spread, layer.left - 1)


ANNEALED = Annealed()


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


def as_likely(log_weights: Array, log_likelihood: Array) -> Array:
    """The same log weights (N,) but for a constant: the greatest is the greatest log likelihood (N,)."""
    if not np.isfinite(log_weights.max()):
        return log_weights
    shifted: Array = log_weights + (log_likelihood.max() - log_weights.max())
    return shifted


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
