"""The baselines, without refinement and merging: CONDENSATION and the annealed particle filter."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import ROTATION, BodyModel
from gepf.common.kinematics import difference, retract
from gepf.common.refinement import Refined
from gepf.coordinator.filters.belief import (
    Belief,
    Observation,
    Proposal,
    draw_ancestors,
    mean_pose,
    normalise,
)
from gepf.coordinator.filters.priors import motion_model
from gepf.coordinator.settings import FilterSettings


def begin(model: BodyModel, pose: Array, settings: FilterSettings) -> Belief:  # noqa: ARG001 as all methods
    """One particle at rest at the initial pose (D,); the noise of the first frame spreads it."""
    return Belief.at(pose)


@dataclass(frozen=True, slots=True)
class Condensation:
    """CONDENSATION (Isard and Blake, IJCV 1998): draw by weight, predict, weight by the likelihood.

    A particle is a pose and the motion that led to it. It moves by its velocity and Gaussian noise, with the
    standard deviations per frame that are given here. The reported pose is the weighted mean.
    """

    diffusion_deg: float = 2.0  # of joint angles
    diffusion_position: float = 0.01  # metres

    def propose(
        self,
        model: BodyModel,
        past: Belief,
        observation: Observation,
        settings: FilterSettings,
        rng: np.random.Generator,
    ) -> Proposal:
        """Select and predict: the particles of a frame, whose likelihood is requested."""
        ancestors = draw_ancestors(past.weights, settings.particles, rng)
        noise = self.diffusion(model) * rng.standard_normal((settings.particles, past.poses.shape[1]))
        motion = observation.expect(motion_model(settings).predict(past, observation.interval))
        moved = retract(model, past.poses[ancestors], motion[ancestors])
        return Proposal(past, ancestors, retract(model, moved, noise), observation.interval)

    def update(
        self,
        model: BodyModel,
        proposal: Proposal,
        assessed: Refined,
        settings: FilterSettings,
        rng: np.random.Generator,  # noqa: ARG002 as all methods
    ) -> Belief:
        """Measure: weight the proposed particles by their likelihood."""
        return weigh(model, proposal, assessed, assessed.log_likelihood, settings)

    def diffusion(self, model: BodyModel) -> Array:
        """Standard deviation (D,) of the motion model's noise in a frame, radians and metres."""
        turning, angle = model.kinds == ROTATION, np.deg2rad(self.diffusion_deg)
        return np.where(model.moves, np.where(turning, angle, self.diffusion_position), 0.0)


def weigh(
    model: BodyModel, proposal: Proposal, measured: Refined, log_weights: Array, settings: FilterSettings
) -> Belief:
    """The belief of measured particles (N,)."""
    order = np.argsort(-log_weights, kind="stable")
    poses = measured.poses[order]
    motion = difference(model, proposal.past.poses[proposal.ancestors[order]], poses)
    return Belief(
        poses=poses,
        log_weights=log_weights[order],
        residual=measured.residual[order],
        velocities=motion_model(settings).update(motion, proposal.interval),
        reported=mean_pose(model, poses, normalise(log_weights[order])),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Layer(Proposal):
    """The particles of one layer of a frame of the annealed filter."""

    spread: Array  # (D,) standard deviation of the noise of their diffusion
    left: int  # remaining layers of the frame


@dataclass(frozen=True, slots=True)
class Annealed:
    """The annealed particle filter (Deutscher, Blake and Reid, CVPR 2000).

    In each frame the particles pass through layers. In each layer they are weighted by a power of the
    likelihood, drawn by weight and diffused, with decreasing noise. The power of a layer is chosen such that
    a given share of the particles survives: with normalised weights w, 1 / sum w^2 = share * N. The reported
    pose is the weighted mean of the last layer. Each layer costs `particles` evaluations of the likelihood.
    """

    first: Condensation = Condensation()  # makes the first layer
    layers: int = 10
    survival_rate: float = 0.5  # of the particles, from layer to layer

    def propose(
        self,
        model: BodyModel,
        past: Belief,
        observation: Observation,
        settings: FilterSettings,
        rng: np.random.Generator,
    ) -> Layer:
        """The first layer: selected and predicted as in CONDENSATION."""
        first = self.first.propose(model, past, observation, settings, rng)
        spread = self.first.diffusion(model)
        return Layer(past, first.ancestors, first.poses, observation.interval, spread, self.layers - 1)

    def update(
        self,
        model: BodyModel,
        layer: Layer,
        assessed: Refined,
        settings: FilterSettings,
        rng: np.random.Generator,
    ) -> Belief | Layer:
        """The next layer from the likelihoods of this one; after the last layer the belief."""
        likelihood = assessed.log_likelihood
        log_weights = find_power(likelihood, self.survival_rate) * likelihood
        if layer.left == 0:
            weighed = weigh(model, layer, assessed, log_weights, settings)
            if not np.isfinite(log_weights.max()):
                return weighed
            as_likely = weighed.log_weights + (likelihood.max() - log_weights.max())
            return replace(weighed, log_weights=as_likely)  # gating uses the greatest
        survivors = draw_ancestors(normalise(log_weights), settings.particles, rng)
        spread = layer.spread * np.sqrt(self.survival_rate)  # P_m = (alpha_M ... alpha_m) P_0
        noise = spread * rng.standard_normal((settings.particles, len(spread)))
        poses = retract(model, assessed.poses[survivors], noise)
        return Layer(layer.past, layer.ancestors[survivors], poses, layer.interval, spread, layer.left - 1)


def find_power(log_likelihood: Array, survival_rate: float) -> float:
    """The power of the likelihoods (N,) that gives the survival rate, by bisection.

    The rate decreases from 1 at power 0 to the share of the most likely particles. If that share is above the
    given rate, the result is the largest power.
    """
    low, high, largest = 0.0, 1.0, 1e9
    while survival(log_likelihood, high) > survival_rate and high < largest:
        low, high = high, 2.0 * high
    for _ in range(60):
        middle = 0.5 * (low + high)
        if survival(log_likelihood, middle) > survival_rate:
            low = middle
        else:
            high = middle
    return high


def survival(log_likelihood: Array, power: float) -> float:
    """Effective sample size of a power of the likelihoods (N,), as a share of N."""
    return float(1.0 / np.sum(normalise(power * log_likelihood) ** 2)) / len(log_likelihood)
