"""The scheduler as tables of events and the instructions expected; nothing is ever lost or done twice."""

from __future__ import annotations

from itertools import cycle, pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from coordinator.pool.dispatch.batches import LARGEST, in_proportion, in_rounds, split, split_in_parts
from coordinator.pool.dispatch.events import (
    Accept,
    Done,
    Ended,
    Event,
    Fail,
    Instruction,
    JobStarted,
    LanesCounted,
    Refused,
    Replied,
    Send,
    Silence,
    Ticked,
    Unavailable,
    WorkerJoined,
    WorkerLeft,
)
from coordinator.pool.dispatch.hearing import SILENT
from coordinator.pool.dispatch.lateness import LATE_LEAST
from coordinator.pool.dispatch.scheduler import PAUSE, Scheduler
from coordinator.pool.dispatch.workload import REST, WINDOW

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
    in_windows = {ticket: worker for worker in scheduler.workers.values() for ticket in worker.flights}
    assert in_windows.keys() == scheduler.flights.keys()
    assert all(flight.worker is in_windows[ticket] for ticket, flight in scheduler.flights.items())
    assert all(len(worker.flights) <= WINDOW for worker in scheduler.workers.values())
    assert all(one.stop == other.start for one, other in pairwise(scheduler.batches))
    assert not scheduler.batches or not all(batch.done for batch in scheduler.batches)
    assert scheduler.may_wait or not scheduler.waiting()
    flying = {id(flight.batch) for flight in scheduler.flights.values()}
    lost = [
        b for b in scheduler.batches if not b.done and id(b) not in flying and b not in scheduler.waiting()
    ]
    assert not lost


