"""Turns at a worker are fair: whatever comes, a run that waits is served as long as any other."""

from __future__ import annotations

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from gepf.worker.turns import Turns

LONGEST = 1.0  # seconds of a turn
SECONDS = st.floats(0.001, LONGEST)
RUNS = st.sampled_from("abcd")


@given(st.dictionaries(RUNS, SECONDS, min_size=2), st.integers(10, 200))
def test_runs_that_always_wait_are_served_equally_long(turns_of: dict[str, float], count: int) -> None:
    """However long their requests take: after any number of turns, no two differ by more than one each."""
    turns, served = Turns[str](), dict.fromkeys(turns_of, 0.0)
    for run in turns_of:
        turns.put(run, run)
    for _ in range(count):
        taken = turns.take()
        assert taken is not None
        run, _ = taken
        turns.put(run, run)
        served[run] += turns_of[run]
        turns.charge(run, turns_of[run])
    assert max(served.values()) - min(served.values()) <= 2 * LONGEST


@given(st.lists(st.tuples(RUNS, SECONDS, st.booleans()), min_size=1, max_size=80))
def test_a_run_that_waits_is_never_behind_another_by_more_than_a_turn(
    history: list[tuple[str, float, bool]],
) -> None:
    """While it waits, whatever others do, even if it has only spare work and they have none, or were away."""
    turns, waiting = Turns[float](), Counter[str]()
    meanwhile = dict[str, dict[str, float]]()  # of each that waits: seconds that others got
    turns.put("always", 0.01)
    for run, seconds, spare in history:
        turns.put(run, seconds, spare=spare)
        waiting[run] += 1
        meanwhile.setdefault(run, dict.fromkeys("abcd", 0.0) | {"always": 0.0})
        taken = turns.take()
        assert taken is not None
        turn, cost = taken
        turns.charge(turn, cost)
        for got in meanwhile.values():
            got[turn] += cost
        waiting[turn] -= 1
        meanwhile.pop(turn, None)
        if waiting[turn] > 0:
            meanwhile[turn] = dict.fromkeys("abcd", 0.0) | {"always": 0.0}
        if turn == "always":
            turns.put("always", 0.01)
        assert all(max(got.values()) <= 2 * LONGEST for got in meanwhile.values())


@given(st.lists(st.tuples(RUNS, st.booleans()), max_size=60), st.data())
def test_nothing_is_lost_or_done_twice(puts: list[tuple[str, bool]], data: st.DataObject) -> None:
    """All that is put comes out once, of each run in its order, on either way out, unless it was dropped."""
    turns, came = Turns[int](), list[tuple[str, int]]()
    for number, (run, spare) in enumerate(puts):
        turns.put(run, number, spare=spare)
        if data.draw(st.booleans()):
            taken = data.draw(st.sampled_from([turns.take, turns.take_spare]))()
            came += [] if taken is None else [taken]
    dropped = turns.drop("a")
    assert all(puts[number][0] == "a" for number in dropped)
    for take in (turns.take, turns.take_spare):
        while (taken := take()) is not None:
            came.append(taken)
    assert turns.take() is None
    assert all(puts[number][0] == run for run, number in came)
    assert sorted([*(number for _, number in came), *dropped]) == list(range(len(puts)))
    for run in "abcd":
        for spare in (True, False):
            mine = [number for name, number in came if name == run and puts[number][1] == spare]
            assert mine == sorted(mine)


def test_a_search_has_turns_only_against_other_runs() -> None:
    """Alone, spare work is left to the threads beside; against another run it has half of the turns."""
    turns = Turns[str]()
    for _ in range(10):
        turns.put("searching", "search", spare=True)
    assert turns.take() is None
    turns.put("searching", "track")
    assert turns.take() == ("searching", "track")
    assert turns.take() is None
    got = Counter[str]()
    for _ in range(10):
        turns.put("tracking", "track")
        taken = turns.take()
        assert taken is not None
        turns.charge(taken[0], 0.1)
        got[taken[0]] += 1
    assert got["searching"] in {4, 5, 6}


def test_time_beside_the_turns_counts() -> None:
    """A search that gets what it needs of idle lanes does not delay the tracking of others."""
    turns = Turns[str]()
    turns.put("searching", "search", spare=True)
    turns.put("searching", "search", spare=True)
    assert turns.take_spare() == ("searching", "search")
    turns.charge("searching", 0.2, beside=0.4)
    turns.put("tracking", "track")
    assert turns.take() == ("tracking", "track")


def test_a_run_cannot_save_up_turns() -> None:
    """One that was away for long does not hold up those that worked; it is forgotten until it comes."""
    turns = Turns[str]()
    turns.put("b", "late")
    assert turns.take() == ("b", "late")
    turns.charge("b", 0.1)
    for _ in range(100):
        turns.put("a", "work")
        assert turns.take() == ("a", "work")
        turns.charge("a", 0.1)
    assert turns.is_alone("a")
    for run in "bbbaa":
        turns.put(run, run)
    order = ""
    while (taken := turns.take()) is not None:
        order += taken[0]
        turns.charge(taken[0], 0.1)
    assert order == "babab"
    assert not turns.is_alone("a")
