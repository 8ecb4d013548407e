"""One recording, tracked once for each row from the same first frame on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from benchmarks.frame_rates.reference import Reference, read_reference
from benchmarks.frame_rates.rows import Row
from benchmarks.frame_rates.scores import near_percent
from benchmarks.frame_rates.trials import Compared, hold_against, joints_of, read_frames
from benchmarks.sequences import Recording
from benchmarks.tracking import follow
from common.frame import DepthFrame
from coordinator.bodies.tracked import Bodies
from coordinator.tracking.estimate import Estimate
from coordinator.tracking.known import Known
from coordinator.tracking.single import SingleTracker as Tracker
from coordinator.tracking.state import TrackerState
from gepf.direct import DirectRefiner


class Trial(msgspec.Struct, frozen=True):
    """What one row made of one recording: shares of all joints within 10 cm, per cent."""

    recording: str
    seed: int
    row: str
    percent: float  # constant offsets removed
    raw_percent: float
    ms_per_frame: float


def try_all(
    recording: Recording, seed: int, rows: Sequence[Row], every: int, most: int, bodies: Bodies
) -> list[Trial]:
    """All rows on every n-th frame of a recording, `most` of them; the body is found once for all."""
    frames = read_frames(recording)
    reference, thinned = read_reference(Path(recording.joints), frames), frames[::every][:most]
    began = Tracker(DirectRefiner(), rows[0].settings(seed), bodies)
    first = began.track(thinned[0])
    return [
        score(recording.name, seed, row, compare(row, seed, thinned, (first, began.state), reference, bodies))
        for row in rows
    ]


def compare(
    row: Row,
    seed: int,
    frames: Sequence[DepthFrame],
    begun: tuple[Estimate, TrackerState],
    reference: Reference,
    bodies: Bodies,
) -> Compared:
    """One row. A lone particle, whose start has no other hypotheses, begins by itself."""
    numbers = np.array([frame.number for frame in frames])
    if row.changes is None:
        still = np.broadcast_to(reference.joints[0], (len(numbers), *reference.joints.shape[1:]))
        return hold_against(reference, numbers, still, 0.0)
    first, state = begun
    settings = row.settings(seed)
    lone = settings.filter.particles == 1
    tracker = Tracker(DirectRefiner(), settings, bodies, Known(state=None if lone else state))
    estimates, seconds = follow(tracker, frames if lone else frames[1:])
    estimates = estimates if lone else [first, *estimates]
    return hold_against(
        reference, numbers, joints_of(estimates, tracker.model.joint_names), float(seconds.mean())
    )


def score(recording: str, seed: int, row: Row, compared: Compared) -> Trial:
    """The shares."""
    return Trial(
        recording=recording,
        seed=seed,
        row=row.name,
        percent=near_percent(compared.offset_removed),
        raw_percent=near_percent(compared.raw),
        ms_per_frame=round(1e3 * compared.seconds, 1),
    )
