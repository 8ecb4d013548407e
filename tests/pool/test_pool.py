"""Coordinator and workers joined in one process over the real bus."""

from __future__ import annotations

import re
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from queue import SimpleQueue
from typing import Any

import pytest

from gepf.common.errors import InputError, NoWorkers, ProtocolError
from gepf.common.frame import SubjectFrame
from gepf.common.kernel import Kernel
from gepf.common.offer import Offer
from gepf.common.protocol import keys
from gepf.common.protocol.messages import decode_refusal, encode_refusal, encode_request
from gepf.common.protocol.wire import PROTOCOL
from gepf.common.refinement import Particles
from gepf.common.settings import RefineSettings
from gepf.common.transport.channels import IncomingRequest
from gepf.common.transport.opening import open_coordinator, open_worker
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from gepf.worker.memory import MemoryLimits
from tests.support.answers import as_bytes
from tests.support.processes.instant_worker import observe, refine
from tests.support.processes.programs import wait_until
from tests.support.processes.serving import (
    MODEL,
    PARTICLES,
    POSES,
    REQUEST,
    SETTINGS,
    WatchedBus,
    expected,
    frame,
    pool,
    refined_bytes,
    serving,
)


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_same_bytes_for_any_number_of_workers(endpoint: str, workers: int) -> None:
    """In every frame the result is that of the kernel itself, for any division."""
    with pool(endpoint) as refiner, ExitStack() as stack:
        for k in range(workers):
            stack.enter_context(serving(endpoint, f"w{k}"))
        refiner.wait_for(workers)
        for number in range(5):
            assert refined_bytes(refiner, number) == expected(number)
        assert refiner.statistics.workers_seen == tuple(f"w{k}" for k in range(workers))


def test_frame_may_be_refined_more_than_once(endpoint: str) -> None:
    """Several calls about one frame, also at the same time, see that frame, with other poses and models."""
    other = replace(MODEL, vertices=MODEL.vertices * 2)
    with pool(endpoint) as refiner, serving(endpoint, "w"):
        subject = frame(3)
        one = refiner.submit(subject, MODEL, Particles(POSES[:1], SETTINGS))
        two = refiner.submit(subject, other, PARTICLES).result()
        assert as_bytes(one.result()) == expected(3, POSES[:1])
    assert as_bytes(two) == as_bytes(refine(other, observe(frame(3)), PARTICLES))


