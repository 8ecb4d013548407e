"""Typed settings with the presets `paper` and `default`. They are stored with every result."""

from __future__ import annotations

from typing import Literal

import msgspec

from gepf.common.errors import check_choice

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

    icp_iterations: int = 3  #: 0 only assesses the likelihood
    descent: Descent = "plain"
    damping: float = 0.1  #: lambda of Eq. 4
    sensor: Sensor = "distance"
    noise_depth: float = 0.01  #: standard deviation of an observed point along the viewing direction
    noise_lateral: float = 0.01  #: across it; closest points are searched in units of both
    likelihood_scale: float = 0.01  #: metres, root mean square residual that reduces the likelihood by e^-1/2
    outside_weight: float = 1.0  #: of squared distances of points outside of the surface; the camera model's
    pose_deviation: float = 0.0  #: prior of joint angles around rest; the unit of rest_spreads; 0: none

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


class FilterSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Steps 1-3, 6 and 7 of the filter."""

    particles: int = 20  #: of `annealed`: per layer
    merge_angle_deg: float = 4.0  #: d; with `explore` covariances decide, unless correspondences are soft
    velocity_time_s: float | None = None  #: in which a velocity decays to 1 / e; None: never
    explore: bool = False  #: proposals for single limbs, see coordinator/filters/exploration.py


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Everything that determines the results of a run, apart from the input."""

    preset: str = "default"
    method: str = "gepf"
    seed: int = 0
    points: int = 10_000  #: largest number of observed points
    measure_noise: bool = True  #: in the first frame; the noise of `refine` is the minimum
    pace_iterations: float = 0.0  #: growth of iterations with the time between frames
    measure_person: bool = True  #: stature, from the first frames that show a person
    recover: bool = True  #: redetect the body if it is lost or in doubt
    rotate_deg: int | None = None  #: clockwise, makes a person upright; None to find it
    refine: RefineSettings = RefineSettings()
    filter: FilterSettings = FilterSettings()


PRESETS = {
    "default": Settings(
        preset="default",
        points=3_000,
        pace_iterations=2.0,
        refine=RefineSettings(
            icp_iterations=4,
            descent="accelerated",
            sensor="camera",
            likelihood_scale=0.004,
            pose_deviation=1.6,
        ),
        filter=FilterSettings(velocity_time_s=0.05, explore=True),
    ),
    "paper": Settings(preset="paper", measure_person=False, recover=False),
}


def preset(name: str) -> Settings:
    """Settings of a preset; InputError lists the valid ones."""
    check_choice("preset", name, PRESETS)
    return PRESETS[name]
