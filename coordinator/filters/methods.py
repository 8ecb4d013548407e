"""The methods of tracking by name, and the settings that make each of them.

The command line and the library choose settings here, and the tracker applies them: so a method is the same
whoever asks for it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, get_args

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.errors import InputError
from common.refinement import Refined
from common.settings import Descent, FilterSettings, RefineSettings, Sensor, Settings, preset
from coordinator.filters import gradient_enhanced
from coordinator.filters.baselines import Annealed, Condensation
from coordinator.filters.belief import USUAL_INTERVAL, Belief, Observation, Proposal

Array = NDArray[np.float64]
Begin = Callable[[BodyModel, Array, FilterSettings], Belief]
Propose = Callable[[BodyModel, Any, Observation, FilterSettings, np.random.Generator], Proposal[Any]]
Update = Callable[[BodyModel, Any, Refined, FilterSettings, np.random.Generator], Belief | Proposal[Any]]


@dataclass(frozen=True, slots=True)
class Method:
    """The steps of a filter, whose beliefs and proposals are of its own kind, and what makes the method.

    `begin` gives the belief at an initial pose (D,). Then, frame by frame: `propose` gives particles,
    `update` the belief after they were refined, or, where a method needs it, more particles to refine.
    """

    begin: Begin
    propose: Propose
    update: Update
    particles: int | None = None  # unless the user wants another number; None for the preset's
    lone: bool = False  # follows a single particle, always
    icp_iterations: int | None = None  # of every particle, always; None for what the settings say

    @property
    def recovers(self) -> bool:
        """Whether a body that is lost is looked for: the baselines are what their papers say."""
        return self.descends and not self.lone

    @property
    def descends(self) -> bool:
        """Whether particles are moved by their refinement; else only their likelihood is asked for."""
        return self.icp_iterations != 0


_GRADIENT = gradient_enhanced.begin, gradient_enhanced.propose, gradient_enhanced.update


def baseline(steps: Condensation | Annealed, particles: int) -> Method:
    """A method that never descends, with so many particles unless the user wants another number."""
    return Method(steps.begin, steps.propose, steps.update, particles, icp_iterations=0)


METHODS = {
    "gepf": Method(*_GRADIENT),
    "gradient": Method(*_GRADIENT, particles=1, lone=True, icp_iterations=6),  # nobody else may be nearer
    "condensation": baseline(Condensation(), particles=1_000),
    "annealed": baseline(Annealed(), particles=100),  # in each layer
}


def find_method(name: str) -> Method:
    """The method of a name; InputError names the valid ones."""
    check_choice("method", name, tuple(METHODS))
    return METHODS[name]


def settings_for(
    method: str,
    preset_name: str = "default",
    particles: int | None = None,
    points: int | None = None,
    seed: int = 0,
) -> Settings:
    """A preset's settings for a method, with as many particles and points as the method needs.

    Args:
        method: One of METHODS.
        preset_name: One of PRESETS.
        particles: How many, of `annealed` in each layer; None for the method's own number.
        points: How many observed points at the most; None for the method's own number.
        seed: Of all random numbers.

    Raises InputError for a name that is unknown or a number that the method cannot have.
    """
    settings, chosen = preset(preset_name), find_method(method)
    if chosen.lone and particles not in (None, 1):
        raise InputError(f"method {method} follows a single particle; leave --particles out")
    if points is None:
        points = Settings().points if chosen.lone else settings.points  # one particle has time for more
    if particles is None:
        particles = chosen.particles or settings.filter.particles
    of_filter = msgspec.structs.replace(settings.filter, particles=particles)
    asked = {"method": method, "points": points, "filter": of_filter, "seed": seed}
    return apply_method(msgspec.structs.replace(settings, **asked))


def check_choice(what: str, chosen: str, known: tuple[str, ...]) -> None:
    """InputError if nothing of that kind has this name."""
    if chosen not in known:
        raise InputError(f"unknown {what} '{chosen}'; choose from {', '.join(known)}")


def apply_method(settings: Settings) -> Settings:
    """Override the settings that the method fixes: the iterations of ICP and the number of particles.

    Raises InputError for a method, descent or sensor that is unknown, and for settings without a particle or
    a point.
    """
    method = find_method(settings.method)
    check_choice("descent", settings.refine.descent, get_args(Descent))
    check_choice("sensor", settings.refine.sensor, get_args(Sensor))
    for name, number in (("particles", settings.filter.particles), ("points", settings.points)):
        if number < 1:
            raise InputError(f"{name}={number} is too small; give 1 or more")
    refine, of_filter = settings.refine, settings.filter
    if method.icp_iterations is not None:
        refine = msgspec.structs.replace(refine, icp_iterations=method.icp_iterations)
    if method.lone:
        of_filter = msgspec.structs.replace(of_filter, particles=1)
    recover = settings.recover and method.recovers
    return msgspec.structs.replace(settings, refine=refine, filter=of_filter, recover=recover)


MOST_PACE = 3.0  # the largest factor on the iterations is MOST_PACE ** pace


def pace_iterations(settings: RefineSettings, interval: float, pace: float, most: int) -> RefineSettings:
    """Scale the iterations of ICP with the interval: as many a second at pace 1, nearly twice as many at 2.

    A frame of 0.1 s gets three and five times those of a usual one, and one of 0.17 s three and nine times,
    but `most` at the most, unless the settings ask for more.
    """
    factor = 1.0 + pace * max(interval / USUAL_INTERVAL - 1.0, 0.0)
    usual = settings.icp_iterations
    paced = min(round(usual * min(factor, MOST_PACE**pace)), most)
    return msgspec.structs.replace(settings, icp_iterations=max(usual, paced))


def keep_up(settings: Settings) -> Settings:
    """Settings for live input, where a frame that takes long makes the next one come later."""
    return msgspec.structs.replace(settings, pace_iterations=min(settings.pace_iterations, 1.0))
