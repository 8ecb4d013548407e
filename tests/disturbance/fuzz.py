"""Hostile messages: against the decoders, and over the bus against a live worker and coordinator.

`python -m tests.disturbance.fuzz` makes 200 000 and twice 10 000, prints what became of them, and fails if
one brought anything but an error of our own tree, if one took long, or if memory grew. Between them the
kernel computes 2 000 requests that are as extreme as decoders let through. `--seed` repeats a run.
"""

from __future__ import annotations

import argparse
import gc
import logging
import re
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np
import psutil  # type: ignore[import-untyped]

from common.errors import ProtocolError
from common.protocol import keys
from common.protocol.frames import encode_frame
from common.protocol.messages import (
    RefineRequest,
    decode_refined,
    decode_refusal,
    decode_request,
    encode_refined,
    encode_refusal,
    encode_request,
)
from common.protocol.models import decode_model, encode_model
from common.settings import RefineSettings, preset
from common.transport.bus import Bus
from common.transport.channels import FramePublisher
from common.transport.opening import open_worker
from coordinator.pool.options import Pool
from coordinator.pool.zenoh_refiner import ZenohRefiner
from tests.support.extremes import Extremes
from tests.support.messages import KINDS, Mutator
from tests.support.processes.instant_worker import KERNEL
from tests.support.processes.serving import MODEL, POSES, expected, refined_bytes, running, serving
from worker.kernel.icp import refine
from worker.kernel.observation import observe
from worker.service import Batch, Kernel, Service
from worker.warm_up import tiny_frame, warm_up

DECODED, LIVE, EXTREME = 200_000, 10_000, 2_000
LIARS = 3
LOOKS = 10  # at the memory
ATTEMPTS = 5  # at a request that ends without an answer
LONGEST = 60.0  # seconds for one message, on a busy machine
GROWTH = 24 * 2**20  # bytes that the second half of a run may add
HONEST = [kind.payload for kind in KINDS.values()]
HASHES = re.compile(rb"names the hash ([0-9a-f]{64}) and has ([0-9a-f]{64})")
NOT_OURS = "could not refine"  # begins a refusal by anything but an error of our own tree
PRESETS = (preset("paper").refine, preset("default").refine)