def test_frames_of_one_number_are_not_mixed_up(endpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A repeated number, as in a second sequence on the same pool, is a new frame, which is sent.

    Only the body and the first frame are fetched: the worker receives the others.
    """
    monkeypatch.setattr("gepf.worker.memory.LIMITS", MemoryLimits(frame_delay_s=300.0))
    fetched = SimpleQueue[str]()
    with (
        pool(endpoint) as refiner,
        serving(endpoint, "w", through=lambda bus: WatchedBus(bus, iter(()), fetched)),
    ):
        refiner.wait_for(1)
        for depth in (1, 2, 3, 4, 5):
            again = replace(frame(depth), number=7)
            assert as_bytes(refiner.submit(again, MODEL, PARTICLES).result()) == expected(depth)
            await_subscriber(refiner)
    kinds = Counter(fetched.get().split("/")[4] for _ in range(fetched.qsize()))
    assert kinds["model"] == 1
    assert kinds["frame"] in {1, 2}  # the second request may be faster than its frame


def await_subscriber(refiner: ZenohRefiner) -> None:
    """Return when a worker receives the frames of a run."""
    wait_until(lambda: refiner._publication._publisher.has_subscriber)


def telling(
    observed: SimpleQueue[int], prepared: SimpleQueue[RefineSettings] | None = None
) -> Callable[[SubjectFrame, RefineSettings], Any]:
    """Observe frames, and tell their numbers, and for which settings."""

    def observe_and_tell(subject: SubjectFrame, settings: RefineSettings) -> Any:
        observed.put(subject.number)
        if prepared is not None:
            prepared.put(settings)
        return observe(subject)

    return observe_and_tell


def test_a_frame_sent_ahead_is_ready_when_its_turn_comes(endpoint: str) -> None:
    """An idle worker prepares it for the settings of its run before a request; it is used when published."""
    coming, observed, prepared = frame(2), SimpleQueue[int](), SimpleQueue[RefineSettings]()

    with pool(endpoint) as refiner, serving(endpoint, "w", Kernel(telling(observed, prepared), refine)):
        refined_bytes(refiner, 0)
        await_subscriber(refiner)
        assert observed.get() == 0
        assert prepared.get() == SETTINGS
        present = frame(1)
        pending = refiner.submit(present, MODEL, PARTICLES)
        refiner.publish(coming)
        one = pending.result()
        assert {observed.get(timeout=300.0) for _ in range(2)} == {1, 2}
        assert prepared.get(timeout=300.0) == SETTINGS
        again = refiner.submit(present, MODEL, PARTICLES).result()
        two = refiner.submit(coming, MODEL, PARTICLES).result()
    assert as_bytes(one) == as_bytes(again) == expected(1)
    assert as_bytes(two) == expected(2)
    assert observed.empty()


def test_a_frame_that_comes_again_is_not_sent_again(endpoint: str) -> None:
    """A worker observes it once, also after many others that are in work; a late worker still gets it."""
    first, coming = frame(1), frame(99)
    observed = SimpleQueue[int]()

    with pool(endpoint) as refiner:
        pending = [refiner.submit(frame(number), MODEL, PARTICLES) for number in range(2, 11)]
        for subject in (first, coming):
            refiner.publish(subject)
        pending.append(refiner.submit(first, MODEL, PARTICLES))
        with serving(endpoint, "early", Kernel(telling(observed), refine)):
            for each in pending:
                each.result()
            refiner.submit(first, MODEL, PARTICLES).result()
            assert {observed.get(timeout=300.0) for _ in range(10)} == {*range(2, 12)}
            assert observed.empty()
        with serving(endpoint, "late", Kernel(telling(observed), refine)):
            assert as_bytes(refiner.submit(first, MODEL, PARTICLES).result()) == expected(1)
        with serving(endpoint, "later"):
            assert as_bytes(refiner.submit(coming, MODEL, PARTICLES).result()) == expected(99)


def test_the_lanes_of_a_worker_get_the_frame_and_body_of_a_search_once(endpoint: str) -> None:
    """Although its first requests come together, one for each."""
    observed, fetched = SimpleQueue[int](), SimpleQueue[str]()

    def slowly(subject: SubjectFrame, settings: RefineSettings) -> Any:
        time.sleep(0.1)
        return telling(observed)(subject, settings)

    with (
        pool(endpoint) as refiner,
        serving(
            endpoint,
            "w",
            Kernel(slowly, refine, Offer(lanes=4)),
            lambda bus: WatchedBus(bus, iter(()), fetched),
        ),
    ):
        refiner.wait_for(1)
        subject = frame(1)
        pending = [refiner.submit(subject, MODEL, replace(PARTICLES, spare=True)) for _ in range(4)]
        assert all(as_bytes(each.result()) == expected(1) for each in pending)
    assert [fetched.get().split("/")[4] for _ in range(2)] == ["model", "frame"]
    assert fetched.empty()
    assert observed.get() == 1
    assert observed.empty()


def test_a_frame_sent_ahead_that_makes_no_sense_harms_its_own_turn_alone(endpoint: str) -> None:
    """The worker reports the fault to a request for it, and serves the frames before and after."""
    coming, tried = frame(2), SimpleQueue[int]()

    def refuse_the_second(subject: SubjectFrame, _: RefineSettings) -> Any:
        tried.put(subject.number)
        if subject.number == 2:
            raise ValueError("it hurts")
        return observe(subject)

    with pool(endpoint) as refiner, serving(endpoint, "w", Kernel(refuse_the_second, refine)):
        refined_bytes(refiner, 0)
        await_subscriber(refiner)
        assert tried.get() == 0
        pending = refiner.submit(frame(1), MODEL, PARTICLES)
        refiner.publish(coming)
        one = pending.result()
        assert {tried.get(timeout=300.0) for _ in range(2)} == {1, 2}
        with pytest.raises(ProtocolError, match="it hurts"):
            refiner.submit(coming, MODEL, PARTICLES).result()
        three = refined_bytes(refiner, 3)
    assert (as_bytes(one), three) == (expected(1), expected(3))


def test_run_outlasts_a_time_in_which_it_is_not_found(endpoint: str) -> None:
    """Workers that cannot fetch the body, for example just after a reconnection, ask again."""
    said: list[str] = []
    in_vain = iter(range(6))
    with (
        ZenohRefiner(Pool(workers=0, listen=endpoint, worker_timeout=300.0), said.append) as refiner,
        serving(endpoint, "one", through=lambda bus: WatchedBus(bus, in_vain, SimpleQueue())),
        serving(endpoint, "two", through=lambda bus: WatchedBus(bus, in_vain, SimpleQueue())),
    ):
        refiner.wait_for(2)
        pending = refiner.submit(frame(1), MODEL, PARTICLES)
        while not pending.poll():  # it goes on without being waited for
            time.sleep(0.001)
        assert as_bytes(pending.result()) == expected(1)
        assert refiner.statistics.counts["batches_sent_again"] >= 6
    assert sum("is not available" in line for line in said) == 1


def test_work_goes_on_after_nobody_came(endpoint: str) -> None:
    """The wait is bounded, and its end says how to start a worker; then only the new job is done."""
    with ZenohRefiner(Pool(workers=0, listen=endpoint, worker_timeout=0.2)) as refiner:
        with pytest.raises(NoWorkers, match="gepf-worker --connect unixsock"):
            refined_bytes(refiner, 1)
        refiner.submit(frame(1), MODEL, PARTICLES).cancel()
        with serving(endpoint, "w"):
            wait_until(lambda: not refiner._client._inbox.empty())  # its coming waits to be handled
            assert refined_bytes(refiner, 2, POSES[:7]) == expected(2, POSES[:7])
        assert refiner.statistics.counts["batches_sent"] == 1


def test_a_search_goes_on_while_others_always_wait(endpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A worker that has always another request serves a spare one, too, wholly."""
    monkeypatch.setenv("SECONDS_PER_PARTICLE", "0.001")
    with pool(endpoint) as refiner, serving(endpoint, "w"):
        refiner.wait_for(1)
        before = refiner.submit(frame(1), MODEL, PARTICLES)
        spare = refiner.submit(frame(1), MODEL, replace(PARTICLES, spare=True))
        for number in range(2, 300):
            after = refiner.submit(frame(number), MODEL, PARTICLES)
            before.result()
            before = after
            if spare.poll():
                break
        assert spare.poll()
        assert as_bytes(spare.result()) == expected(1)


@pytest.mark.parametrize(("lanes", "says"), [(1, "the local worker is not ready yet"), (0, "no worker is")])
def test_runs_that_share_a_pool_say_once_that_it_is_not_ready(
    endpoint: str, lanes: int, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They wait for the pool's local worker, if it has one; the line says where others can connect."""
    monkeypatch.setattr("gepf.coordinator.pool.rpc_client.NOTICE_S", 0.1)
    shared = Pool(lanes, listen="tcp/host:7447", connect="tcp/router:7447", shared_at=endpoint)
    options = replace(shared, worker_timeout=0.6)
    said: list[str] = []
    invitation = "gepf-worker --connect tcp/host:7447"
    with ZenohRefiner(options, said.append) as refiner, pytest.raises(NoWorkers, match=invitation):
        refined_bytes(refiner, 1)
    assert said[0] == "no answer at tcp/router:7447 yet; retrying"
    assert said[1].startswith(says)
    assert len(said) == 2


@contextmanager
def answering(endpoint: str, name: str, answer: Callable[[IncomingRequest], None]) -> Iterator[None]:
    """A client on the bus that pretends to be a worker."""

    def serve(request: IncomingRequest) -> None:
        with request:
            answer(request)

    with open_worker([endpoint]) as bus:
        bus.serve_requests(keys.of_worker(name, "refine/*"), serve)
        bus.announce(keys.offer_key(name, Offer()))
        yield


@pytest.mark.parametrize(
    ("answer", "malformed"),
    [
        (lambda request: request.reply(b"\xc1nonsense"), True),
        (lambda request: request.reply(request.payload), True),
        (lambda request: request.refuse(b"\xc1nonsense"), False),
        (lambda _: None, False),
    ],
    ids=["rubbish", "echo", "odd-error", "silence"],
)
def test_bad_worker_does_not_spoil_the_result(
    endpoint: str, answer: Callable[[IncomingRequest], None], malformed: bool
) -> None:
    """Invalid or missing answers are counted, and other workers do the batches."""
    with pool(endpoint) as refiner, answering(endpoint, "a-liar", answer):
        refiner.wait_for(1)  # the liar is known, and gets work first
        with serving(endpoint, "good"):
            refiner.wait_for(2)
            for number in range(3):
                assert refined_bytes(refiner, number) == expected(number)
        assert (refiner.statistics.counts["replies_malformed"] > 0) == malformed


def test_a_worker_of_another_version_is_named(endpoint: str) -> None:
    """Without other workers the run ends with a line that says what to do; else it continues, same bytes."""
    other = encode_refusal("cannot read it").replace(b"version" + bytes([PROTOCOL]), b"version\x02")
    with pool(endpoint) as refiner, answering(endpoint, "old", lambda request: request.refuse(other)):
        refiner.wait_for(1)
        with pytest.raises(ProtocolError, match=r"version 2, expected .*install the same version of gepf"):
            refiner.submit(frame(1), MODEL, PARTICLES).result()
        with serving(endpoint, "good"):
            refiner.wait_for(2)
            assert refined_bytes(refiner, 2) == expected(2)
        assert refiner.statistics.counts["batches_refused"] > 0


def test_of_many_answers_the_first_counts(endpoint: str) -> None:
    """Repeated answers of a worker are not kept in memory."""

    def chatter(request: IncomingRequest) -> None:
        for number in range(50):
            request.reply(b"%d" % number)

    answers: SimpleQueue[bytes] = SimpleQueue()
    with open_coordinator([endpoint]) as bus, answering(endpoint, "chatterer", chatter):
        alive = threading.Event()
        bus.watch(keys.of_worker("*", "offer/**"), lambda _, there: alive.set() if there else None)
        assert alive.wait(300.0)
        sender = bus.request_sender(keys.of_worker("chatterer", "refine/coordinator"), 5.0)
        for _ in range(3):  # when one is answered, all answers to those before have come
            sender.send(b"", lambda _, answer: answers.put(answer))
            assert answers.get(timeout=300.0) == b"0"
    assert answers.empty()


def test_a_request_that_cannot_be_served_gets_a_reason(endpoint: str) -> None:
    """Rubbish, a run or a frame that is not there, and poses of another model; the next one is served."""
    with pool(endpoint) as refiner, serving(endpoint, "w"), open_worker([endpoint]) as bus:
        refined_bytes(refiner, 1)
        sender = bus.request_sender(keys.of_worker("w", "refine/coordinator"), 10.0)
        came, request = SimpleQueue[tuple[str, bytes]](), replace(REQUEST, run=refiner.run)
        for payload, reason in (
            (b"\xc1nonsense", "not a request message"),
            (encode_request(REQUEST), "frame 1 of run coordinator/ghost is not available"),
            (encode_request(replace(REQUEST, model="0" * 64)), "model 0{12} of run coordinator/ghost is not"),
            (
                encode_request(replace(REQUEST, run="room/ghost")),
                "run room/ghost does not belong to coordinator",
            ),
            (encode_request(replace(request, frame=99)), f"frame 99 of run {refiner.run} is not available"),
            (
                encode_request(replace(request, particles=Particles(POSES[:, :5], SETTINGS))),
                "poses have 5 values, but the model has 6",
            ),
        ):
            sender.send(payload, lambda *how: came.put(how))
            kind, answer = came.get(timeout=300.0)
            assert kind == "refusal"
            assert re.match(reason, decode_refusal(answer).reason)
        assert refined_bytes(refiner, 2) == expected(2)


def test_endpoint_that_cannot_be_opened() -> None:
    """The error names the endpoint, not the transport's sources."""
    with pytest.raises(InputError, match="cannot open nonsense: ") as caught, open_coordinator(["nonsense"]):
        pass
    assert ".rs:" not in str(caught.value)


@pytest.mark.parametrize("name", ["", "a/b", "*", "a b", "@x", "x" * 65, "a\n"])
def test_names_that_cannot_be_keys(name: str) -> None:
    """Names that would break or widen a key are refused before they are used."""
    with pytest.raises(InputError, match="cannot be used"):
        keys.check_name("run", name)
