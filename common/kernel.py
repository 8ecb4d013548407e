"""The port between a worker and the hardware that it computes on.

A package for other hardware implements `Kernel` and names a function that makes one as an entry point:

    [project.entry-points."gepf.kernels"]
    cuda = "gepf_cuda:load"     # load(lanes: int | None) -> Kernel

Then `gepf-worker --kind cuda` serves with it, and `gepf track --kind cuda` uses such workers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from gepf.common.body import BodyModel
from gepf.common.frame import SubjectFrame
from gepf.common.offer import Offer
from gepf.common.refinement import Particles, Refined
from gepf.common.settings import RefineSettings

ENTRY_POINTS = "gepf.kernels"  # entry points, named by kind, of the functions that load other kernels


@dataclass(frozen=True, slots=True)
class Kernel:
    """The compute functions of a worker.

    observe: converts a frame to an observation, prepared for requests with the settings.
    refine: refines particles of a body on an observation, and returns them in the same order. The result of a
    particle depends on nothing but the arguments and this particle. One thread calls it for urgent requests,
    and one thread per lane for spare ones.
    """

    observe: Callable[[SubjectFrame, RefineSettings], Any]
    refine: Callable[[BodyModel, Any, Particles], Refined]
    offer: Offer = field(default_factory=Offer)