@dataclass(slots=True)
class Report:
    """What became of the messages."""

    outcomes: Counter[str] = field(default_factory=Counter)
    slowest: float = 0.0  # seconds
    memory: list[int] = field(default_factory=list)  # resident bytes, now and then

    @contextmanager
    def timed(self) -> Iterator[None]:
        """One message."""
        began = time.monotonic()
        yield
        self.slowest = max(self.slowest, time.monotonic() - began)

    def weigh(self) -> None:
        """Look at the memory of this process."""
        gc.collect()
        self.memory.append(psutil.Process().memory_info().rss)

    @property
    def growth(self) -> int:
        """Bytes from the middle of the run to its end."""
        return self.memory[-1] - self.memory[len(self.memory) // 2]

    def check(self) -> None:
        """AssertionError if it was not as it must be."""
        assert self.slowest < LONGEST, f"one message took {self.slowest:.1f} s"
        assert self.growth < GROWTH, f"memory grew by {self.growth / 2**20:.0f} MiB: {self.memory}"

    def __str__(self) -> str:
        made = ", ".join(f"{count} {outcome}" for outcome, count in sorted(self.outcomes.items()))
        megabytes = " ".join(f"{size / 2**20:.0f}" for size in self.memory)
        return f"{made}; slowest {self.slowest * 1000:.0f} ms; resident MiB: {megabytes}"


def fuzz_decoders(count: int, seed: int) -> Report:
    """Decode hostile messages of every kind; what is not accepted must be refused by ProtocolError."""
    report, mutator = Report(), Mutator(seed, HONEST)
    kinds = list(KINDS)
    for k in range(count):
        kind = kinds[k % len(kinds)]
        payload = mutator.mutate(KINDS[kind].payload)
        payload = heal_hash(payload) if kind == "model" else payload
        with report.timed():
            try:
                KINDS[kind].decode(payload)
                report.outcomes["accepted"] += 1
            except ProtocolError as error:
                report.outcomes[f"refused for {fault(str(error))}"] += 1
        if k % max(1, count // LOOKS) == 0:
            report.weigh()
    report.weigh()
    return report


def fault(reason: str) -> str:
    """What is wrong with a message: it is none, it is another one, or what it holds makes no sense."""
    if reason.startswith("not a "):
        return "their form"
    return "their version" if "protocol version" in reason else "their content"


def fuzz_kernel(count: int, seed: int) -> Report:
    """Refine what decoders accept and nobody would send; each answer must be one that a coordinator takes."""
    report, extremes = Report(), Extremes(seed)
    warm_up(Kernel(observe, refine))
    for k in range(count):
        case = extremes.accepted(1)[0]
        with report.timed():
            refined = refine(
                case.model, observe(case.frame), case.request.poses, case.request.settings, covariance=True
            )
        decode_refined(encode_refined(refined), case.request.poses.shape, covariance=True)
        explained = np.isfinite(refined.log_likelihood).all()
        report.outcomes["served" if explained else "served without a likelihood"] += 1
        if k % max(1, count // LOOKS) == 0:
            report.weigh()
    report.weigh()
    return report


def heal_hash(payload: bytes) -> bytes:
    """A changed model with its new hash, so that not only the hash gives it away."""
    try:
        decode_model(payload)
    except ProtocolError as error:
        found = HASHES.search(str(error).encode())
        return payload.replace(found[1], found[2]) if found else payload
    return payload


def hash_of(payload: bytes) -> str | None:
    """The hash of a model that is one."""
    try:
        return decode_model(payload).hash
    except ProtocolError:
        return None


class Villain:
    """A coordinator that asks a worker for impossible things, over the bus."""

    def __init__(self, bus: Bus, worker: str, seed: int) -> None:
        self._mutator = Mutator(seed, HONEST)
        self._answers: SimpleQueue[tuple[str, bytes]] = SimpleQueue()
        self._sender = bus.request_sender(keys.worker_refine(worker), LONGEST)
        self._models = {MODEL.hash: encode_model(MODEL)}
        self._publisher: FramePublisher = bus.publish_frames(keys.run_frames("evil"))
        self._frames: dict[str, bytes] = {}
        self._frame = 0
        self._honest = RefineRequest("evil", 0, MODEL.hash, RefineSettings(), POSES[:3])
        bus.serve(keys.run_model("evil", "*"), lambda key: self._models.get(keys.last_of(key)))
        bus.serve(keys.run_frame("evil", "*"), lambda key: self._frames.get(keys.last_of(key)))
        self.publish(encode_frame(tiny_frame()))

    def publish(self, payload: bytes) -> None:
        """Send a frame under the next number."""
        self._frame += 1
        self._frames = {str(self._frame): payload}
        self._publisher.put(self._frame, payload)
        self._honest = replace(self._honest, frame=self._frame)

    def honest(self) -> bytes:
        """A request that can be served."""
        return encode_request(self._honest)

    def attack(self, k: int) -> tuple[str, bytes]:
        """One hostile request, frame or model; gives how the worker answered."""
        self._honest = replace(self._honest, settings=PRESETS[k // 3 % len(PRESETS)])
        match k % 3:
            case 0:
                return self.ask(self._mutator.mutate(self.honest()))
            case 1:
                self.publish(self._mutator.mutate(encode_frame(tiny_frame())))
                answer = self.ask(self.honest())
                self.publish(encode_frame(tiny_frame()))
                return answer
            case _:
                payload = heal_hash(self._mutator.mutate(encode_model(MODEL)))
                name = hash_of(payload) or f"{k:064x}"
                self._models = {MODEL.hash: encode_model(MODEL), name: payload}
                return self.ask(encode_request(replace(self._honest, model_hash=name)))

    def ask(self, payload: bytes) -> tuple[str, bytes]:
        """Send a request and wait for its answer, or give up if there is none again and again.

        Raises ProtocolError for an answer that no coordinator would take.
        """
        for _ in range(ATTEMPTS):
            self._sender.send(
                payload,
                on_reply=lambda answer: self._answers.put(("served", answer)),
                on_refusal=lambda answer: self._answers.put(("refused", answer)),
                on_end=lambda: self._answers.put(("ended", b"")),
            )
            outcome, answer = self._answers.get(timeout=2 * LONGEST)
            if outcome == "served":
                request = decode_request(payload)
                decode_refined(answer, request.poses.shape, covariance=request.covariance)
            if outcome != "ended":
                return outcome, answer
            time.sleep(1.0)  # a machine that is too busy loses links, and finds them again
        raise AssertionError("a request was left without an answer")


def fuzz_worker(count: int, seed: int) -> Report:
    """Ask a live worker with the real kernel; it must answer all, and each refusal is of our own tree."""
    report = Report()
    kernel = Kernel(observe, refine)
    warm_up(kernel)
    with (
        meeting_place() as place,
        ZenohRefiner(Pool(workers=0, listen=place)) as refiner,
        serving(place, "victim", kernel),
        open_worker([place]) as bus,
    ):
        refiner.wait_for(1)
        villain = Villain(bus, "victim", seed)
        for k in range(count):
            if k % max(1, count // LOOKS) == 0:
                report.weigh()
            with report.timed():
                outcome, answer = villain.attack(k)
            if outcome == "refused":
                reason = decode_refusal(answer).reason
                assert not reason.startswith(NOT_OURS), reason
                outcome = f"refused for {fault(reason)}"
            report.outcomes[outcome] += 1
        assert villain.ask(villain.honest())[0] == "served"
        report.weigh()
    return report


class Liar(Service[float]):
    """A worker who is honest just often enough to be asked on: two of three answers are nonsense."""

    def __init__(self, bus: Bus, name: str, seed: int, heard: Counter[str]) -> None:
        super().__init__(bus, name, KERNEL)
        self._mutator = Mutator(seed, HONEST)
        self._heard = heard

    def serve(self, batch: Batch) -> None:
        """Answer one batch."""
        turn = sum(self._heard.values()) if self._heard["honest answers"] else 0
        try:
            honest = self.answer(batch.content)
        except ProtocolError as error:  # the frame is over, and others refined it
            batch.request.refuse(encode_refusal(str(error)))
            return
        if turn % 3 == 0:
            self._heard["honest answers"] += 1
            batch.request.reply(honest)
        elif turn % 30 == 1:
            self._heard["false refusals"] += 1
            batch.request.refuse(self._mutator.mutate(encode_refusal("no")))
        else:
            self._heard["lies"] += 1
            batch.request.reply(self._nonsense(honest, batch.content.poses.shape))

    def _nonsense(self, honest: bytes, asked: tuple[int, ...]) -> bytes:
        """The honest answer, mutated until it is none."""
        while True:
            answer = self._mutator.mutate(honest)
            try:
                decode_refined(answer, asked)
            except ProtocolError:
                return answer


def fuzz_coordinator(count: int, seed: int) -> Report:
    """Lie to a live coordinator until it has heard `count` lies; each frame still ends with its bytes."""
    report, number, said = Report(), 0, list[str]()
    heard: list[Counter[str]] = [Counter() for _ in range(LIARS)]
    with ExitStack() as stack:
        place = stack.enter_context(meeting_place())
        options = Pool(workers=0, listen=place, worker_timeout=LONGEST)
        refiner = stack.enter_context(ZenohRefiner(options, said.append))
        for k, counter in enumerate(heard):
            bus = stack.enter_context(open_worker([place]))
            stack.enter_context(running(Liar(bus, f"liar-{k}", seed + k, counter), LONGEST))
        stack.enter_context(serving(place, "honest"))
        refiner.wait_for(LIARS + 1)
        while (found := sum(c["lies"] + c["false refusals"] for c in heard)) < count:
            if found >= len(report.memory) * count / LOOKS:
                report.weigh()
            number += 1
            with report.timed():
                assert refined_beside_liars(refiner, said, number % 1000) == expected(number % 1000)
        report.outcomes = sum(heard, Counter({"frames with their own bytes": number}))
        report.outcomes["counted as malformed"] = refiner.statistics.replies_malformed
        report.weigh()
    return report


def refined_beside_liars(refiner: ZenohRefiner, said: list[str], number: int) -> bytes:
    """A frame's bytes; asked for again if the honest worker was away, as a busy machine loses links.

    Raises ProtocolError if it was there all the time, or is away again and again.
    """
    for _ in range(ATTEMPTS):
        refiner.wait_for(LIARS + 1)
        before = of_the_honest(said)
        try:
            return refined_bytes(refiner, number)
        except ProtocolError:
            if of_the_honest(said) == before:
                raise
    return refined_bytes(refiner, number)


def of_the_honest(said: list[str]) -> list[str]:
    """When the honest worker joined and left."""
    return [line for line in said if "worker honest" in line]


@contextmanager
def meeting_place() -> Iterator[str]:
    """An endpoint of this process."""
    with tempfile.TemporaryDirectory(prefix="gepf-fuzz-") as folder:
        yield f"unixsock-stream/{Path(folder) / 'bus'}"


def main(arguments: list[str] | None = None) -> int:
    """Do all and print a line each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--decoded", type=int, default=DECODED)
    parser.add_argument("--extreme", type=int, default=EXTREME)
    parser.add_argument("--live", type=int, default=LIVE)
    options: Any = parser.parse_args(arguments)
    logging.disable(logging.WARNING)  # each refusal is one
    gc.freeze()  # what was loaded stays; no need to look through it each time
    parts = (
        ("decoders", fuzz_decoders, options.decoded),
        ("kernel", fuzz_kernel, options.extreme),
        ("live worker", fuzz_worker, options.live),
        ("live coordinator", fuzz_coordinator, options.live),
    )
    for name, part, count in parts:
        began = time.monotonic()
        report = part(count, options.seed)
        sys.stdout.write(f"{name}: {count} messages in {time.monotonic() - began:.0f} s: {report}\n")
        sys.stdout.flush()
        report.check()
    return 0


if __name__ == "__main__":
    sys.exit(main())
