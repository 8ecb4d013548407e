"""Refinement by workers on the bus."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable, Collection
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import replace
from pathlib import Path

from gepf.common.body import BodyModel
from gepf.common.closing import Closing
from gepf.common.errors import BusError, InputError
from gepf.common.frame import SubjectFrame
from gepf.common.protocol import keys
from gepf.common.protocol.frames import encode_frame
from gepf.common.protocol.messages import RefineRequest
from gepf.common.protocol.models import encode_model
from gepf.common.recent import FRAMES_KEPT, MODELS_KEPT, put_recent
from gepf.common.refinement import Particles
from gepf.common.transport.admission import is_seen
from gepf.common.transport.bus import Bus
from gepf.common.transport.channels import Publisher
from gepf.common.transport.endpoints import LOCAL, protocol_of
from gepf.common.transport.opening import open_coordinator, private_folder
from gepf.common.transport.session import COORDINATOR, holder_name
from gepf.coordinator.pool.local_worker import LocalWorker
from gepf.coordinator.pool.options import Pool, PoolStatistics
from gepf.coordinator.pool.rpc_client import Refinement, RpcClient
from gepf.coordinator.tracking.refiner import Refiner


class Publication:
    """The published frames and models of one run. Threads of the bus read it."""

    def __init__(self, bus: Bus, run: str) -> None:
        self._number = -1  # of the last sent frame
        self._lock = threading.Lock()
        # By number, each with its message; the most recently used is last.
        self._frames: dict[int, tuple[SubjectFrame, bytes]] = {}
        self._models: dict[str, bytes] = {}  # by hash
        bus.serve(keys.of_run(run, "frame/*"), self._find_frame)
        bus.serve(keys.of_run(run, "model/*"), self._find_model)
        bus.serve(keys.of_run(run, "present"), lambda _: b"")
        self._publisher = bus.publish(keys.of_run(run, "frame"))

    def put(self, subject: SubjectFrame, needed: Collection[int] = ()) -> int:
        """Send a frame with its number, or with the next free one if that is taken; returns the number.

        A frame that was sent recently is not sent again. Recent frames and the `needed` ones are kept.
        """
        number = next((n for n, (sent, _) in self._frames.items() if sent is subject), None)
        if number is not None:
            with self._lock:
                put_recent(self._frames, number, self._frames[number], FRAMES_KEPT, needed)
            return number
        self._number = max(subject.number, self._number + 1)
        payload = encode_frame(replace(subject, number=self._number))
        with self._lock:
            put_recent(self._frames, self._number, (subject, payload), FRAMES_KEPT, needed)
        self._publisher.put(payload)
        return self._number

    def offer(self, model: BodyModel) -> None:
        """Keep a model for workers that fetch it."""
        with self._lock:
            known = self._models.get(model.hash)
            put_recent(self._models, model.hash, known or encode_model(model), MODELS_KEPT)

    def _find_frame(self, key: str) -> bytes | None:
        with self._lock:
            number = keys.last_of(key)
            return next((payload for n, (_, payload) in self._frames.items() if str(n) == number), None)

    def _find_model(self, key: str) -> bytes | None:
        with self._lock:
            return self._models.get(keys.last_of(key))


class ZenohRefiner(Refiner, Closing):
    """Refines particles with the workers on the bus; a context manager.

    Results are in the order of the particles and do not depend on the workers. `report` is called with a
    message for the user when workers join, leave, or are missing.
    """

    def __init__(self, pool: Pool, report: Callable[[str], None] = lambda _: None) -> None:
        name = keys.check_name("run", pool.run or uuid.uuid4().hex[:12])
        holder = holder_name(pool.security) or COORDINATOR
        self.run = f"{holder}/{name}"
        self._pool = pool
        self._report = report
        self._lost_links: set[str] = set()
        with ExitStack() as stack:
            folder = Path(stack.enter_context(private_folder()))
            local = f"{LOCAL}/{folder / 'bus'}"
            if pool.shared_at:
                self._bus = stack.enter_context(open_coordinator([], [pool.shared_at]))
            else:
                own = [local] if pool.lanes else []
                self._bus = stack.enter_context(
                    open_coordinator([*own, *pool.listen_endpoints], pool.connect_endpoints, pool.security)
                )
            if pool.connect and not self._bus.is_linked():
                report(f"no answer at {pool.connect} yet; retrying")
            if pool.connect and not pool.listen and not pool.shared_at:
                self._bus.watch_links(self._report_link)
            self._publication = Publication(self._bus, self.run)
            if pool.security is not None and not pool.shared_at:
                check_admission(self._bus, holder, pool)
            self._bus.announce(keys.of_run(self.run, "alive"))
            of_our_own = replace(pool, workers=0) if pool.shared_at else pool
            self._local = LocalWorker(of_our_own, f"{name}-0", self._bus, local, folder)
            stack.callback(self._local.stop)
            self._client = RpcClient(self._bus, self.run, pool, self._local, report)
            self._stack = stack.pop_all()

    def close(self) -> None:
        """Stop the local worker, and leave the bus."""
        self._stack.close()

    def _report_link(self, endpoint: str, linked: bool) -> None:
        """Report that a router is lost or back; called on a thread of the bus."""
        if protocol_of(endpoint) == LOCAL:  # to the local worker
            return
        if not linked:
            self._lost_links.add(endpoint)
            self._report(f"{endpoint} is gone; trying to reach it again")
        elif endpoint in self._lost_links:
            self._lost_links.remove(endpoint)
            self._report(f"{endpoint} is back")

    @property
    def statistics(self) -> PoolStatistics:
        """Statistics of the run so far."""
        client, scheduler = self._client, self._client.scheduler
        return PoolStatistics(
            workers_seen=tuple(sorted(client.seen)),
            counts={
                "local_workers_restarted": self._local.restarted,
                "batches_sent": scheduler.sent,
                "batches_sent_again": scheduler.sent_again,
                "batches_refused": scheduler.refused,
                "replies_malformed": client.malformed,
            },
            processors=tuple(sorted(set(client.seen.values()))),
        )

    @property
    def local_pid(self) -> int:
        """Process id of the local worker; 0 without one."""
        return 0 if self._local.process is None else self._local.process.pid

    def wait_for(self, lanes: int) -> None:
        """Wait for workers with this number of lanes. Raises the same errors as the result of `submit`."""
        while self._client.lanes < lanes:
            self._client.step()

    def listen(self, key: str, on_message: Callable[[bytes], None]) -> None:
        """Call `on_message(payload)`, on a thread of the bus, for each message on a key."""
        self._bus.subscribe(key, lambda _, payload: on_message(payload))

    def speak(self, key: str) -> Publisher:
        """A publisher for a key."""
        return self._bus.publish(key)

    def publish(self, subject: SubjectFrame) -> None:
        """Send a frame to the workers of this run, so that they have it when its particles are submitted."""
        self._publication.put(subject, self._client.frames)

    def submit(self, subject: SubjectFrame, model: BodyModel, particles: Particles) -> Refinement:
        """Send particles to the workers, to be refined on a frame."""
        if len(particles.poses) == 0:
            raise ValueError("there is nothing to refine")
        self._publication.offer(model)
        number = self._publication.put(subject, self._client.frames)
        return self._client.begin(RefineRequest(self.run, number, model.hash, particles))


def check_admission(bus: Bus, holder: str, pool: Pool) -> None:
    """InputError if a router that answers does not admit a coordinator of this name."""

    def give_up() -> None:
        raise BusError("no answer")

    key = keys.of_run(holder, "admission")
    bus.announce(key)
    with suppress(BusError):  # a router that comes later cannot be asked
        if pool.connect and not is_seen(key, pool.connect_endpoints, pool.security, give_up):
            line = f"{pool.connect} does not admit coordinator '{holder}'; have it listed there"
            raise InputError(f"{line} in coordinators.txt")


Connect = Callable[[Pool, Callable[[str], None]], AbstractContextManager[ZenohRefiner]]
"""Opens a pool, usually `ZenohRefiner`; its second argument is called with messages for the user."""
