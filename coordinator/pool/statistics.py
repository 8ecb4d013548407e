"""What went over the bus in one run."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(slots=True)
class PoolStatistics:
    """Who refined, how often batches were sent, and how long the coordinator spent on it."""

    workers_seen: tuple[str, ...] = ()
    local_workers_restarted: int = 0
    batches_sent: int = 0
    batches_sent_again: int = 0
    batches_refused: int = 0
    replies_malformed: int = 0
    stage_seconds: dict[str, float] = field(default_factory=lambda: {"publish": 0.0, "refine": 0.0})

    def after(self, earlier: PoolStatistics) -> PoolStatistics:
        """The sums of both, where this one came later in the same run."""
        stages = dict(earlier.stage_seconds)
        for stage, seconds in self.stage_seconds.items():
            stages[stage] = stages.get(stage, 0.0) + seconds
        return PoolStatistics(
            workers_seen=tuple(sorted({*earlier.workers_seen, *self.workers_seen})),
            local_workers_restarted=earlier.local_workers_restarted + self.local_workers_restarted,
            batches_sent=earlier.batches_sent + self.batches_sent,
            batches_sent_again=earlier.batches_sent_again + self.batches_sent_again,
            batches_refused=earlier.batches_refused + self.batches_refused,
            replies_malformed=earlier.replies_malformed + self.replies_malformed,
            stage_seconds=stages,
        )
