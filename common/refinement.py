"""What a worker gives back for a batch of particles."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """Particles after their descent; every array has the particles on its first axis.

    Where a deadline leaves a particle without an answer, all that is said about it is NaN.
    """

    poses: NDArray[np.float64]  # (N, D) metres and radians
    log_likelihood: NDArray[np.float64]  # (N,)
    residual: NDArray[np.float64]  # (N,) metres, mean distance of observed points from the model

    @property
    def answered(self) -> NDArray[np.int64]:
        """The particles (K,) that were answered, ascending."""
        return np.flatnonzero(~np.isnan(self.log_likelihood))

    def take(self, particles: NDArray[np.int64]) -> Refined:
        """Only these particles, in this order."""
        return Refined(*(getattr(self, f.name)[particles] for f in fields(Refined)))

    def divide(self, particles: int) -> tuple[Refined, Refined]:
        """So many particles, and those after them."""
        arrays = [getattr(self, f.name) for f in fields(Refined)]
        return Refined(*(a[:particles] for a in arrays)), Refined(*(a[particles:] for a in arrays))


def unanswered(particles: int, like: Refined) -> Refined:
    """So many particles about which nothing is known, of the same shapes otherwise."""
    arrays = [getattr(like, f.name) for f in fields(Refined)]
    return Refined(*(np.full((particles, *array.shape[1:]), np.nan) for array in arrays))


def concatenate(parts: list[Refined]) -> Refined:
    """Join batches in the order given."""
    return Refined(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Refined)))
