"""What a worker gives back for a batch of particles."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """Particles after their descent; every array has the particles on its first axis."""

    poses: NDArray[np.float64]  # (N, D) metres and radians
    log_likelihood: NDArray[np.float64]  # (N,)
    residual: NDArray[np.float64]  # (N,) metres, mean distance of observed points from the model


def concatenate(parts: list[Refined]) -> Refined:
    """Join batches in the order given."""
    return Refined(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Refined)))
