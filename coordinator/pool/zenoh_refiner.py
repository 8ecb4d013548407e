"""Refinement by whatever workers there are on the bus: fills the tracker's port."""

from __future__ import annotations

import math
import time
import uuid
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.frame import SubjectFrame
from common.protocol import keys
from common.protocol.messages import RefineRequest
from common.refinement import Refined
from common.settings import RefineSettings
from common.transport.channels import Publisher
from common.transport.endpoints import LOCAL, protocol_of
from common.transport.opening import open_coordinator
from coordinator.pool.local_workers import LocalWorkers, private_folder
from coordinator.pool.options import NoWorkerTimeout, Pool, PoolStatistics
from coordinator.pool.publication import Publication
from coordinator.pool.rpc_client import Refinement, RpcClient
from coordinator.tracking.loop import Stopwatch

LINK_WAIT_S = 0.05  # for a link that is there already


@dataclass(frozen=True, slots=True, eq=False)
class PendingRefinement:
    """A request that is with the workers."""

    client: RpcClient
    refinement: Refinement
    clock: Stopwatch

    def result(self) -> Refined:
        """Wait for the particles in the order given; NaN for those that are unanswered when they are due.

        Raises NoWorkers when the wait for a worker is over, ProtocolError when no worker can serve the
        request, BusError when the transport fails or local workers do not start.
        """
        with self.clock.stage("refine"):
            self.client.finish(self.refinement)
            return self.refinement.gather()


class ZenohRefiner:
    """Has particles refined by whatever workers there are; a context manager.

    Results come in the order of the particles and do not depend on who made them. `report` is called with
    a line for people when workers come, go, or are missing.
    """

    def __init__(self, pool: Pool, report: Callable[[str], None] = lambda _: None) -> None:
        self.run = keys.check_name("run", pool.run or uuid.uuid4().hex[:12])
        self._pool = pool
        self._report = report
        self._stack = ExitStack()
        self._clock = Stopwatch()
        self._lost_links: set[str] = set()
        self._due = math.inf  # when the frame must do with the particles that are answered

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            folder = Path(stack.enter_context(private_folder()))
            local = f"{LOCAL}/{folder / 'bus'}"
            pool = self._pool
            own = [local] if pool.lanes else []
            self._bus = stack.enter_context(
                open_coordinator([*own, *pool.listen_endpoints], pool.connect_endpoints, pool.security)
            )
            where = (pool.requested or pool).connect
            if where and not self._bus.is_linked(within=LINK_WAIT_S):
                self._report(f"nobody answers at {where} yet; trying on")
            if pool.connect and not pool.listen and not pool.requested:
                self._bus.watch_links(self._report_link)
            self._publication = Publication(self._bus, self.run)
            self._bus.announce(keys.run_alive(self.run))
            self._local = LocalWorkers(pool, f"{self.run}-0", local, folder)
            stack.callback(self._local.stop)
            self._client = RpcClient(self._bus, self._local, NoWorkerTimeout(pool), self._report)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def _report_link(self, endpoint: str, linked: bool) -> None:
        """Report that a router goes, and is back; called on a thread of the bus."""
        if protocol_of(endpoint) == LOCAL:  # to a worker of our own
            return
        if not linked:
            self._lost_links.add(endpoint)
            self._report(f"{endpoint} is gone; trying to reach it again")
        elif endpoint in self._lost_links:
            self._lost_links.remove(endpoint)
            self._report(f"{endpoint} is back")

    @property
    def statistics(self) -> PoolStatistics:
        """What has gone over the bus so far."""
        counts = self._client.scheduler.counts
        return PoolStatistics(
            workers_seen=tuple(sorted(self._client.seen)),
            local_workers_restarted=self._local.restarted,
            batches_sent=counts.batches_sent,
            batches_sent_again=counts.batches_sent_again,
            batches_refused=counts.batches_refused,
            replies_malformed=self._client.malformed,
            stage_seconds=dict(self._clock.seconds),
        )

    @property
    def local_pids(self) -> dict[str, int]:
        """Process ids of our own workers by name."""
        return {worker.name: worker.process.pid for worker in self._local.workers.values()}

    def wait_for(self, lanes: int) -> None:
        """Wait until there are workers with so many lanes. Raises as the result of `submit` does."""
        while self._client.lanes < lanes:
            self._client.step()

    def listen(self, key: str, on_message: Callable[[bytes], None]) -> None:
        """Have `on_message(payload)` called, on a thread of the bus, for what others publish."""
        self._bus.subscribe(key, on_message)

    def speak(self, key: str) -> Publisher:
        """Where to put what others are to hear on a key."""
        return self._bus.publish(key)

    def publish(self, subject: SubjectFrame) -> None:
        """Send a frame to all workers; all later calls of `submit` are about it."""
        with self._clock.stage("publish"):
            self._publication.put(subject)
            if self._pool.deadline is not None:
                self._due = time.monotonic() + self._pool.deadline

    def send_ahead(self, subject: SubjectFrame) -> None:
        """Send the frame that is to be published next, so that workers have it in time."""
        self._publication.put_ahead(subject)

    def submit(
        self,
        model: BodyModel,
        poses: NDArray[np.float64],
        settings: RefineSettings,
        *,
        covariance: bool = False,
    ) -> PendingRefinement:
        """Send poses (N, D) to the workers. A request whose result was not taken by then is given up."""
        if len(poses) == 0:
            raise ValueError("there is nothing to refine")
        with self._clock.stage("refine"):
            self._publication.offer(model)
            request = RefineRequest(
                self.run, self._publication.current, model.hash, settings, poses, covariance
            )
            refinement = Refinement(request, self._due)
            self._client.begin(refinement)
        return PendingRefinement(self._client, refinement, self._clock)
