"""Hostile messages: against the decoders, and over the bus against a live worker and a live coordinator.

`make fuzz` makes a hundred times as many as the tests do otherwise.
"""

from __future__ import annotations

import gc
import itertools
import logging
import re
import time
from collections import Counter
from collections.abc import Callable, Generator
from contextlib import ExitStack, closing, suppress
from dataclasses import replace
from queue import SimpleQueue

import numpy as np
import psutil  # type: ignore[import-untyped]
import pytest

from gepf.common.errors import ProtocolError
from gepf.common.kernel import Kernel
from gepf.common.protocol import keys, messages
from gepf.common.protocol.frames import encode_frame
from gepf.common.protocol.models import decode_model, encode_model
from gepf.common.transport.bus import Bus
from gepf.common.transport.opening import open_worker
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from gepf.coordinator.settings import preset
from gepf.worker.kernel.icp import refine
from gepf.worker.kernel.observation import observe, observe_for
from gepf.worker.service import Service, Task
from gepf.worker.warm_up import tiny_frame, warm_up
from tests.support.extremes import Extremes
from tests.support.messages import KINDS, Mutator
from tests.support.processes.instant_worker import KERNEL
from tests.support.processes.serving import MODEL, REQUEST, expected, refined_bytes, running, serving

Messages = Generator[str, None, None]  # what became of each

LIARS = 3
LOOKS = 10  # at the memory
ATTEMPTS = 5  # at what a busy machine may spoil, as links get lost and are found again
LONGEST = 60.0  # seconds for one message, on a busy machine
GROWTH = 24 * 2**20  # bytes that the second half of a test may add
HONEST = [kind.payload for kind in KINDS.values()]
HASHES = re.compile(rb"names the hash ([0-9a-f]{64}), but its content has ([0-9a-f]{64})")
NOT_OURS = "could not refine"  # begins a refusal by anything but an error of our own tree
PRESETS = (preset("paper").refine, preset("default").refine)


def to_decoders(endpoint: str) -> Messages:
    """Decode hostile messages of every kind; what is not accepted must be refused by ProtocolError."""
    del endpoint
    mutator = Mutator(1, HONEST)
    for name in itertools.cycle(KINDS):
        payload = mutator.mutate(KINDS[name].payload)
        payload = heal_hash(payload) if name == "model" else payload
        try:
            KINDS[name].decode(payload)
            yield "accepted"
        except ProtocolError:
            yield "refused"


def to_kernel(endpoint: str) -> Messages:
    """Refine extreme requests that decoders accept; a coordinator must accept each answer."""
    del endpoint
    extremes = Extremes(0)
    warm_up(Kernel(observe_for, refine))
    while True:
        case = extremes.accepted(1)[0]
        refined = refine(case.model, observe(case.frame), replace(case.request.particles, covariance=True))
        messages.decode_refined(
            messages.encode_refined(refined), case.request.particles.poses.shape, covariance=True
        )
        yield "served" if np.isfinite(refined.log_likelihood).all() else "served without a likelihood"


def heal_hash(payload: bytes) -> bytes:
    """A changed model with its new hash, so that not only the hash gives it away."""
    try:
        decode_model(payload)
    except ProtocolError as error:
        found = HASHES.search(str(error).encode())
        return payload.replace(found[1], found[2]) if found else payload
    return payload


