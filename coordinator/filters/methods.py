"""The methods of tracking, by the name that the command line gives them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.refinement import Refined
from common.settings import FilterSettings
from coordinator.filters import annealed, condensation, gradient_enhanced
from coordinator.filters.belief import Belief
from coordinator.filters.proposal import Proposal

Array = NDArray[np.float64]
Begin = Callable[[BodyModel, Array, FilterSettings], Belief]
Propose = Callable[[BodyModel, Any, FilterSettings, np.random.Generator], Proposal[Any]]
Update = Callable[[BodyModel, Any, Refined, FilterSettings, np.random.Generator], Belief | Proposal[Any]]


@dataclass(frozen=True, slots=True)
class Method:
    """The steps of a filter, whose beliefs and proposals are of its own kind.

    `begin` gives the belief at an initial pose (D,). Then, frame by frame: `propose` gives particles,
    `update` the belief after they were refined, or, where a method needs it, more particles to refine.
    """

    begin: Begin
    propose: Propose
    update: Update


_GRADIENT = gradient_enhanced.begin, gradient_enhanced.propose, gradient_enhanced.update

METHODS = {
    "gepf": Method(*_GRADIENT),
    "gradient": Method(*_GRADIENT),  # one particle, without noise
    "condensation": Method(condensation.begin, condensation.propose, condensation.update),
    "annealed": Method(condensation.begin, annealed.propose, annealed.update),
}
