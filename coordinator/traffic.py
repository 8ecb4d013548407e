"""What went over the bus in one run."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(slots=True)
class Traffic:
    """Who refined, how often batches were sent, and how long the coordinator spent on it."""

    workers_seen: tuple[str, ...] = ()
    local_workers_restarted: int = 0
    batches_sent: int = 0
    batches_sent_again: int = 0
    batches_refused: int = 0
    replies_malformed: int = 0
    stage_seconds: dict[str, float] = field(default_factory=lambda: {"publish": 0.0, "refine": 0.0})
