"""CONDENSATION (Isard and Blake, IJCV 1998), a baseline: many particles, no descent, no merging.

A particle is a pose and the motion that led to it. Each frame: draw ancestors by weight, move each on by
a second-order autoregressive model (its velocity, and Gaussian noise), weigh by the likelihood. What is
reported is the weighted mean.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.body import ROTATION, BodyModel
from common.kinematics import difference
from common.refinement import Refined
from common.settings import FilterSettings
from coordinator.filters.belief import Belief, mean_pose
from coordinator.filters.motion import propagate
from coordinator.filters.proposal import Proposal
from coordinator.filters.resampling import normalise, systematic
from coordinator.filters.sighting import Sighting

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Condensation:
    """The steps of the method. The standard deviations are those of its motion model's noise in a frame."""

    diffusion_deg: float = 2.0  # of joint angles
    diffusion_position: float = 0.01  # metres

    def begin(self, model: BodyModel, pose: Array, settings: FilterSettings) -> Belief:  # noqa: ARG002
        """A particle at rest at the initial pose (D,); the first frame's noise spreads its children."""
        return Belief(
            poses=pose[None].copy(),
            log_weights=np.zeros(1),
            residual=np.full(1, np.nan),
            velocities=np.zeros((1, len(pose))),
            reported=pose.copy(),
        )

    def propose(
        self,
        model: BodyModel,
        past: Belief,
        sighting: Sighting,
        settings: FilterSettings,
        rng: np.random.Generator,
    ) -> Proposal[Belief]:
        """Select and predict: the particles of a frame, whose likelihood is asked for."""
        ancestors = systematic(past.weights, settings.particles, rng)
        noise = self.diffusion(model) * rng.standard_normal((settings.particles, past.poses.shape[1]))
        motion = sighting.expect(past.velocities, settings.velocity_share)
        particles = propagate(model, past.poses[ancestors], motion[ancestors], noise)
        return Proposal(past, ancestors, particles, sighting.interval)

    def update(
        self,
        model: BodyModel,
        proposal: Proposal[Belief],
        assessed: Refined,
        settings: FilterSettings,  # noqa: ARG002 as all methods
        rng: np.random.Generator,  # noqa: ARG002 as all methods
    ) -> Belief:
        """Measure: weigh the proposed particles by their likelihood."""
        answered = assessed.answered
        measured, ancestors = assessed.take(answered), proposal.ancestors[answered]
        return weigh(model, proposal, ancestors, measured, measured.log_likelihood)

    def diffusion(self, model: BodyModel) -> Array:
        """Standard deviation (D,) of the motion model's noise in a frame, radians and metres."""
        return np.where(model.kinds == ROTATION, np.deg2rad(self.diffusion_deg), self.diffusion_position)


CONDENSATION = Condensation()


def weigh(
    model: BodyModel,
    proposal: Proposal[Belief],
    ancestors: NDArray[np.int64],
    measured: Refined,
    log_weights: Array,
) -> Belief:
    """The belief in measured particles (N,) that came from these ancestors (N,) of the belief before."""
    order = np.argsort(-log_weights, kind="stable")
    poses = measured.poses[order]
    earlier = proposal.past.poses[ancestors[order]]
    return Belief(
        poses=poses,
        log_weights=log_weights[order],
        residual=measured.residual[order],
        velocities=difference(model, earlier, poses) / proposal.interval,
        reported=mean_pose(model, poses, normalise(log_weights[order])),
    )
