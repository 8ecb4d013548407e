"""Typed settings with the presets `paper` and `default`. They are written beside every result."""

from __future__ import annotations

import msgspec

from common.errors import InputError

FAR_NOISIER = 2.0
"""Noise along the viewing direction over that across it, from which on the closest point misleads."""


class RefineSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings of a particle's refinement. Lengths in metres, angles in radians."""

    icp_iterations: int = 3  # 0 only assesses the likelihood
    gauss_newton_iterations: int = 5
    damping: float = 0.1  # lambda of Eq. 4
    damping_share: float = 0.0  # is added to it for each observed point
    pose_deviation: float = 0.0  # of joint angles from rest, a prior; 0: none
    keep_limits: bool = False  # of the joints
    noise_depth: float = 0.01  # standard deviation of an observed point along the viewing direction
    noise_lateral: float = 0.01  # and across it; closest points are sought in units of both
    outlier_distance: float = 0.0  # residuals beyond it lose influence; 0 gives all points full weight
    free_space_weight: float = 0.0  # of model points seen where nothing was observed
    soft_correspondences: bool = False  # for as many iterations more, where depth is by far the noisiest
    likelihood_scale: float = 0.01  # metres of root mean square residual that cost a factor of e^-1/2
    over_relaxation: float = 0.0  # share of each ICP iteration's motion that is added to it, but the last's
    visibility_interval: int = 1  # iterations from one visibility update to the next; above 1 step 5 has none

    @property
    def independent_points(self) -> float:
        """How many points the observed ones are worth as densities: whose mean is as far off as the model.

        So many that the likelihood is as sharp where densities begin as the costs are up to there.
        """
        return (self.noise_depth / (FAR_NOISIER * self.likelihood_scale)) ** 2

    @property
    def is_soft(self) -> bool:
        """Whether likelihoods are densities of the observed points, and not costs."""
        return self.soft_correspondences and self.noise_depth > FAR_NOISIER * self.noise_lateral


class FilterSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Steps 1-3, 6 and 7 of the filter, and what the baselines have in their place."""

    particles: int = 20  # of `annealed`: in each layer
    merge_angle_deg: float = 4.0  # d
    velocity_share: float = 1.0  # of a hypothesis' velocity that its particles start with
    explore: bool = False  # limb by limb, see coordinator/filters/exploration.py
    diffusion_deg: float = 2.0  # of the baselines' motion model, each frame
    diffusion_position: float = 0.01  # metres
    layers: int = 10  # of `annealed`
    survival_rate: float = 0.5  # of its particles, from layer to layer


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Everything that decides what a run computes, the input aside."""

    preset: str = "default"
    method: str = "gepf"
    seed: int = 0
    points: int = 10_000  # observed points at the most
    measure_noise: bool = True  # in the first frame; what `refine` assumes is the least
    pace_iterations: float = 0.0  # how fast they grow with the time between frames
    measure_person: bool = True  # stature and girth, from the first frames that show a person
    recover: bool = True  # look for the body where it is lost or in doubt
    rotate_deg: int | None = None  # turns the picture clockwise until a person is upright; None to find it
    refine: RefineSettings = RefineSettings()
    filter: FilterSettings = FilterSettings()


PRESETS = {
    "default": Settings(
        preset="default",
        points=4_000,
        pace_iterations=2.0,
        refine=RefineSettings(
            icp_iterations=3,
            gauss_newton_iterations=2,
            over_relaxation=1.0,
            visibility_interval=3,
            soft_correspondences=True,
            damping_share=0.0003,
            pose_deviation=1.6,
            keep_limits=True,
            outlier_distance=0.1,
            free_space_weight=1.0,
            likelihood_scale=0.004,
        ),
        filter=FilterSettings(particles=20, velocity_share=0.75, explore=True),
    ),
    "paper": Settings(
        preset="paper",
        measure_person=False,
        recover=False,
        refine=RefineSettings(keep_limits=True),  # which the paper leaves open
    ),
}


def preset(name: str) -> Settings:
    """Settings of a preset; InputError names the valid ones."""
    if name not in PRESETS:
        raise InputError(f"unknown preset '{name}'; choose from {', '.join(PRESETS)}")
    return PRESETS[name]
