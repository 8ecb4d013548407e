"""The methods of tracking, by the name that the command line gives them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.refinement import Refined
from common.settings import FilterSettings
from coordinator.filters import annealed, condensation, gradient_enhanced
from coordinator.filters.belief import Belief

Array = NDArray[np.float64]
Refine = Callable[[Array], Refined]


class Method(NamedTuple):
    """How a belief begins at a pose, and how it goes on from one of its own kind, frame by frame."""

    begin: Callable[[BodyModel, Array, FilterSettings], Belief]
    advance: Callable[[BodyModel, Any, Refine, FilterSettings, np.random.Generator], Belief]


METHODS = {
    "gepf": Method(gradient_enhanced.begin, gradient_enhanced.advance),
    "gradient": Method(gradient_enhanced.begin, gradient_enhanced.advance),  # one particle, without noise
    "condensation": Method(condensation.begin, condensation.advance),
    "annealed": Method(condensation.begin, annealed.advance),
}
