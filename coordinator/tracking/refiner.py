"""The interface for the refinement of particles, by a pool of workers or in this process."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial
from typing import Protocol

import msgspec

from gepf.common.body import BodyModel
from gepf.common.frame import SubjectFrame
from gepf.common.refinement import Particles, Refined
from gepf.common.settings import SOFT_NOISE_RATIO, RefineSettings


class Request(Protocol):
    """Particles that are being refined."""

    def poll(self) -> bool:
        """Whether `result` would return at once. Without workers, each call processes one request."""
        ...

    def result(self) -> Refined:
        """Wait for the refined particles, with likelihood and residual, in the order of submission."""
        ...

    def cancel(self) -> None:
        """Give up the result; after `result`, this changes nothing."""
        ...


class LocalRequest:
    """Particles that are refined at the first use of `result` or `poll`."""

    def __init__(self, refine: Callable[[], Refined]) -> None:
        self._refine = refine
        self._refined: Refined | None = None

    def poll(self) -> bool:
        """Whether they have been refined already; refines them now if not, one request at a time."""
        was_ready = self._refined is not None
        self.result()
        return was_ready

    def result(self) -> Refined:
        """Refine the particles, unless they have been refined already."""
        self._refined = self._refined or self._refine()
        return self._refined

    def cancel(self) -> None:
        """Do nothing: no work is under way."""


class Refiner(ABC):
    """Refines particles; several requests may be under way."""

    @abstractmethod
    def publish(self, subject: SubjectFrame) -> None:
        """Send a frame to the workers, so that they have it when its particles are submitted."""

    @abstractmethod
    def submit(self, subject: SubjectFrame, model: BodyModel, particles: Particles) -> Request:
        """Start to refine particles on a frame."""


class LocalRefiner(Refiner):
    """Refines particles in this process, one request at a time."""

    @abstractmethod
    def refine(self, subject: SubjectFrame, model: BodyModel, particles: Particles) -> Refined:
        """Refine particles on a frame."""

    def publish(self, subject: SubjectFrame) -> None:
        """Do nothing: there are no workers."""

    def submit(self, subject: SubjectFrame, model: BodyModel, particles: Particles) -> Request:
        """Keep the particles until their result is needed."""
        return LocalRequest(partial(self.refine, subject, model, particles))


Requests = tuple[Request, ...]
"""The requests of one stage of a search that were sent to the workers."""


def with_iterations(settings: RefineSettings, count: int) -> RefineSettings:
    """Settings with this number of ICP iterations."""
    return msgspec.structs.replace(settings, icp_iterations=count)


def with_closest_points(settings: RefineSettings) -> RefineSettings:
    """Settings with enough lateral noise for closest-point correspondences; soft correspondences are slow."""
    min_lateral = settings.noise_depth / SOFT_NOISE_RATIO
    return msgspec.structs.replace(settings, noise_lateral=max(settings.noise_lateral, min_lateral))