A, B = WorkerJoined("a"), WorkerJoined("b")
TWO_AT_WORK: Table = [
    (0.0, A, []),
    (0.0, B, []),
    (
        0.0,
        JobStarted(40, in_parts=True),
        [Send(0, "a", 0, 10), Send(1, "b", 10, 20), Send(2, "a", 20, 30), Send(3, "b", 30, 40)],
    ),
]
ONE_AT_WORK: Table = [
    (0.0, A, []),
    (0.0, JobStarted(20, in_parts=True), [Send(0, "a", 0, 10), Send(1, "a", 10, 20)]),
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


def test_window() -> None:
    """More batches than places in flight: each result makes room for the next batch."""
    play(
        [
            (0.0, A, []),
            (0.0, JobStarted(30, in_parts=True), [Send(0, "a", 0, 10), Send(1, "a", 10, 20)]),
            (0.1, Replied(0), [Accept(0, 0), Send(2, "a", 20, 30)]),
            (0.2, Replied(1), [Accept(1, 10)]),
            (0.3, Replied(2), [Accept(2, 20), Done()]),
        ]
    )


def test_late_joiner_takes_what_waits() -> None:
    """A job that begins without workers waits; the first to join starts, the second takes over the rest."""
    play(
        [
            (0.0, JobStarted(30, in_parts=True), []),
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


def test_lone_worker_is_asked_again_after_a_pause() -> None:
    """With nobody else there, the same worker gets the batch again, but not at once."""
    play(
        [
            *ONE_AT_WORK,
            (1.0, Ended(0), []),
            (1.0 + PAUSE / 2, Ticked(), []),
            (1.0 + PAUSE, Ticked(), [Send(2, "a", 0, 10)]),
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


def test_nothing_is_late_in_a_hurry() -> None:
    """Very fast batches are given a least time before they count as slow."""
    table: Table = [
        *TWO_AT_WORK,
        (1e-4, Replied(0), [Accept(0, 0)]),
        (1e-4, Replied(2), [Accept(2, 20)]),
        (LATE_LEAST * 0.9, Ticked(), []),
        (LATE_LEAST * 1.1, Ticked(), [Send(4, "a", 10, 20)]),
    ]
    play(table)


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
            (0.7, JobStarted(40, in_parts=True), [Send(6, "a", 0, 10), Send(7, "a", 10, 20)]),
            (0.8, Replied(1), [Send(8, "b", 20, 30)]),
            (0.8, Ended(3), []),
        ]
    )


def test_stale_and_unknown_answers_are_ignored() -> None:
    """Answers of a job that was given up, second answers and unknown tickets change nothing."""
    play(
        [
            *ONE_AT_WORK,
            (0.1, JobStarted(4, in_parts=True), []),
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
                JobStarted(60, in_parts=True),
                [Send(k, "ab"[k % 2], 10 * k, 10 * k + 10) for k in range(4)],
            ),
            (0.1, Refused(0, "no"), [Send(4, "a", 40, 50)]),
            (0.2, Replied(1), [Accept(1, 10), Send(5, "b", 0, 10)]),
        ]
    )


def test_failing_worker_rests() -> None:
    """A worker that fails three times in a row rests, and is tried again afterwards."""
    play(
        [
            (0.0, A, []),
            (0.0, B, []),
            (
                0.0,
                JobStarted(60, in_parts=True),
                [Send(k, "ab"[k % 2], 10 * k, 10 * k + 10) for k in range(4)],
            ),
            (0.1, Refused(0, "no"), [Send(4, "a", 40, 50)]),
            (0.1, Refused(2, "no"), [Send(5, "a", 50, 60)]),
            (0.1, Refused(4, "no"), []),
            (0.2, Replied(1), [Accept(1, 10), Send(6, "b", 0, 10)]),
            (0.3, Refused(5, "no"), []),
            (0.9, Replied(3), [Accept(3, 30), Send(7, "b", 20, 30)]),
            (0.9, Replied(6), [Accept(6, 0), Send(8, "b", 40, 50)]),
            (0.9, Replied(7), [Accept(7, 20), Send(9, "b", 50, 60)]),
            (0.9, Replied(8), [Accept(8, 40)]),
            (0.9, Replied(9), [Accept(9, 50), Done()]),
            (0.9, JobStarted(10, in_parts=True), [Send(10, "b", 0, 5), Send(11, "b", 5, 10)]),
            (0.9, Replied(10), [Accept(10, 0)]),
            (0.9, Replied(11), [Accept(11, 5), Done()]),
            (0.1 + REST, JobStarted(10, in_parts=True), [Send(12, "a", 0, 5), Send(13, "b", 5, 10)]),
        ]
    )


def test_refused_by_all_fails() -> None:
    """What every worker refuses fails the job with the reason, once, and the next job starts afresh."""
    play(
        [
            (0.0, A, []),
            (0.0, B, []),
            (0.0, JobStarted(2, in_parts=True), [Send(0, "a", 0, 1), Send(1, "b", 1, 2)]),
            (0.1, Refused(0, "bad model"), [Send(2, "b", 0, 1)]),
            (0.2, Refused(2, "bad model"), [Send(3, "a", 0, 1)]),
            (0.3, Refused(3, "bad model"), [Fail("bad model")]),
            (0.3, Refused(1, "bad model"), []),
            (0.4, JobStarted(1, in_parts=True), [Send(4, "a", 0, 1)]),
        ]
    )


def test_a_worker_that_cannot_find_something_fails_nothing() -> None:
    """It is asked again after a pause, and rests in the end, however often that happens."""
    play(
        [
            (0.0, A, []),
            (0.0, JobStarted(1, in_parts=True), [Send(0, "a", 0, 1)]),
            (0.1, Unavailable(0, "no model"), []),
            (0.1 + PAUSE, Ticked(), [Send(1, "a", 0, 1)]),
            (0.3, Unavailable(1, "no model"), []),
            (0.3 + PAUSE, Ticked(), [Send(2, "a", 0, 1)]),
            (0.5, Unavailable(2, "no model"), []),
            (0.5 + PAUSE, Ticked(), []),
            (0.5 + REST, Ticked(), [Send(3, "a", 0, 1)]),
            (2.0, Replied(3), [Accept(3, 0), Done()]),
        ]
    )


def test_different_reasons_are_all_reported() -> None:
    """A lone worker is asked three times; if its reasons differ, all are named."""
    play(
        [
            (0.0, A, []),
            (0.0, JobStarted(1, in_parts=True), [Send(0, "a", 0, 1)]),
            (0.1, Refused(0, "this"), [Send(1, "a", 0, 1)]),
            (0.2, Refused(1, "that"), [Send(2, "a", 0, 1)]),
            (0.3, Refused(2, "this"), [Fail("this; that")]),
        ]
    )


def test_empty_job_is_done() -> None:
    """A job without particles is done at once."""
    play([(0.0, JobStarted(0, in_parts=True), [Done()])])


@given(st.integers(1, 500), st.integers(0, 20))
def test_split_covers_all_in_fair_parts(particles: int, workers: int) -> None:
    """Batches cover all particles in order, none too large, sizes equal but for one, all workers busy."""
    ranges = split_in_parts(particles, [1.0] * workers)
    sizes = [stop - start for start, stop in ranges]
    assert [k for start, stop in ranges for k in range(start, stop)] == list(range(particles))
    assert max(sizes) <= LARGEST
    assert max(sizes) - min(sizes) <= 1
    assert len(ranges) >= min(particles, workers)


@pytest.mark.parametrize(
    ("particles", "workers", "sizes"),
    [(20, 1, [10, 10]), (20, 2, [10, 10]), (22, 2, [6, 5, 6, 5]), (20, 3, [7, 6, 7]), (1, 8, [1])],
)
def test_split_of_usual_jobs(particles: int, workers: int, sizes: list[int]) -> None:
    """As few as may be, and as many for each worker."""
    assert [stop - start for start, stop in split_in_parts(particles, [1.0] * workers)] == sizes


@given(st.integers(1, 500), st.lists(st.floats(0.25, 4.0), min_size=1, max_size=20))
def test_faster_workers_get_larger_batches(particles: int, speeds: list[float]) -> None:
    """All is covered in order, by whole rounds; batches go with the speeds, and none is empty."""
    ranges = split_in_parts(particles, speeds)
    sizes = [stop - start for start, stop in ranges]
    assert [k for start, stop in ranges for k in range(start, stop)] == list(range(particles))
    assert min(sizes) >= 1
    if len(ranges) >= len(speeds):
        assert len(ranges) % len(speeds) == 0
        total = len(ranges) // len(speeds) * sum(speeds)
        least = particles * min(speeds) < total
        share = (particles - least * len(ranges)) / total
        assert all(
            abs(size - least - share * speed) <= 1.0
            for size, speed in zip(sizes, cycle(speeds), strict=False)
        )


CREWS = st.lists(st.tuples(st.integers(1, 16), st.floats(0.25, 4.0)), min_size=1, max_size=8)


@given(st.integers(1, 2000), CREWS)
def test_no_sooner_end_than_by_whole_rounds(particles: int, crews: list[tuple[int, float]]) -> None:
    """All can be done in the rounds given; a hair before the last of them ends, it could not."""
    lanes = [count for count, _ in crews]
    most = in_rounds(particles, [count * pace for count, pace in crews], lanes)
    assert sum(most) >= particles
    ends = max(can / count / pace for can, (count, pace) in zip(most, crews, strict=True))
    sooner = [count * int(pace * ends * (1.0 - 1e-6)) for count, pace in crews]
    assert sum(sooner) < particles


@given(
    st.integers(1, 400),
    st.lists(st.tuples(st.integers(1, 64), st.floats(0.05, 20.0)), min_size=1, max_size=8),
)
def test_shares_end_no_later_than_proportional_ones(particles: int, crews: list[tuple[int, float]]) -> None:
    """Every particle once; each worker has one at the least, where there are enough; no round too many."""
    lanes = [count for count, _ in crews]
    speeds = [count * pace for count, pace in crews]
    shares = split(particles, speeds, lanes)
    assert [n for start, stop in shares for n in range(start, stop)] == list(range(particles))
    assert len(shares) == min(particles, len(crews))
    assert all(start < stop for start, stop in shares)
    if particles >= len(crews):
        assert end_of(shares, crews) <= end_of(in_proportion(particles, speeds), crews) * (1.0 + 1e-6)


def end_of(shares: list[tuple[int, int]], crews: list[tuple[int, float]]) -> float:
    """When the last worker is done, whose lanes refine one particle after the other."""
    return max(
        -(-(stop - start) // count) / pace for (start, stop), (count, pace) in zip(shares, crews, strict=True)
    )


@given(st.lists(st.floats(0.99, 1.01), min_size=2, max_size=16), st.integers(1, 40))
def test_no_lane_gets_one_more_for_a_trifle(paces: list[float], rounds: int) -> None:
    """Workers of sixteen lanes that are about as fast end in the same round."""
    lanes = [16] * len(paces)
    particles = sum(lanes) * rounds
    ranges = split(particles, [16 * pace for pace in paces], lanes)
    assert {stop - start for start, stop in ranges} == {16 * rounds}


TWO_IDLE: Table = [(0.0, A, []), (0.0, B, [])]


def sends_of(scheduler: Scheduler, particles: int, now: float) -> list[Send]:
    """The batches that a job begins with."""
    return [
        issued
        for issued in scheduler.handle(JobStarted(particles, in_parts=True), now)
        if isinstance(issued, Send)
    ]


def test_by_a_deadline_what_can_be_done_without_comes_in_a_batch_of_its_own() -> None:
    """So no particle that is needed waits for one that is not, and none of both is asked twice."""
    for particles, spare in ((25, 5), (103, 3), (6, 5)):
        scheduler = play(TWO_IDLE)
        scheduler.handle(JobStarted(particles, in_parts=True, spare=spare), 0.0)
        ends = [(batch.start, batch.stop) for batch in scheduler.batches]
        assert ends[-1] == (particles - spare, particles)
        assert [n for start, stop in ends for n in range(start, stop)] == list(range(particles))


def test_a_slower_worker_gets_less() -> None:
    """Who needs twice as long for as many particles gets half as many in the end, whatever it waited for."""
    scheduler, now = play(TWO_IDLE), 0.0
    for _ in range(30):
        sends = sends_of(scheduler, 15, now)
        assert [s.worker for s in sends] == ["a", "b"]
        took = [(s.stop - s.start) * (0.01 if s.worker == "a" else 0.02) for s in sends]
        for send, seconds in sorted(zip(sends, took, strict=True), key=lambda one: one[1]):
            scheduler.handle(Replied(send.ticket), now + seconds)
        now += max(took) + 1.0
    assert [(s.start, s.stop) for s in sends] == [(0, 10), (10, 15)]


def test_a_pace_is_by_when_answers_came() -> None:
    """Two answers that are handled at once, late, are two batches one after the other."""
    scheduler, now = play(TWO_IDLE), 0.0
    for _ in range(10):
        sends = sends_of(scheduler, 40, now)
        assert [s.stop - s.start for s in sends] == [10, 10, 10, 10]
        for k, send in enumerate(sends):
            scheduler.handle(Replied(send.ticket, now + 0.1 * (1 + k // 2)), now + 0.25)
        now += 10.0


def test_larger_batches_go_to_faster_workers_whoever_is_busy() -> None:
    """A worker that is still busy with an old job comes last, and its share with it."""
    scheduler, now = play(TWO_IDLE), 0.0
    stuck = None
    for job in range(12):
        sends = {s.worker: s for s in sends_of(scheduler, 20, now)}
        if stuck is not None:
            assert (sends["b"].stop - sends["b"].start) > 10 > (sends["a"].stop - sends["a"].start)
            return
        scheduler.handle(Replied(sends["b"].ticket), now + 0.01 * (sends["b"].stop - sends["b"].start))
        if job == 10:
            stuck = sends["a"]  # is never answered: b does it, too
            (again,) = (s for s in scheduler.handle(Ticked(), now + 60.0) if isinstance(s, Send))
            scheduler.handle(Replied(again.ticket), now + 61.0)
        else:
            scheduler.handle(Replied(sends["a"].ticket), now + 0.03 * (sends["a"].stop - sends["a"].start))
        now += 100.0


def test_one_frozen_moment_is_passed_over() -> None:
    """One answer that took a minute changes nothing."""
    scheduler, now = play(TWO_IDLE), 0.0
    shares = []
    for job in range(40):
        sends = sends_of(scheduler, 20, now)
        shares.append({s.worker: s.stop - s.start for s in sends}["b"])
        for send in sends:
            took = 60.0 if job == 3 and send.worker == "b" else 0.01 * (send.stop - send.start)
            scheduler.handle(Replied(send.ticket), now + took)
        now += 100.0
    assert set(shares) == {10}


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
def test_any_history_ends_well(particles: int, history: list[tuple[float, Event]], in_parts: bool) -> None:
    """Whatever workers do, each particle is accepted once, and with a good worker the job gets done."""
    scheduler, now = Scheduler(), 0.0
    issued: list[Instruction] = []

    def feed(event: Event) -> None:
        issued.extend(scheduler.handle(event, now))
        check(scheduler)

    feed(JobStarted(particles, in_parts=in_parts))
    for pause, event in history:
        now += pause
        feed(event)
    for name in "abc":
        feed(WorkerLeft(name))
    feed(WorkerJoined("good"))
    while scheduler.batches:
        assert scheduler.flights, "a good worker is idle while there is work"
        feed(Replied(next(iter(scheduler.flights))))
    sent = {send.ticket: (send.start, send.stop) for send in issued if isinstance(send, Send)}
    accepted = sorted(sent[accept.ticket] for accept in issued if isinstance(accept, Accept))
    assert [n for start, stop in accepted for n in range(start, stop)] == list(range(particles))
    assert issued.count(Done()) == 1


def test_one_batch_a_worker() -> None:
    """Without a deadline each worker is asked once a job, however many particles there are."""
    play([*TWO_IDLE, (0.0, JobStarted(1000), [Send(0, "a", 0, 500), Send(1, "b", 500, 1000)])])


def test_no_batch_is_larger_than_its_reply_may_be() -> None:
    """What a worker may not answer in one reply it is asked for in several; both have as much to do."""
    scheduler = play(TWO_IDLE)
    scheduler.handle(JobStarted(1000, most=300), 0.0)
    assert [(f.worker.name, f.batch.start, f.batch.stop) for f in scheduler.flights.values()] == [
        ("a", 0, 250), ("b", 500, 750), ("a", 250, 500), ("b", 750, 1000),
    ]  # fmt: skip


def test_more_lanes_get_more() -> None:
    """Shares go with the lanes, whether they are known before the worker or become known later."""
    play(
        [
            (0.0, LanesCounted("a", 3), []),
            (0.0, A, []),
            (0.0, B, []),
            (0.0, JobStarted(40), [Send(0, "a", 0, 30), Send(1, "b", 30, 40)]),
            (0.1, Replied(0), [Accept(0, 0)]),
            (0.1, Replied(1), [Accept(1, 30), Done()]),
            (0.2, LanesCounted("b", 7), []),
            (0.2, JobStarted(100), [Send(2, "a", 0, 30), Send(3, "b", 30, 100)]),
        ]
    )


def test_noise_of_speeds_costs_no_round() -> None:
    """A worker that was a percent faster gets no particle more than what its lanes have whole rounds of."""
    counted: Table = [(0.0, LanesCounted(name, 16), []) for name in "ab"]
    scheduler, now = play([*counted, *TWO_IDLE]), 0.0
    for _ in range(8):
        sends = [send for send in scheduler.handle(JobStarted(320), now) if isinstance(send, Send)]
        assert [send.stop - send.start for send in sends] == [160, 160]
        for send in sends:
            scheduler.handle(Replied(send.ticket), now + (0.0643 if send.worker == "a" else 0.0657))
        now += 1.0


def test_a_lost_share_is_split_among_the_others() -> None:
    """When a worker dies with its share, all that are left do a part of it."""
    play(
        [
            *TWO_IDLE,
            (0.0, WorkerJoined("c"), []),
            (0.0, JobStarted(60), [Send(0, "a", 0, 20), Send(1, "b", 20, 40), Send(2, "c", 40, 60)]),
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
            (0.0, JobStarted(20), [Send(0, "a", 0, 10), Send(1, "b", 10, 20)]),
            (0.1, Replied(0), [Accept(0, 0)]),
            (0.1, Replied(1), [Accept(1, 10), Done()]),
            (1.0, JobStarted(200), [Send(2, "a", 0, 100), Send(3, "b", 100, 200)]),
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
            (0.0, JobStarted(10), [Send(0, "a", 0, 10)]),
            (1.5 * SILENT, Ended(0), [Silence("a", again=False)]),
            (1.6 * SILENT, Ticked(), [Send(1, "a", 0, 10)]),
            (3.1 * SILENT, Ended(1), [Silence("a", again=True)]),
        ]
    )


@pytest.mark.parametrize("said", [Unavailable(1, "no frame"), Refused(1, "no"), Replied(99)])
def test_any_word_breaks_the_silence(said: Event) -> None:
    """An answer to whatever, of whoever, shows that the way is open: a worker that hangs is its own fault."""
    scheduler = play(
        [
            (0.0, A, []),
            (0.0, JobStarted(10), [Send(0, "a", 0, 10)]),
            (1.5 * SILENT, Ended(0), [Silence("a", again=False)]),
            (1.6 * SILENT, Ticked(), [Send(1, "a", 0, 10)]),
        ]
    )
    scheduler.handle(said, 1.7 * SILENT)
    late = scheduler.handle(Ticked(), 2.0 * SILENT) + scheduler.handle(Ended(1), 3.1 * SILENT)
    assert not any(isinstance(instruction, Silence) for instruction in late)


def test_a_request_that_ends_early_is_no_silence() -> None:
    """The worker has just gone, or was too busy: it is asked again."""
    play(
        [
            (0.0, A, []),
            (0.0, JobStarted(10), [Send(0, "a", 0, 10)]),
            (0.5 * SILENT, Ended(0), []),
            (0.6 * SILENT, Ticked(), [Send(1, "a", 0, 10)]),
        ]
    )
