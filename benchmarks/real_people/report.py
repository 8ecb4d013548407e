"""All that was measured, for programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec

from benchmarks.costs.timing import machine
from benchmarks.forks import Crash
from benchmarks.scores import Marks, RecordingScore, Score, score, score_joints, score_recording
from benchmarks.sequences import Recording
from benchmarks.tracking import Tracked
from common.settings import Settings
from coordinator.results.configuration import versions

Results = Mapping[str, Tracked | Crash]


class People(msgspec.Struct, frozen=True):
    """UTD-MHAD; the worst are found after offset removal."""

    overall: Score
    by_action: dict[int, Score]
    by_joint: dict[str, Marks]
    sequences: list[RecordingScore]


class Skinned(msgspec.Struct, frozen=True):
    """The synthetic people; the worst is found by what is raw."""

    overall: Score
    by_joint: dict[str, Marks]
    by_joint_of_sequence: dict[str, dict[str, Marks]]
    sequences: list[RecordingScore]


class Report(msgspec.Struct, frozen=True):
    """One run of the benchmark."""

    settings: Settings
    seed: int
    versions: dict[str, str]
    machine: dict[str, str]
    processes: int
    people: People | None
    skinned: Skinned | None
    crashes: dict[str, str]


def report(recordings: Sequence[Recording], results: Results, settings: Settings, processes: int) -> Report:
    """Scores of all recordings."""
    people = [r for r in recordings if r.action is not None]
    skinned = [r for r in recordings if r.action is None]
    return Report(
        settings=settings,
        seed=settings.seed,
        versions=versions(),
        machine=machine(),
        processes=processes,
        people=report_people(people, results) if people else None,
        skinned=report_skinned(skinned, results) if skinned else None,
        crashes={name: result.error for name, result in results.items() if isinstance(result, Crash)},
    )


def report_people(recordings: Sequence[Recording], results: Results) -> People:
    """Scores of UTD-MHAD."""
    actions = sorted({r.action for r in recordings if r.action is not None})
    tracked, crashed = divide(recordings, results)
    return People(
        overall=score(tracked, crashed, raw=False),
        by_action={
            action: score(*divide([r for r in recordings if r.action == action], results), raw=False)
            for action in actions
        },
        by_joint=score_joints([one.comparison for one in tracked.values()]),
        sequences=[score_recording(name, one) for name, one in tracked.items()],
    )


def report_skinned(recordings: Sequence[Recording], results: Results) -> Skinned:
    """Scores of the synthetic people."""
    tracked, crashed = divide(recordings, results)
    return Skinned(
        overall=score(tracked, crashed, raw=True),
        by_joint=score_joints([one.comparison for one in tracked.values()]),
        by_joint_of_sequence={name: score_joints([one.comparison]) for name, one in tracked.items()},
        sequences=[score_recording(name, one) for name, one in tracked.items()],
    )


def divide(recordings: Sequence[Recording], results: Results) -> tuple[dict[str, Tracked], list[str]]:
    """Those that were tracked, and the names of those that crashed."""
    of = {r.name: results[r.name] for r in recordings}
    tracked = {name: result for name, result in of.items() if isinstance(result, Tracked)}
    return tracked, [name for name in of if name not in tracked]