class Villain:
    """A coordinator that asks a worker for impossible things, over the bus."""

    def __init__(self, bus: Bus, worker: str) -> None:
        self._mutator = Mutator(1, HONEST)
        self._answers: SimpleQueue[tuple[str, bytes]] = SimpleQueue()
        self._sender = bus.request_sender(keys.of_worker(worker, "refine/evil"), LONGEST)
        self._models = {MODEL.hash: encode_model(MODEL)}
        self._publisher = bus.publish(keys.of_run("evil/run", "frame"))
        self._frames: dict[str, bytes] = {}
        self.honest = replace(REQUEST, run="evil/run", frame=0, particles=REQUEST.particles.part(0, 3))
        bus.serve(keys.of_run("evil/run", "model/*"), lambda key: self._models.get(keys.last_of(key)))
        bus.serve(keys.of_run("evil/run", "frame/*"), lambda key: self._frames.get(keys.last_of(key)))
        self._publish(encode_frame(tiny_frame()))

    def _publish(self, payload: bytes) -> None:
        """Send a frame under the next number."""
        self.honest = replace(self.honest, frame=self.honest.frame + 1)
        self._frames = {str(self.honest.frame): payload}
        self._publisher.put(payload)

    def attack(self, k: int) -> tuple[str, bytes]:
        """One hostile request, frame or model; gives how the worker answered."""
        settings = PRESETS[k // 3 % len(PRESETS)]
        self.honest = replace(self.honest, particles=replace(self.honest.particles, settings=settings))
        match k % 3:
            case 0:
                return self.ask(self._mutator.mutate(messages.encode_request(self.honest)))
            case 1:
                self._publish(self._mutator.mutate(encode_frame(tiny_frame())))
                answer = self.ask(messages.encode_request(self.honest))
                self._publish(encode_frame(tiny_frame()))
                return answer
            case _:
                payload, name = heal_hash(self._mutator.mutate(encode_model(MODEL))), f"{k:064x}"
                with suppress(ProtocolError):
                    name = decode_model(payload).hash
                self._models = {MODEL.hash: encode_model(MODEL), name: payload}
                return self.ask(messages.encode_request(replace(self.honest, model=name)))

    def ask(self, payload: bytes) -> tuple[str, bytes]:
        """Send a request and wait for its answer; ProtocolError if no coordinator would take it."""
        for _ in range(ATTEMPTS):
            self._sender.send(payload, lambda ending, answer: self._answers.put((ending, answer)))
            outcome, answer = self._answers.get(timeout=2 * LONGEST)
            if outcome == "reply":
                asked = messages.decode_request(payload).particles
                messages.decode_refined(answer, asked.poses.shape, covariance=asked.covariance)
            if outcome != "nothing":
                return outcome, answer
            time.sleep(1.0)
        raise AssertionError("a request was left without an answer")


def to_worker(endpoint: str) -> Messages:
    """Ask a live worker with the real kernel; it must answer all, and each refusal is of our own tree."""
    kernel = Kernel(observe_for, refine)
    warm_up(kernel)
    with (
        ZenohRefiner(Pool(workers=0, listen=endpoint)) as refiner,
        serving(endpoint, "victim", kernel),
        open_worker([endpoint]) as bus,
    ):
        refiner.wait_for(1)
        villain = Villain(bus, "victim")
        for k in itertools.count():
            outcome, answer = villain.attack(k)
            assert outcome == "reply" or not messages.decode_refusal(answer).reason.startswith(NOT_OURS)
            if k % 10 == 0:
                assert villain.ask(messages.encode_request(villain.honest))[0] == "reply"
            yield outcome


class Liar(Service):
    """A worker that is honest often enough to be used further: two of three answers are invalid."""

    def __init__(self, bus: Bus, name: str, seed: int, heard: Counter[str]) -> None:
        super().__init__(bus, name, KERNEL)
        self._mutator = Mutator(seed, HONEST)
        self._heard = heard

    def serve(self, run: str, task: Task, most: int | None = None, *, spare: bool = False) -> None:
        """Answer one request."""
        if task.asked is None or task.request is None:
            super().serve(run, task, most, spare=spare)
            return
        asked, request = task.asked, task.request
        with request:
            turn = self._heard.total() if self._heard["honest answers"] else 0
            try:
                honest = messages.encode_refined(self.answer(asked))
            except ProtocolError as error:  # the frame is over, and others refined it
                request.refuse(messages.encode_refusal(str(error)))
                return
            if turn % 3 == 0:
                self._heard["honest answers"] += 1
                request.reply(honest)
            elif turn % 30 == 1:
                self._heard["false refusals"] += 1
                request.refuse(self._mutator.mutate(messages.encode_refusal("no")))
            else:
                self._heard["lies"] += 1
                request.reply(self._nonsense(honest, asked.particles.poses.shape))

    def _nonsense(self, honest: bytes, asked: tuple[int, ...]) -> bytes:
        """The honest answer, mutated until it is none."""
        while True:
            answer = self._mutator.mutate(honest)
            try:
                messages.decode_refined(answer, asked)
            except ProtocolError:
                return answer


def to_coordinator(endpoint: str) -> Messages:
    """Send false replies to a coordinator; each frame still has its bytes."""
    said: list[str] = []
    heard: list[Counter[str]] = [Counter() for _ in range(LIARS)]
    told = 0
    with ExitStack() as stack:
        options = Pool(workers=0, listen=endpoint, worker_timeout=LONGEST)
        refiner = stack.enter_context(ZenohRefiner(options, said.append))
        for k, counter in enumerate(heard):
            bus = stack.enter_context(open_worker([endpoint]))
            stack.enter_context(running(Liar(bus, f"liar-{k}", k, counter), LONGEST))
        stack.enter_context(serving(endpoint, "honest"))
        for number in itertools.cycle(range(1000)):
            assert refined_beside_liars(refiner, said, number) == expected(number)
            lies = sum(each["lies"] + each["false refusals"] for each in heard)
            yield from ["lied"] * (lies - told)
            told = lies


def refined_beside_liars(refiner: ZenohRefiner, said: list[str], number: int) -> list[bytes]:
    """A frame's bytes; asked for again if the honest worker was away meanwhile."""

    def comings_and_goings() -> list[str]:
        return [line for line in said if "worker honest" in line]

    for _ in range(ATTEMPTS):
        refiner.wait_for(LIARS + 1)
        before = comings_and_goings()
        try:
            return refined_bytes(refiner, number)
        except ProtocolError:
            if comings_and_goings() == before:
                raise
    raise AssertionError("the honest worker was away again and again")


@pytest.mark.parametrize("times", [1, pytest.param(100, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("part", "count", "seen"),
    [
        (to_decoders, 2000, {"accepted", "refused"}),
        (to_kernel, 60, {"served", "served without a likelihood"}),
        (to_worker, 100, {"reply", "refusal"}),
        (to_coordinator, 50, {"lied"}),
    ],
)
def test_hostile_messages_do_no_harm(
    part: Callable[[str], Messages],
    count: int,
    seen: set[str],
    times: int,
    endpoint: str,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Only errors of our own classes, no missing answer, no growth of memory, and the right bytes."""
    outcomes: Counter[str] = Counter()
    memory = list[int]()
    caplog.set_level(logging.CRITICAL)  # each refusal is a warning, and would be kept
    gc.freeze()  # what was loaded stays; no need to look through it each time
    with closing(part(endpoint)) as hostile:
        for k in range(times * count):
            began = time.monotonic()
            outcomes[next(hostile)] += 1
            assert time.monotonic() - began < LONGEST
            if k % (times * count // LOOKS) == 0:
                gc.collect()
                memory.append(psutil.Process().memory_info().rss)
    assert memory[-1] - memory[LOOKS // 2] < GROWTH, memory
    assert set(outcomes) == seen
