"""What happens to a job, and what is to be done about it: the language of dispatch."""

from __future__ import annotations

from dataclasses import dataclass

MOST_TOGETHER = 1024  # particles: what one lane may do within the time of a request, twice over


@dataclass(frozen=True, slots=True)
class JobStarted:
    """Refine `particles` particles; whatever is left of the job before is given up."""

    particles: int
    in_parts: bool = False  # what is refined by a deadline counts, so a worker's share comes in parts
    spare: int = 0  # of them, the last: in a batch of their own
    most: int = MOST_TOGETHER  # particles of a batch


@dataclass(frozen=True, slots=True)
class WorkerJoined:
    """A worker is there."""

    worker: str


@dataclass(frozen=True, slots=True)
class LanesCounted:
    """A worker, that is there or will be, refines so many particles at once."""

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
    at: float | None = None  # when it came, which may be before it is handled


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


Event = (
    JobStarted | WorkerJoined | LanesCounted | WorkerLeft | Replied | Refused | Unavailable | Ended | Ticked
)


@dataclass(frozen=True, slots=True)
class Send:
    """Ask a worker to refine particles start..stop-1."""

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
    """Every particle of the job has a result."""


@dataclass(frozen=True, slots=True)
class Fail:
    """The job cannot be done; all workers say why."""

    reason: str


@dataclass(frozen=True, slots=True)
class Silence:
    """Nobody has answered for as long as a request may take, though `worker` is there; `again`, once more."""

    worker: str
    again: bool


Instruction = Send | Accept | Done | Fail | Silence
