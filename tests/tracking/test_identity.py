"""Who returns: people keep their numbers when they leave the image, if colour shows their clothes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import pytest

from gepf.common.frame import Frame
from gepf.coordinator.colour.finder import KeypointFinder
from gepf.coordinator.pool.options import PoolStatistics
from gepf.coordinator.results.log import Entry, Opening, append_records, read_log
from gepf.coordinator.tracking.state import Start, TrackerState
from gepf.coordinator.tracking.tracker import Tracker
from gepf.refiners import DirectRefiner
from tests.support.coloured import Dressed, Place, dressed, pictures
from tests.support.people import SETTINGS, as_bytes, people_of

pytest.importorskip("ai_edge_litert", reason="the extra color is not installed")

FPS, SEEN, AWAY = 10.0, 12, 100  # frames
LEFT_M, RIGHT_M = -0.55, 0.55
FIRST, SECOND, STRANGER = dressed(1), dressed(51), dressed(151)


def scene(*people: tuple[Dressed, float]) -> list[list[Place]]:
    """People who stand at these places for a while."""
    return [[Place(person, x_m, n % 5) for person, x_m in people] for n in range(SEEN)]


@cache
def away_then(*people: tuple[str, float]) -> list[Frame]:
    """Two people leave the image for ten seconds. Then these are seen."""
    who = {"first": FIRST, "second": SECOND, "stranger": STRANGER}
    before = scene((FIRST, LEFT_M), (SECOND, RIGHT_M))
    return pictures([*before, *([[]] * AWAY), *scene(*((who[name], x_m) for name, x_m in people))], FPS)


def follow(frames: Sequence[Frame], people: int) -> list[list[tuple[str, float, str]]]:
    """Of each frame and person: the status, where the body is, and why it is doubted."""
    tracker = Tracker(DirectRefiner(), SETTINGS, people_of(None), people=people, colour=KeypointFinder())
    return [
        [
            (own.estimate.status, float(own.estimate.joint_positions[:, 0].mean()), own.estimate.why)
            for own in tracked.people
        ]
        for tracked in tracker.follow(frames)
    ]


def numbers(seen: Sequence[tuple[str, float, str]]) -> dict[int, float]:
    """The places of the people who are known, by their numbers."""
    return {n: x_m for n, (status, x_m, _) in enumerate(seen) if status in {"tracked", "ambiguous"}}


def test_people_who_return_in_exchanged_places_keep_their_numbers() -> None:
    """Both have the same size, so only the clothes tell."""
    seen = follow(away_then(("first", RIGHT_M), ("second", LEFT_M)), 2)
    before, after = numbers(seen[SEEN - 1]), numbers(seen[-1])
    assert len(before) == len(after) == 2
    assert all(before[n] * after[n] < 0.0 for n in before)
    assert [status for status, _, _ in seen[-1]] == ["tracked", "tracked"]


def test_one_who_returns_is_not_taken_for_the_other() -> None:
    """Even where the other one was seen last."""
    seen = follow(away_then(("second", LEFT_M)), 2)
    (second,) = (n for n, x_m in numbers(seen[SEEN - 1]).items() if x_m > 0.0)
    assert list(numbers(seen[-1])) == [second]


def test_somebody_else_gets_another_number_if_there_is_one() -> None:
    """If not, the status says that this may be somebody else."""
    frames = away_then(("stranger", LEFT_M))
    assert list(numbers(follow(frames, 3)[-1])) == [2]
    (known,) = (person for person in follow(frames, 2)[-1] if person[0] != "absent")
    assert known[0] == "ambiguous"
    assert "clothes" in known[2]


def test_what_is_remembered_of_clothes_is_recorded(tmp_path: Path) -> None:
    """Looking ahead, frame by frame, and from the state recorded while both are away: the same bytes."""
    frames = away_then(("first", RIGHT_M), ("second", LEFT_M))
    expected = [[as_bytes(own.estimate) for own in seen.people] for seen in two_people().follow(frames)]
    tracker = two_people()
    with (tmp_path / "log").open("ab") as file:
        append_records(file.fileno(), [Opening({})])
        for number, frame in enumerate(frames):
            estimates = [person.estimate for person in tracker.track(frame).people]
            assert [as_bytes(estimate) for estimate in estimates] == expected[number]
            people = tracker.state.people
            starts: list[Start | None] = [own.start for own in people]
            checkpoints = [own.checkpoint for own in people]
            entry = Entry(tracker.state.frame, starts, checkpoints, estimates, PoolStatistics(), 0.0)
            append_records(file.fileno(), [entry])
            if number == SEEN + AWAY - 1:
                recorded = read_log(tmp_path / "log")
                assert recorded is not None
                tracker = two_people(recorded.state)


def two_people(state: TrackerState | None = None) -> Tracker:
    """A tracker of two people that looks at colour."""
    return Tracker(DirectRefiner(), SETTINGS, people_of(None), people=2, colour=KeypointFinder(), state=state)
