"""The scheduler as tables of events and the requests expected; nothing is ever lost or done twice."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import count, groupby, pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gepf.common.errors import ProtocolError, SilentWorkers
from gepf.common.offer import Offer
from gepf.coordinator.pool.scheduler import Outcome, Request, Scheduler, split

Event = Callable[[Scheduler, float], list[Request]]
Sent = tuple[int, str, int, int]  # ticket, worker, start and stop
Table = list[tuple[float, Event, list[Sent]]]


NUMBERS = count()  # of refinements


def started(particles: int, *, spare: bool = False) -> Event:
    """A refinement begins."""
    return lambda scheduler, now: scheduler.start(next(NUMBERS), particles, now, spare=spare)


@pytest.fixture
def small_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    """A request has at most 10 particles per lane."""
    monkeypatch.setattr("gepf.coordinator.pool.scheduler.MAX_PARTICLES", 10)


def joined(worker: str, lanes: int = 1) -> Event:
    """A worker joins."""
    return lambda scheduler, now: scheduler.join(worker, Offer(lanes=lanes), now)


def left(worker: str) -> Event:
    """A worker leaves."""
    return lambda scheduler, now: scheduler.leave(worker, now)


def ended(ticket: int, outcome: Outcome = "refined", reason: str = "no", waited: float = 0.0) -> Event:
    """A request is over; it has waited for others at its worker."""
    return lambda scheduler, now: scheduler.end(ticket, outcome, now, reason, waited)


def look(scheduler: Scheduler, now: float) -> list[Request]:
    """The clock ticks."""
    return scheduler.dispatch(now)


def play(table: Table) -> Scheduler:
    """Run a table of (time, event, requests expected), checking the invariants after every event."""
    scheduler = Scheduler()
    for row, (now, event, expected) in enumerate(table):
        assert sent(event(scheduler, now)) == expected, f"row {row}"
        check(scheduler)
    return scheduler


def sent(requests: list[Request]) -> list[Sent]:
    """The content of requests."""
    return [(each.ticket, each.worker.name, each.batch.start, each.batch.stop) for each in requests]


def check(scheduler: Scheduler) -> None:
    """What holds between any two events."""
    in_flight = list(scheduler.in_flight.values())
    for worker in scheduler.workers.values():
        assert worker.in_flight == {r.ticket for r in in_flight if r.worker is worker}
        kinds = [request.batch.spare for request in in_flight if request.worker is worker]
        assert kinds.count(False) <= 2
        assert kinds.count(True) <= 2 * (1 + worker.offer.lanes)
    for batch in scheduler.batches:
        assert batch.in_flight == {r.ticket for r in in_flight if r.batch is batch}
    assert all(request.worker.name in scheduler.workers for request in in_flight)
    for _, mine in groupby(scheduler.batches, lambda batch: batch.refinement):
        batches = list(mine)
        assert all(one.stop == other.start for one, other in pairwise(batches))
        assert not all(batch.done for batch in batches)


TWO_IDLE: Table = [(0.0, joined("a"), []), (0.0, joined("b"), [])]
TWO_AT_WORK: Table = [
    *TWO_IDLE,
    (0.0, started(40), [(0, "a", 0, 10), (1, "b", 10, 20), (2, "a", 20, 30), (3, "b", 30, 40)]),
]
ONE_AT_WORK: Table = [(0.0, joined("a"), []), (0.0, started(20), [(0, "a", 0, 10), (1, "a", 10, 20)])]


@pytest.mark.usefixtures("small_batches")
def test_late_joiner_takes_what_waits() -> None:
    """A job that begins without workers waits; the first to join starts, the second takes over the rest."""
    scheduler = play(
        [
            (0.0, started(30), []),
            (1.0, look, []),
            (2.0, joined("a"), [(0, "a", 0, 10), (1, "a", 10, 20)]),
            (2.1, joined("b"), [(2, "b", 20, 30)]),
            *((2.2, ended(ticket), []) for ticket in range(3)),
        ]
    )
    assert not scheduler.batches


@pytest.mark.usefixtures("small_batches")
def test_what_is_late_is_sent_again() -> None:
    """To an idle worker, once; the first result wins."""
    scheduler = play(
        [
            *TWO_AT_WORK,
            *((0.1, ended(ticket), []) for ticket in (0, 2, 1)),
            (0.29, look, []),
            (0.31, look, [(4, "a", 30, 40)]),
            (9.0, look, []),
            (9.1, ended(4), []),
            (9.2, ended(3), []),
        ]
    )
    assert not scheduler.batches
    assert scheduler.sent_again == 1


def test_a_large_share_is_not_late_by_its_size() -> None:
    """A share of ten times as many particles may take ten times as long before it is sent again."""
    play(
        [
            *TWO_IDLE,
            (0.0, started(20), [(0, "a", 0, 10), (1, "b", 10, 20)]),
            (0.1, ended(0), []),
            (0.1, ended(1), []),
            (1.0, started(200), [(2, "a", 0, 100), (3, "b", 100, 200)]),
            (2.0, ended(2), []),
            (3.9, look, []),
            (4.1, look, [(4, "a", 100, 200)]),
        ]
    )


@pytest.mark.usefixtures("small_batches")
def test_stale_and_unknown_answers_are_ignored() -> None:
    """Answers of a job that was cancelled, second answers and unknown tickets change nothing."""

    def cancel(scheduler: Scheduler, now: float) -> list[Request]:
        scheduler.cancel(scheduler.batches[0].refinement)
        return scheduler.dispatch(now)

    play(
        [
            *ONE_AT_WORK,
            (0.1, cancel, []),
            (0.1, started(4), []),
            (0.2, ended(0), [(2, "a", 0, 4)]),
            *((0.2, ended(ticket), []) for ticket in (0, 99)),
            (0.2, ended(99, "refused"), []),
            (0.2, left("nobody"), []),
            (0.3, ended(1, "refused"), []),
        ]
    )


def test_jobs_are_done_together_and_spare_ones_last() -> None:
    """A second job waits for capacity, not for the end of the first; a spare one does not take it away."""
    play(
        [
            (0.0, joined("a"), []),
            (0.0, started(3, spare=True), [(0, "a", 0, 3)]),
            (0.0, started(1), [(1, "a", 0, 1)]),
            (0.0, started(2), [(2, "a", 0, 2)]),
            (0.0, started(4), []),
            (0.1, ended(2), [(3, "a", 0, 4)]),
            (0.2, ended(0), []),
            (0.2, left("a"), []),
            (0.2, started(5, spare=True), []),
            (0.3, joined("b"), [(4, "b", 0, 1), (5, "b", 0, 4), (6, "b", 0, 5)]),
        ]
    )


@pytest.mark.usefixtures("small_batches")
def test_a_late_request_is_sent_again_in_spite_of_spare_ones() -> None:
    """Although there are spare ones at the other worker, and more of them wait."""
    spare = [(2 + n, "ab"[n % 2], 10 * n, 10 * n + 10) for n in range(8)]
    play(
        [
            *TWO_IDLE,
            (0.0, started(2), [(0, "a", 0, 1), (1, "b", 1, 2)]),
            *((0.1, ended(ticket), []) for ticket in (0, 1)),
            (0.2, started(200, spare=True), spare),
            (0.2, started(2), [(10, "a", 0, 1), (11, "b", 1, 2)]),
            (0.3, ended(11), []),
            (0.45, ended(3), [(12, "b", 80, 90)]),
            (0.49, look, []),
            (0.51, look, [(13, "b", 0, 1)]),
        ]
    )


@pytest.mark.parametrize("outcome", ["nothing", "unavailable"])
def test_a_worker_without_a_result_rests(outcome: Outcome) -> None:
    """Its batch goes to the other worker, or, if there is none, to itself after a pause."""
    play(
        [
            *TWO_IDLE,
            (0.0, started(2), [(0, "a", 0, 1), (1, "b", 1, 2)]),
            (0.1, ended(0, outcome), [(2, "b", 0, 1)]),
            (0.1, ended(1), []),
            (0.1, ended(2), []),
            (0.15, left("b"), []),
            (0.15, started(1), []),
            (0.4, look, []),
            (2.0, look, [(3, "a", 0, 1)]),
        ]
    )


@pytest.mark.usefixtures("small_batches")
def test_what_one_refuses_another_does() -> None:
    """Even if that one is busy; the first one still gets another batch."""
    play(
        [
            *TWO_IDLE,
            (0.0, started(60), [(k, "ab"[k % 2], 10 * k, 10 * k + 10) for k in range(4)]),
            (0.1, ended(0, "refused"), [(4, "a", 40, 50)]),
            (0.15, ended(1), [(5, "b", 0, 10)]),
        ]
    )


def test_what_all_refuse_fails() -> None:
    """With all reasons, once; the next refinement starts afresh."""
    scheduler = play(
        [
            *TWO_IDLE,
            (0.0, started(2), [(0, "a", 0, 1), (1, "b", 1, 2)]),
            (0.1, ended(0, "refused", "this"), [(2, "b", 0, 1)]),
        ]
    )
    with pytest.raises(ProtocolError, match="this; that"):
        scheduler.end(2, "refused", 0.2, "that")
    assert not scheduler.end(1, "refused", 0.3, "late")
    assert sent(scheduler.start(-1, 1, 0.3)) == [(3, "a", 0, 1)]
    assert scheduler.refused == 3


def test_what_was_refused_by_all_that_are_left_is_tried_again() -> None:
    """The worker that had accepted it has left; the other one decides."""
    scheduler = play(
        [
            *TWO_IDLE,
            (0.0, started(2), [(0, "a", 0, 1), (1, "b", 1, 2)]),
            (0.1, ended(0, "refused"), [(2, "b", 0, 1)]),
            (0.2, left("b"), [(3, "a", 0, 1), (4, "a", 1, 2)]),
        ]
    )
    with pytest.raises(ProtocolError, match="no"):
        scheduler.end(3, "refused", 0.3, "no")


@pytest.mark.parametrize("outcome", ["nothing", "unavailable", "refused", "refined"])
def test_silence_is_an_error(outcome: Outcome) -> None:
    """A request that meets its timeout, unless any worker has answered anything since it was sent."""
    scheduler = play([(0.0, joined("a"), []), (0.0, started(10), [(0, "a", 0, 10)])])
    scheduler.end(99, outcome, 20.0)
    if outcome == "nothing":
        with pytest.raises(SilentWorkers):
            scheduler.end(0, "nothing", 30.0)
        return
    assert not scheduler.end(0, "nothing", 30.0)
    assert sent(scheduler.dispatch(32.0)) == [(1, "a", 0, 10)]
    assert not scheduler.end(1, "nothing", 42.0)


def test_shares_go_with_lanes() -> None:
    """Each worker is asked once a job, whether its lanes are known before it or become known later."""
    play(
        [
            (0.0, joined("a", 3), []),
            (0.0, joined("b"), []),
            (0.0, started(40), [(0, "a", 0, 30), (1, "b", 30, 40)]),
            (0.1, ended(0), []),
            (0.1, ended(1), []),
            (0.2, joined("b", 7), []),
            (0.2, started(100), [(2, "a", 0, 30), (3, "b", 30, 100)]),
        ]
    )


def test_a_spare_request_is_on_one_lane() -> None:
    """So workers get equal shares, which are late after equal times, and as many as keep all lanes busy."""
    play(
        [
            (0.0, joined("a", 1), []),
            (0.0, joined("b", 10), []),
            (0.0, started(20, spare=True), [(0, "a", 0, 10), (1, "b", 10, 20)]),
            (1.0, ended(1), []),
            (2.9, look, []),
            (3.1, look, [(2, "b", 0, 10)]),
            *((4.0, ended(ticket), []) for ticket in (0, 2)),
        ]
    )
    scheduler = Scheduler()
    scheduler.join("a", Offer(lanes=16), 0.0)
    assert sum(len(scheduler.start(n, 1, 0.0, spare=True)) for n in range(40)) == 34


def test_a_request_is_not_late_by_the_queue_of_others() -> None:
    """The wait at a worker is expected again; the request's own time and a longer wait than ever are late."""
    waited: Table = [
        (0.0, joined("a"), []),
        (0.0, started(1), [(0, "a", 0, 1)]),
        (5.1, ended(0, waited=5.0), []),  # so it took 0.1 s
        (6.0, joined("b"), []),
        (6.0, started(2), [(1, "b", 0, 1), (2, "a", 1, 2)]),
    ]
    play([*waited, (6.1, ended(1), []), (21.2, look, []), (21.4, look, [(3, "b", 1, 2)])])
    play([*waited, (6.1, ended(2), []), (6.29, look, []), (6.31, look, [(3, "a", 0, 1)])])


