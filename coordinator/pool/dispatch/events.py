"""What happens to a refinement, and what is to be done about it: the language of dispatch."""

from __future__ import annotations

from dataclasses import dataclass

LARGEST_BATCH = 1024  # particles: what one lane may do within the timeout of a request, twice over


@dataclass(frozen=True, slots=True)
class Started:
    """Refine `particles` particles; whatever is left of the refinement before is given up."""

    particles: int
    by_deadline: bool = False  # what is refined in time counts, so that each share comes in several batches
    largest_batch: int = LARGEST_BATCH  # particles


@dataclass(frozen=True, slots=True)
class WorkerJoined:
    """A worker is there."""

    worker: str


@dataclass(frozen=True, slots=True)
class LanesCounted:
    """A worker, that is there or will be, refines `lanes` particles at once."""

    worker: str
    lanes: int


@dataclass(frozen=True, slots=True)
class WorkerLeft:
    """A worker is gone, and what it was working on with it."""

    worker: str


@dataclass(frozen=True, slots=True)
class Replied:
    """A request has brought a result that makes sense."""

    ticket: int


@dataclass(frozen=True, slots=True)
class Refused:
    """A request has brought an error, or a result that makes no sense."""

    ticket: int
    reason: str


@dataclass(frozen=True, slots=True)
class Unavailable:
    """A worker lacked the frame or the model that a request is about; it may have it the next time."""

    ticket: int
    reason: str


@dataclass(frozen=True, slots=True)
class Ended:
    """A request is over; nothing more will come of it."""

    ticket: int


@dataclass(frozen=True, slots=True)
class Ticked:
    """Time has passed."""


Event = Started | WorkerJoined | LanesCounted | WorkerLeft | Replied | Refused | Unavailable | Ended | Ticked


@dataclass(frozen=True, slots=True)
class Send:
    """Request particles start..stop-1 from a worker."""

    ticket: int
    worker: str
    start: int
    stop: int


@dataclass(frozen=True, slots=True)
class Accept:
    """The result of a ticket is the first for the particles from `start` on."""

    ticket: int
    start: int


@dataclass(frozen=True, slots=True)
class Done:
    """Every particle has a result."""


@dataclass(frozen=True, slots=True)
class Fail:
    """The refinement cannot be done; all workers say why."""

    reason: str


@dataclass(frozen=True, slots=True)
class NoAnswer:
    """`worker` is there, and no worker has answered for as long as a request may take; `again`: once more."""

    worker: str
    again: bool


Instruction = Send | Accept | Done | Fail | NoAnswer
