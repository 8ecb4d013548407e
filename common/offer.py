"""What a worker offers to coordinators: its kind of kernel, its processor, and particles at once."""

from __future__ import annotations

from dataclasses import dataclass

CPU = "cpu"  # kind of the kernel of this package


@dataclass(frozen=True, slots=True)
class Offer:
    """What a worker offers. Workers of the same kind and processor give byte-identical results.

    lanes: number of spare requests, or of particles of any other request, that are refined in parallel.
    batch: number of particles that one lane refines in the time of one.
    """

    kind: str = CPU
    processor: str = "any"
    lanes: int = 1
    batch: int = 1

    @property
    def slots(self) -> int:
        """Number of particles that are refined in parallel."""
        return self.lanes * self.batch