def test_no_more_workers_than_needed_and_those_where_others_do_not_wait() -> None:
    """Four lanes do four particles at once; a coordinator with other ranks uses other workers."""
    scheduler = Scheduler(rank=lambda name: -ord(name))
    for name in "abcd":
        scheduler.join(name, Offer(lanes=2), 0.0)
    assert sent(scheduler.start(-1, 4, 0.0)) == [(0, "d", 0, 2), (1, "c", 2, 4)]
    scheduler.end(1, "refined", 0.1)
    scheduler.end(0, "refined", 1.0, waited=0.9)
    assert sent(scheduler.start(-2, 4, 1.0)) == [(2, "c", 0, 2), (3, "b", 2, 4)]
    assert len(scheduler.start(-3, 9, 1.0)) == 3  # two rounds in any case


def test_a_lane_that_does_many_at_once_gets_as_many() -> None:
    """Shares go with lanes times batch; a request of one batch takes the time of one particle."""
    scheduler = Scheduler()
    scheduler.join("gpu", Offer(lanes=1, batch=64), 0.0)
    scheduler.join("cpu", Offer(lanes=2), 0.0)
    assert [last - first for _, _, first, last in sent(scheduler.start(-1, 660, 0.0))] == [640, 20]
    assert [request.load for request in scheduler.in_flight.values()] == [10, 10]


