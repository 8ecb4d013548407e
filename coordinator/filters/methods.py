"""The methods of tracking by name, and the settings that define them.

The command line and the library choose settings here, and the tracker applies them. So a method is the same
for all callers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, get_args

import msgspec
import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.errors import InputError, check_choice
from gepf.common.refinement import Refined
from gepf.common.settings import Descent, Sensor
from gepf.coordinator.filters import baselines, gradient_enhanced
from gepf.coordinator.filters.baselines import Annealed, Condensation
from gepf.coordinator.filters.belief import Belief, Observation, Proposal
from gepf.coordinator.filters.priors import population_precision
from gepf.coordinator.settings import FilterSettings, Settings, check_settings, preset

Begin = Callable[[BodyModel, Array, FilterSettings], Belief]
Propose = Callable[[BodyModel, Belief, Observation, FilterSettings, np.random.Generator], Proposal]
Update = Callable[[BodyModel, Any, Refined, FilterSettings, np.random.Generator], Belief | Proposal]


@dataclass(frozen=True, slots=True)
class Method:
    """The steps of a filter, with its own types of belief and proposal, and the settings that define it.

    `begin` returns the belief at an initial pose (D,). Then, frame by frame, `propose` returns particles, and
    `update` returns the belief after their refinement, or more particles to refine if the method needs them.
    """

    begin: Begin
    propose: Propose
    update: Update
    particles: int | None = None  # default of the method; None for that of the preset
    lone: bool = False  # always a single particle
    icp_iterations: int | None = None  # fixed number; None for that of the settings

    @property
    def descends(self) -> bool:
        """Whether particles are refined; if not, only their likelihood is computed."""
        return self.icp_iterations != 0


_GRADIENT = gradient_enhanced.begin, gradient_enhanced.propose, gradient_enhanced.update


def baseline(steps: Condensation | Annealed, particles: int) -> Method:
    """A method without refinement, with this number of particles unless the user gives another."""
    return Method(baselines.begin, steps.propose, steps.update, particles, icp_iterations=0)


METHODS = {
    "gepf": Method(*_GRADIENT),
    "gradient": Method(*_GRADIENT, particles=1, lone=True, icp_iterations=6),  # one particle needs more
    "condensation": baseline(Condensation(), particles=1_000),
    "annealed": baseline(Annealed(), particles=100),  # in each layer
}


def find_method(name: str) -> Method:
    """The method with a name; InputError lists the valid names."""
    check_choice("method", name, METHODS)
    return METHODS[name]


def settings_for(
    method: str,
    preset_name: str = "default",
    particles: int | None = None,
    points: int | None = None,
    seed: int = 0,
) -> Settings:
    """The settings of a preset for a method, with the numbers of particles and points that it needs.

    Args:
        method: One of METHODS.
        preset_name: One of PRESETS.
        particles: Number of particles, of `annealed` per layer; None for the default of the method.
        points: Largest number of observed points; None for the default of the method.
        seed: Seed of all random numbers.

    Raises InputError for an unknown name, or a number that the method does not allow.
    """
    settings, chosen = preset(preset_name), find_method(method)
    if chosen.lone and particles not in (None, 1):
        raise InputError(f"method {method} follows a single particle; leave --particles out")
    if points is None:
        points = Settings().points if chosen.lone else settings.points  # one particle can use more
    if particles is None:
        particles = chosen.particles or settings.filter.particles
    of_filter = msgspec.structs.replace(settings.filter, particles=particles)
    asked = {"method": method, "points": points, "filter": of_filter, "seed": seed}
    return apply_method(msgspec.structs.replace(settings, **asked))


def apply_method(settings: Settings) -> Settings:
    """Override the settings that the method fixes: the iterations of ICP and the number of particles.

    Raises InputError for an unknown method, descent or sensor, for settings without particles or points, and
    for values out of range.
    """
    method = find_method(settings.method)
    check_choice("descent", settings.refine.descent, get_args(Descent))
    check_choice("sensor", settings.refine.sensor, get_args(Sensor))
    for name, number in (("particles", settings.filter.particles), ("points", settings.points)):
        if number < 1:
            raise InputError(f"{name}={number} is too small; give 1 or more")
    check_settings(settings)
    refine, of_filter = settings.refine, settings.filter
    if method.icp_iterations is not None:
        refine = msgspec.structs.replace(refine, icp_iterations=method.icp_iterations)
    if method.lone:
        of_filter = msgspec.structs.replace(of_filter, particles=1)
    recover = settings.recover and method.descends and not method.lone  # as in the baselines' papers
    return msgspec.structs.replace(settings, refine=refine, filter=of_filter, recover=recover)


def initial_belief(model: BodyModel, pose: Array, settings: Settings) -> Belief:
    """The belief at an initial pose (D,), of a body with the shape of the population."""
    belief = METHODS[settings.method].begin(model, pose, settings.filter)
    return replace(belief, shape_precision=population_precision(model))
