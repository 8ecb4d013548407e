"""Workers that are connected and do not answer: a run reconnects and continues."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count, takewhile
from pathlib import Path

import msgspec
import numpy as np
import pytest
from rich.console import Console

from gepf.common.body import BodyModel
from gepf.common.errors import SilentWorkers
from gepf.common.frame import SubjectFrame
from gepf.common.offer import Offer
from gepf.common.protocol import keys
from gepf.common.protocol.frames import LIVE_END, encode_live
from gepf.common.refinement import Particles
from gepf.common.transport.channels import IncomingRequest
from gepf.common.transport.opening import open_router, open_worker
from gepf.coordinator.cli import main
from gepf.coordinator.commands.job import Job
from gepf.coordinator.commands.progress import Show
from gepf.coordinator.commands.track import track
from gepf.coordinator.filters.methods import settings_for
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.rpc_client import Refinement
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from gepf.coordinator.results.live_results import END, KIND
from gepf.coordinator.results.track import read_track
from tests.support.live import KEY as CAMERA_KEY
from tests.support.live import at_work, listening, plate_image, publishing, tracking
from tests.support.processes.programs import INSTANT, wait_until
from tests.support.processes.serving import MODEL, PARTICLES, frame
from tests.support.stand_ins import sequence  # noqa: F401 fixture


class FallsSilent(ZenohRefiner):
    """Real workers whose connection fails after a number of requests."""

    def __init__(self, pool: Pool, report: Callable[[str], None], requests: int) -> None:
        super().__init__(pool, report)
        self._left = requests

    def submit(self, subject: SubjectFrame, model: BodyModel, particles: Particles) -> Refinement:
        """Send requests, until the connection fails."""
        self._left -= 1
        if self._left < 0:
            raise SilentWorkers("silence")
        return super().submit(subject, model, particles)


def job(sequence: Path, out: Path) -> Job:
    """A run with one worker, which gives particles back as they are."""
    settings = settings_for("gepf", "default", 6, 300)
    return Job(sequence, out, settings, Pool(1, worker_command=INSTANT), pictures=False)


def test_a_run_connects_anew_and_has_the_same_bytes(sequence: Path, endpoint: str, tmp_path: Path) -> None:
    """Recorded frames are kept, and the tracker continues from the last; so does publication, to one end."""
    written, opened = io.StringIO(), list[int]()

    def heard() -> list[str]:
        return [msgspec.msgpack.decode(payload)["kind"] for _, _, payload in listener.heard]

    def connect(pool: Pool, report: Callable[[str], None]) -> ZenohRefiner:
        opened.append(1)
        return ZenohRefiner(pool, report) if len(opened) > 1 else FallsSilent(pool, report, 3)

    show, pool = Show(Console(file=written, width=300)), Pool(1, connect=endpoint, worker_command=INSTANT)
    published = replace(job(sequence, tmp_path / "broken"), results="robot/person", pool=pool)
    with open_router([endpoint]), listening(endpoint, "robot/person") as listener:
        track(published, show, connect)
        wait_until(lambda: END in heard())
    track(job(sequence, tmp_path / "calm"), show, ZenohRefiner)
    broken, calm = (tmp_path / name / "track.npz" for name in ("broken", "calm"))
    assert broken.read_bytes() == calm.read_bytes()
    assert len(opened) == 2
    assert "none answers; reconnecting" in written.getvalue()
    assert "continuing with frame" in written.getvalue()
    assert heard().count(KIND) > 0
    assert heard().index(END) == len(heard()) - 1


class SilentOnce(FallsSilent):
    """Real workers that do not answer one request."""

    def submit(self, subject: SubjectFrame, model: BodyModel, particles: Particles) -> Refinement:
        """Send requests, except one."""
        if self._left < 0:
            self._left = sys.maxsize
        return super().submit(subject, model, particles)


def test_a_live_run_goes_on_with_a_new_track(
    endpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A run of days does not end with one outage: it says so, and later frames are tracked and stored."""

    def frames() -> Iterator[dict[str, bytes]]:
        for number in takewhile(lambda _: len(listener.heard) < 12, count()):
            yield {CAMERA_KEY: encode_live(plate_image(number))}
        yield {CAMERA_KEY: LIVE_END}

    def connect(pool: Pool, report: Callable[[str], None]) -> ZenohRefiner:
        return SilentOnce(pool, report, 3)

    with (
        listening(endpoint, f"{CAMERA_KEY}/results") as listener,
        publishing(endpoint, [CAMERA_KEY], frames(), lambda stop: stop.wait(0.05)),
        at_work(endpoint),
    ):
        options = tracking(f"zenoh:{CAMERA_KEY}", tmp_path / "run", listen=endpoint, particles=20)
        assert main(options, connect) == 0
    tracked = read_track(tmp_path / "run")
    assert len(tracked.frame) >= 12
    assert np.all(np.diff(tracked.frame) > 0)
    assert capsys.readouterr().err.count("tracking starts again with the next frame") == 1


def test_it_gives_up_at_last_and_keeps_what_there_is(sequence: Path, tmp_path: Path) -> None:
    """Like every fault of the bus."""
    opened = list[int]()

    def connect(pool: Pool, report: Callable[[str], None]) -> ZenohRefiner:
        opened.append(1)
        return FallsSilent(pool, report, 3 if len(opened) == 1 else 0)

    with pytest.raises(SilentWorkers):
        track(job(sequence, tmp_path / "out"), Show(Console(file=io.StringIO())), connect)
    assert len(opened) > 1
    assert len(read_track(tmp_path / "out").frame) > 0


@pytest.mark.slow
def test_a_worker_that_takes_requests_and_never_answers_is_named(endpoint: str) -> None:
    """When a request has met its timeout: an error in place of a wait without end."""
    kept = list[IncomingRequest]()
    with ZenohRefiner(Pool(0, listen=endpoint)) as refiner, open_worker([endpoint]) as bus:
        bus.serve_requests(keys.of_worker("mute", "refine/*"), kept.append)
        bus.announce(keys.offer_key("mute", Offer()))
        refiner.wait_for(1)
        pending = refiner.submit(frame(1), MODEL, PARTICLES)
        with pytest.raises(SilentWorkers, match=r"none answers within 30 s \(last mute\)"):
            pending.result()
        assert len(kept) == 1
