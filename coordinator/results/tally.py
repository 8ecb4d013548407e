"""What is counted over the frames of one person, for the summary, in constant memory."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Self, get_args

from gepf.coordinator.tracking.estimate import POSE_UNKNOWN, Estimate, Status, single_reasons

if TYPE_CHECKING:  # it loads the compiler, which is slow
    from gepf.common.arrays import Array
    from gepf.coordinator.tracking.state import Start

STATUSES = get_args(Status)


def count_status(statuses: Iterable[str]) -> dict[str, int]:
    """Frames by status."""
    counts = Counter(statuses)
    return {status: counts[status] for status in STATUSES}


def describe_counts(counts: dict[str, int]) -> str:
    """Number of frames of each status that occurs, as text."""
    return ", ".join(f"{n} {status}" for status, n in counts.items() if n)


def describe_status(statuses: Iterable[str]) -> str:
    """Number of frames of each status that occurs, as text."""
    return describe_counts(count_status(statuses))


@dataclass(slots=True)
class Tally:
    """Counts of the estimates that were added.

    `hypotheses` is the largest number in a frame, `stage_seconds` the total by stage, `doubts` the reasons to
    doubt frames that are not tracked, one for each joint, `shown` the frames in which each camera of a rig
    showed the body, `faults` the end of each fault in seconds, by camera, kind and start.
    """

    frames: int = 0
    statuses: Counter[str] = field(default_factory=Counter)
    doubts: Counter[str] = field(default_factory=Counter)
    stage_seconds: dict[str, float] = field(default_factory=dict)
    shown: Counter[str] = field(default_factory=Counter)
    faults: dict[str, dict[tuple[str, float], float]] = field(default_factory=dict)
    first_tracked: int | None = None  # number of the first frame that is neither absent nor searching
    hypotheses: int = 0
    keypoints: bool = False  # whether any frame has keypoints

    @classmethod
    def of(cls, estimates: Iterable[Estimate]) -> Self:
        """The counts of estimates."""
        tally = cls()
        for estimate in estimates:
            tally.add(estimate)
        return tally

    def add(self, estimate: Estimate) -> None:
        """Count one frame."""
        self.frames += 1
        self.statuses[estimate.status] += 1
        if estimate.why and estimate.status != "tracked":
            self.doubts.update(single_reasons(estimate.why))
        for stage, seconds in estimate.stage_seconds.items():
            self.stage_seconds[stage] = self.stage_seconds.get(stage, 0.0) + seconds
        self.shown.update(name for name in estimate.seen_by if name)
        for name, (kind, since_s) in estimate.faults.items():
            self.faults.setdefault(name, {})[kind, since_s] = estimate.time_s
        if self.first_tracked is None and estimate.status not in ("absent", "searching"):
            self.first_tracked = estimate.frame
        self.keypoints |= bool(estimate.keypoints)
        self.hypotheses = max(self.hypotheses, len(estimate.hypothesis_weight))

    @property
    def status(self) -> dict[str, int]:
        """Frames by status."""
        return {status: self.statuses[status] for status in STATUSES}

    @property
    def known(self) -> int:
        """Frames with a valid pose."""
        return self.frames - sum(self.statuses[status] for status in POSE_UNKNOWN)

    @property
    def cameras(self) -> tuple[str, ...]:
        """The cameras of a rig, sorted; none for a single camera, which has no name."""
        return tuple(sorted({*self.shown, *(name for name in self.faults if name)}))

    def describe_cameras(self) -> dict[str, object]:
        """For each camera of a rig the frames in which it showed the body, and its faults."""
        cameras = {
            name: {
                "frames_shown": self.shown[name],
                "faults": [
                    {"fault": kind, "from_s": round(since_s, 3), "to_s": round(until_s, 3)}
                    for (kind, since_s), until_s in self.faults.get(name, {}).items()
                ],
            }
            for name in sorted({*self.shown, *self.faults})
        }
        return {"cameras": cameras} if cameras else {}

    def describe_failure(self) -> str:
        """Message about a run in which most frames are not tracked, with the reason if it is known."""
        why = f": {self.doubts.most_common(1)[0][0]}" if self.doubts else ""
        return f"most frames are not tracked ({describe_counts(self.status)}){why}"


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """One person at the end of a run: body, shape (S,), deviation of the stature, and what was counted.

    `up` (3,) is the direction away from the floor, frame of the camera or rig; None if no floor was seen.
    """

    start: Start
    shape: Array
    stature_deviation: float  # metres
    up: Array | None
    tally: Tally

    @property
    def found(self) -> bool:
        """Whether the person was found in any frame."""
        return self.start.found
