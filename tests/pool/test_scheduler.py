"""The scheduler as tables of events and the instructions expected; nothing is ever lost or done twice."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from coordinator.pool.dispatch.batches import split
from coordinator.pool.dispatch.events import (
    Accept,
    Done,
    Ended,
    Event,
    Fail,
    Instruction,
    LanesCounted,
    NoAnswer,
    Refused,
    Replied,
    Send,
    Started,
    Ticked,
    Unavailable,
    WorkerJoined,
    WorkerLeft,
)
from coordinator.pool.dispatch.scheduler import Scheduler

Table = list[tuple[float, Event, list[Instruction]]]


def play(table: Table) -> Scheduler:
    """Run a table of (time, event, instructions expected), checking the invariants after every event."""
    scheduler = Scheduler()
    for row, (now, event, expected) in enumerate(table):
        assert scheduler.handle(event, now) == expected, f"row {row}: {event}"
        check(scheduler)
    return scheduler


def check(scheduler: Scheduler) -> None:
    """What holds between any two events."""
    at_workers = {ticket: worker for worker in scheduler.workers.values() for ticket in worker.in_flight}
    assert at_workers.keys() == scheduler.in_flight.keys()
    assert all(flight.worker is at_workers[ticket] for ticket, flight in scheduler.in_flight.items())
    assert all(len(worker.in_flight) <= 2 for worker in scheduler.workers.values())
    assert all(one.stop == other.start for one, other in pairwise(scheduler.batches))
    assert not scheduler.batches or not all(batch.done for batch in scheduler.batches)
    for batch in scheduler.batches:
        assert batch.in_flight == sum(flight.batch is batch for flight in scheduler.in_flight.values())


A, B = WorkerJoined("a"), WorkerJoined("b")
TWO_IDLE: Table = [(0.0, A, []), (0.0, B, [])]
TWO_AT_WORK: Table = [
    (0.0, A, []),
    (0.0, B, []),
    (
        0.0,
        Started(40, by_deadline=True),
        [Send(0, "a", 0, 10), Send(1, "b", 10, 20), Send(2, "a", 20, 30), Send(3, "b", 30, 40)],
    ),
]
ONE_AT_WORK: Table = [
    (0.0, A, []),
    (0.0, Started(20, by_deadline=True), [Send(0, "a", 0, 10), Send(1, "a", 10, 20)]),
]


def test_calm() -> None:
    """Two workers share a job; each result is accepted once, and the last one ends the job."""
    scheduler = play(
        [
            *TWO_AT_WORK,
            (0.1, Replied(1), [Accept(1, 10)]),
            (0.1, Ended(1), []),
            (0.1, Replied(0), [Accept(0, 0)]),
            (0.2, Replied(3), [Accept(3, 30)]),
            (0.2, Replied(2), [Accept(2, 20), Done()]),
            (0.2, Ended(2), []),
        ]
    )
    assert scheduler.counts.batches_sent == 4
    assert scheduler.counts.batches_sent_again == 0


def test_late_joiner_takes_what_waits() -> None:
    """A job that begins without workers waits; the first to join starts, the second takes over the rest."""
    play(
        [
            (0.0, Started(30, by_deadline=True), []),
            (1.0, Ticked(), []),
            (2.0, A, [Send(0, "a", 0, 10), Send(1, "a", 10, 20)]),
            (2.1, B, [Send(2, "b", 20, 30)]),
            (2.2, Replied(0), [Accept(0, 0)]),
            (2.2, Replied(2), [Accept(2, 20)]),
            (2.2, Replied(1), [Accept(1, 10), Done()]),
        ]
    )


def test_killed_worker() -> None:
    """What a lost worker was working on goes to the other one, and its late answers are ignored."""
    scheduler = play(
        [
            *TWO_AT_WORK,
            (0.1, Replied(0), [Accept(0, 0)]),
            (0.1, WorkerLeft("b"), [Send(4, "a", 10, 20)]),
            (0.1, Ended(1), []),
            (0.1, Replied(3), []),
            (0.2, Replied(2), [Accept(2, 20), Send(5, "a", 30, 40)]),
            (0.3, Replied(4), [Accept(4, 10)]),
            (0.4, Replied(5), [Accept(5, 30), Done()]),
        ]
    )
    assert scheduler.counts.batches_sent_again == 2


def test_ended_without_answer() -> None:
    """A request that ends without an answer is sent elsewhere; its worker pauses, as it may be gone."""
    play(
        [
            *TWO_AT_WORK,
            (0.1, Replied(0), [Accept(0, 0)]),
            (0.1, Ended(1), [Send(4, "a", 10, 20)]),
            (0.1, Ended(3), []),
            (0.15, Replied(2), [Accept(2, 20), Send(5, "a", 30, 40)]),
        ]
    )


def test_all_workers_lost_and_one_back() -> None:
    """With no worker left the job waits, and goes on when one comes, under an old name or a new one."""
    play(
        [
            *ONE_AT_WORK,
            (0.1, Replied(0), [Accept(0, 0)]),
            (0.2, WorkerLeft("a"), []),
            (9.0, Ticked(), []),
            (9.1, A, [Send(2, "a", 10, 20)]),
            (9.2, Replied(1), []),
            (9.3, Replied(2), [Accept(2, 10), Done()]),
        ]
    )


def test_slow_tail_is_sent_again() -> None:
    """What takes much longer than usual is sent again to an idle worker, once; the first result wins."""
    scheduler = play(
        [
            *TWO_AT_WORK,
            (0.1, Replied(0), [Accept(0, 0)]),
            (0.1, Replied(2), [Accept(2, 20)]),
            (0.1, Replied(1), [Accept(1, 10)]),
            (0.29, Ticked(), []),
            (0.31, Ticked(), [Send(4, "a", 30, 40)]),
            (9.0, Ticked(), []),
            (9.1, Replied(4), [Accept(4, 30), Done()]),
            (9.2, Replied(3), []),
        ]
    )
    assert scheduler.counts.batches_sent_again == 1


def test_frozen_worker_gets_no_more() -> None:
    """A worker that is still busy with the job before gets nothing of the next one."""
    play(
        [
            *TWO_AT_WORK,
            (0.1, Replied(0), [Accept(0, 0)]),
            (0.1, Replied(2), [Accept(2, 20)]),
            (0.5, Ticked(), [Send(4, "a", 10, 20)]),
            (0.6, Replied(4), [Accept(4, 10), Send(5, "a", 30, 40)]),
            (0.7, Replied(5), [Accept(5, 30), Done()]),
            (0.7, Started(40, by_deadline=True), [Send(6, "a", 0, 10), Send(7, "a", 10, 20)]),
            (0.8, Replied(1), [Send(8, "b", 20, 30)]),
            (0.8, Ended(3), []),
        ]
    )


def test_stale_and_unknown_answers_are_ignored() -> None:
    """Answers of a job that was given up, second answers and unknown tickets change nothing."""
    play(
        [
            *ONE_AT_WORK,
            (0.1, Started(4, by_deadline=True), []),
            (0.2, Replied(0), [Send(2, "a", 0, 4)]),
            (0.2, Replied(0), []),
            (0.2, Replied(99), []),
            (0.2, Refused(99, "no"), []),
            (0.2, Ended(99), []),
            (0.2, WorkerLeft("nobody"), []),
            (0.3, Replied(2), [Accept(2, 0), Done()]),
        ]
    )


def test_refused_batch_goes_elsewhere() -> None:
    """A batch that one worker refuses is done by another, even if that one is busy at the moment."""
    play(
        [
            (0.0, A, []),
            (0.0, B, []),
            (
                0.0,
                Started(60, by_deadline=True),
                [Send(k, "ab"[k % 2], 10 * k, 10 * k + 10) for k in range(4)],
            ),
            (0.1, Refused(0, "no"), []),
            (0.15, Replied(1), [Accept(1, 10), Send(4, "b", 0, 10)]),
            (2.0, Ticked(), [Send(5, "a", 40, 50)]),
        ]
    )


@pytest.mark.parametrize("failure", [Ended(0), Unavailable(0, "no model")])
def test_a_failing_worker_rests(failure: Event) -> None:
    """With no other worker it gets the batch again after a pause, and nothing fails."""
    play(
        [
            (0.0, A, []),
            (0.0, Started(1), [Send(0, "a", 0, 1)]),
            (1.0, failure, []),
            (1.1, Ticked(), []),
            (2.0, Ticked(), [Send(1, "a", 0, 1)]),
            (3.0, Replied(1), [Accept(1, 0), Done()]),
        ]
    )


def test_a_share_of_a_resting_worker_is_done_by_the_other() -> None:
    """Its batch is sent when the other worker has room for it, or when it is back."""
    play(
        [
            *TWO_IDLE,
            (0.0, Started(2), [Send(0, "a", 0, 1), Send(1, "b", 1, 2)]),
            (0.1, Ended(0), [Send(2, "b", 0, 1)]),
            (0.1, Replied(1), [Accept(1, 1)]),
            (0.1, Replied(2), [Accept(2, 0), Done()]),
            (0.15, Started(3), [Send(3, "b", 0, 2), Send(4, "b", 2, 3)]),
        ]
    )


@pytest.mark.parametrize(
    ("reasons", "failed"), [(["no", "no", "no"], "no"), (["this", "that", "this"], "this; that")]
)
def test_what_all_refuse_fails(reasons: list[str], failed: str) -> None:
    """After three refusals, by every worker, with all reasons, once; the next refinement starts afresh."""
    one, two, three = reasons
    play(
        [
            *TWO_IDLE,
            (0.0, Started(2), [Send(0, "a", 0, 1), Send(1, "b", 1, 2)]),
            (0.1, Refused(0, one), [Send(2, "b", 0, 1)]),
            (2.0, Refused(2, two), [Send(3, "a", 0, 1)]),
            (3.0, Refused(3, three), [Fail(failed)]),
            (3.0, Refused(1, "late"), []),
            (9.0, Started(1), [Send(4, "a", 0, 1)]),
        ]
    )


def test_a_lone_worker_may_refuse_three_times() -> None:
    """It may have been a broken message: the batch fails with the third refusal."""
    play(
        [
            (0.0, A, []),
            (0.0, Started(1), [Send(0, "a", 0, 1)]),
            (1.0, Refused(0, "no"), []),
            (2.0, Ticked(), [Send(1, "a", 0, 1)]),
            (3.0, Refused(1, "no"), []),
            (4.0, Ticked(), [Send(2, "a", 0, 1)]),
            (5.0, Refused(2, "no"), [Fail("no")]),
        ]
    )


def test_empty_job_is_done() -> None:
    """A job without particles is done at once."""
    play([(0.0, Started(0, by_deadline=True), [Done()])])


@given(st.integers(0, 2000), st.lists(st.integers(1, 50), min_size=1, max_size=12))
def test_shares_go_with_lanes(particles: int, lanes: list[int]) -> None:
    """All particles in order; no share is empty, and none is far from what the lanes of its worker do."""
    ranges = split(particles, lanes)
    assert [n for start, stop in ranges for n in range(start, stop)] == list(range(particles))
    most = particles * max(lanes) / sum(lanes) + 1.0
    assert all(0 < stop - start <= most for start, stop in ranges)


TICKETS = st.integers(0, 30)
HISTORY = st.lists(
    st.tuples(
        st.sampled_from([0.0, 0.01, 0.2, 2.0]),
        st.one_of(
            st.builds(WorkerJoined, st.sampled_from("abc")),
            st.builds(WorkerLeft, st.sampled_from("abc")),
            st.builds(LanesCounted, st.sampled_from("abc"), st.integers(1, 8)),
            st.builds(Replied, TICKETS),
            st.builds(Ended, TICKETS),
            st.just(Ticked()),
        ),
    ),
    max_size=60,
)


@given(st.integers(1, 60), HISTORY, st.booleans())
def test_any_history_ends_well(particles: int, history: list[tuple[float, Event]], by_deadline: bool) -> None:
    """Whatever workers do, each particle is accepted once, and with a good worker the job gets done."""
    scheduler, now = Scheduler(), 0.0
    issued: list[Instruction] = []

    def feed(event: Event) -> None:
        issued.extend(scheduler.handle(event, now))
        check(scheduler)

    feed(Started(particles, by_deadline=by_deadline))
    for pause, event in history:
        now += pause
        feed(event)
    for name in "abc":
        feed(WorkerLeft(name))
    feed(WorkerJoined("good"))
    while scheduler.batches:
        assert scheduler.in_flight, "a good worker is idle while there is work"
        feed(Replied(next(iter(scheduler.in_flight))))
    sent = {send.ticket: (send.start, send.stop) for send in issued if isinstance(send, Send)}
    accepted = sorted(sent[accept.ticket] for accept in issued if isinstance(accept, Accept))
    assert [n for start, stop in accepted for n in range(start, stop)] == list(range(particles))
    assert issued.count(Done()) == 1


def test_one_batch_a_worker() -> None:
    """Without a deadline each worker is asked once a job, however many particles there are."""
    play([*TWO_IDLE, (0.0, Started(1000), [Send(0, "a", 0, 500), Send(1, "b", 500, 1000)])])


def test_no_batch_is_larger_than_its_reply_may_be() -> None:
    """What a worker may not answer in one reply it is asked for in several; both have as much to do."""
    scheduler = play(TWO_IDLE)
    scheduler.handle(Started(1000, largest_batch=300), 0.0)
    assert [(f.worker.name, f.batch.start, f.batch.stop) for f in scheduler.in_flight.values()] == [
        ("a", 0, 250), ("b", 250, 500), ("a", 500, 750), ("b", 750, 1000),
    ]  # fmt: skip


def test_more_lanes_get_more() -> None:
    """Shares go with the lanes, whether they are known before the worker or become known later."""
    play(
        [
            (0.0, LanesCounted("a", 3), []),
            (0.0, A, []),
            (0.0, B, []),
            (0.0, Started(40), [Send(0, "a", 0, 30), Send(1, "b", 30, 40)]),
            (0.1, Replied(0), [Accept(0, 0)]),
            (0.1, Replied(1), [Accept(1, 30), Done()]),
            (0.2, LanesCounted("b", 7), []),
            (0.2, Started(100), [Send(2, "a", 0, 30), Send(3, "b", 30, 100)]),
        ]
    )


def test_a_lost_share_is_split_among_the_others() -> None:
    """When a worker dies with its share, all that are left do a part of it."""
    play(
        [
            *TWO_IDLE,
            (0.0, WorkerJoined("c"), []),
            (0.0, Started(60), [Send(0, "a", 0, 20), Send(1, "b", 20, 40), Send(2, "c", 40, 60)]),
            (0.1, WorkerLeft("c"), [Send(3, "a", 40, 50), Send(4, "b", 50, 60)]),
            (0.2, Replied(0), [Accept(0, 0)]),
            (0.2, Replied(1), [Accept(1, 20)]),
            (0.3, Replied(4), [Accept(4, 50)]),
            (0.3, Replied(3), [Accept(3, 40), Done()]),
        ]
    )


def test_a_large_share_is_not_late_by_its_size() -> None:
    """A share of ten times as many particles may take ten times as long before it is sent again."""
    play(
        [
            *TWO_IDLE,
            (0.0, Started(20), [Send(0, "a", 0, 10), Send(1, "b", 10, 20)]),
            (0.1, Replied(0), [Accept(0, 0)]),
            (0.1, Replied(1), [Accept(1, 10), Done()]),
            (1.0, Started(200), [Send(2, "a", 0, 100), Send(3, "b", 100, 200)]),
            (2.0, Replied(2), [Accept(2, 0)]),
            (3.9, Ticked(), []),
            (4.1, Ticked(), [Send(4, "a", 100, 200)]),
        ]
    )


def test_silence_is_named_and_then_again() -> None:
    """Who is there and never answers is asked once more; a second silence is reported as such."""
    play(
        [
            (0.0, A, []),
            (0.0, Started(10), [Send(0, "a", 0, 10)]),
            (30.0, Ended(0), [NoAnswer("a", again=False)]),
            (32.0, Ticked(), [Send(1, "a", 0, 10)]),
            (62.0, Ended(1), [NoAnswer("a", again=True)]),
        ]
    )


@pytest.mark.parametrize("said", [Unavailable(1, "no frame"), Refused(1, "no"), Replied(99)])
def test_any_word_breaks_the_silence(said: Event) -> None:
    """An answer to whatever, of whoever, shows that the way is open: a worker that hangs is its own fault."""
    scheduler = play(
        [
            (0.0, A, []),
            (0.0, Started(10), [Send(0, "a", 0, 10)]),
            (30.0, Ended(0), [NoAnswer("a", again=False)]),
            (32.0, Ticked(), [Send(1, "a", 0, 10)]),
        ]
    )
    scheduler.handle(said, 34.0)
    late = scheduler.handle(Ticked(), 40.0) + scheduler.handle(Ended(1), 62.0)
    assert not any(isinstance(instruction, NoAnswer) for instruction in late)


def test_a_request_that_ends_early_is_no_silence() -> None:
    """The worker has just gone, or was too busy: it is asked again."""
    play(
        [
            (0.0, A, []),
            (0.0, Started(10), [Send(0, "a", 0, 10)]),
            (10.0, Ended(0), []),
            (12.0, Ticked(), [Send(1, "a", 0, 10)]),
        ]
    )