def test_no_lane_idles_while_others_finish() -> None:
    """20 particles on workers of four lanes take two rounds, so the third gets what one round does.

    Equal shares of 7, 7 and 6 would take as long, and keep another coordinator from six rounds, not five.
    """
    scheduler = Scheduler()
    for name in "abcd":
        scheduler.join(name, Offer(lanes=4), 0.0)
    requests = scheduler.start(-1, 20, 0.0)
    assert sent(requests) == [(0, "a", 0, 8), (1, "b", 8, 16), (2, "c", 16, 20)]
    assert [request.load for request in requests] == [2, 2, 1]


@given(st.integers(0, 9000), st.lists(st.integers(1, 50), min_size=1, max_size=12))
def test_no_share_is_empty_or_too_large(particles: int, lanes: list[int]) -> None:
    """All particles in order; none takes longer than with equal work, or is larger than a request may be."""
    ranges = split(particles, lanes)
    assert [n for start, stop in ranges for n in range(start, stop)] == list(range(particles))
    assert all(start < stop for start, stop in ranges)
    if particles <= 1024:
        rounds = math.ceil(particles / sum(lanes))
        assert [stop - start for start, stop in ranges[:-1]] == [rounds * n for n in lanes[: len(ranges) - 1]]
    scheduler = Scheduler()
    for number, each in enumerate(lanes):
        scheduler.join(str(number), Offer(lanes=each), 0.0)
    scheduler.start(0, particles, 0.0)
    assert all(batch.stop - batch.start <= 1024 for batch in scheduler.batches)


