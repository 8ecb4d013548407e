"""Typed settings of the refinement of a particle, which every request brings along."""

from __future__ import annotations

from typing import Literal

import msgspec

SOFT_NOISE_RATIO = 4.0
"""Ratio of depth noise to lateral noise above which correspondences are soft; they are ten times slower."""


Descent = Literal["plain", "accelerated"]
"""Steps of ICP: as in the paper, or over-relaxed, with more damping and fewer visibility tests."""

Sensor = Literal["distance", "camera"]
"""Sensor model: only the distances of observed points, or a complete model of the camera.

The complete model also has empty space, outliers, and, if depth noise dominates, soft correspondences with
the same number of additional iterations. `gepf.worker.kernel.parameters` has the constants of both.
"""


class RefineSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings of a particle's refinement. Lengths in metres, angles in radians."""

    icp_iterations: int = 3  #: iterations of ICP; with 0, only the likelihood is computed
    descent: Descent = "plain"
    damping: float = 0.1  #: lambda of Eq. 4
    sensor: Sensor = "distance"
    noise_depth: float = 0.01  #: standard deviation of an observed point along the viewing direction
    noise_lateral: float = 0.01  #: across it; distances to closest points are in units of both
    likelihood_scale: float = 0.01  #: metres, root mean square residual that reduces the likelihood by e^-1/2
    outside_weight: float = 1.0  #: of squared distances of points outside the surface; the family sets it
    pose_deviation: float = 0.0  #: prior of joint angles around rest; the unit of rest_spreads; 0: none
    max_rest_pull: float = 0.5
    """Deviations from rest beyond which the pull of this prior in a refinement stays the same."""

    @property
    def independent_points(self) -> float:
        """Equivalent number of independent points, by which densities of points are scaled.

        The likelihood is then equally sharp on both sides of the transition from costs to densities.
        """
        return (self.noise_depth / (SOFT_NOISE_RATIO * self.likelihood_scale)) ** 2

    @property
    def stretch(self) -> float:
        """Ratio of lateral to depth noise: the noise is isotropic if depth is multiplied by it."""
        return self.noise_lateral / self.noise_depth

    @property
    def is_soft(self) -> bool:
        """Whether likelihoods are densities of the observed points instead of costs."""
        return self.sensor == "camera" and self.noise_depth > SOFT_NOISE_RATIO * self.noise_lateral

    @property
    def has_joint_prior(self) -> bool:
        """Whether joint angles have a prior: not with soft correspondences, where it was not measured."""
        return not self.is_soft and self.pose_deviation > 0.0