TICKETS = st.integers(0, 30)
NAMES = st.sampled_from("abc")
HISTORY = st.lists(
    st.tuples(
        st.sampled_from([0.0, 0.01, 0.2, 2.0]),
        st.one_of(
            st.builds(joined, NAMES, st.integers(1, 8)),
            st.builds(left, NAMES),
            st.builds(ended, TICKETS, st.sampled_from(["refined", "nothing", "unavailable"])),
            st.just(look),
        ),
    ),
    max_size=60,
)


@given(st.sampled_from([1, 20, 60, 2_000, 6_000]), HISTORY)
def test_any_history_ends_well(particles: int, history: list[tuple[float, Event]]) -> None:
    """For any events, each particle is accepted once, and with a good worker the job is completed."""
    scheduler, now = Scheduler(), 0.0
    scheduler.start(0, particles, now)
    batches = list(scheduler.batches)
    assert [n for batch in batches for n in range(batch.start, batch.stop)] == list(range(particles))
    for pause, event in history:
        now += pause
        event(scheduler, now)
        check(scheduler)
    for name in "abc":
        scheduler.leave(name, now)
    scheduler.join("good", Offer(), now)
    while scheduler.batches:
        assert scheduler.in_flight, "a good worker is idle while there is work"
        scheduler.end(next(iter(scheduler.in_flight)), "refined", now)
        check(scheduler)
    assert all(batch.done for batch in batches)
