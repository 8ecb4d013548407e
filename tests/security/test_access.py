"""Encrypted runs: the same bytes, directly and through a router, and keys of others stay closed."""

from __future__ import annotations

import sys
import threading
import time
from pathlib import Path

import msgspec
import pytest

from common.errors import InputError
from common.protocol import keys
from common.protocol.messages import encode_request
from common.transport.opening import open_router, open_session, open_worker
from common.transport.session import Security
from coordinator.pool.options import Pool
from coordinator.pool.zenoh_refiner import ZenohRefiner
from coordinator.security.certificates import make_certificates
from tests.support.processes.certificates import (
    STRANGER,
    WORKERS,
    Folder,
    free_port,
    listening,
    secure_worker,
)
from tests.support.processes.programs import INSTANT, started
from tests.support.processes.serving import REQUEST, expected, refined_bytes
from worker.connection import check_admission

SHORT = 0.3  # seconds in which something that must not happen would have happened


def test_run_over_tls_gives_the_same_bytes(place: str, ours: Folder) -> None:
    """With certificates on both sides, directly, the result is that of the kernel."""
    with (
        listening(place, ours) as refiner,
        secure_worker(place, ours, "w0"),
        secure_worker(place, ours, "w1"),
    ):
        refiner.wait_for(2)
        for number in range(3):
            assert refined_bytes(refiner, number) == expected(number)
        assert refiner.statistics.workers_seen == WORKERS


def test_run_through_a_router_gives_the_same_bytes(place: str, ours: Folder) -> None:
    """Through a router with access control, a late worker included, the result is that of the kernel."""
    options = Pool(workers=0, connect=place, security=Security(ours.of("coordinator")), worker_timeout=60.0)
    with open_router([place], (), ours.routing), ZenohRefiner(options) as refiner:
        with secure_worker(place, ours, "w0"):
            assert refined_bytes(refiner, 0) == expected(0)
            with secure_worker(place, ours, "w1"):
                refiner.wait_for(2)
                assert refined_bytes(refiner, 1) == expected(1)
        assert refiner.statistics.workers_seen == WORKERS


def test_local_workers_work_beside_secure_ones(place: str, ours: Folder) -> None:
    """A run that listens with TLS has local workers, too, which need no certificate."""
    options = Pool(
        workers=1, listen=place, security=ours.listening, worker_command=INSTANT, worker_timeout=60.0
    )
    with ZenohRefiner(options) as refiner, secure_worker(place, ours, "w0"):
        refiner.wait_for(2)
        assert refined_bytes(refiner, 1) == expected(1)
        assert len(refiner.statistics.workers_seen) == 2


def test_other_workers_name_is_never_seen(place: str, ours: Folder) -> None:
    """A valid certificate under another worker's name: no token, no request, and the run goes on."""
    with listening(place, ours) as refiner, secure_worker(place, ours, "w0"):
        refiner.wait_for(1)
        with secure_worker(place, ours, "w0", claim="w1") as bus:
            with pytest.raises(InputError, match=r"does not let .*w0\.pem be worker 'w1'; have 'w1' listed"):
                check_admission(bus, "w1", [place], Security(ours.of("w0")), patience_s=1.0)
            for number in range(3):
                assert refined_bytes(refiner, number) == expected(number)
        assert refiner.statistics.workers_seen == ("w0",)


def test_unlisted_certificate_opens_nothing(place: str, ours: Folder) -> None:
    """Signed by the same authority but not listed: sees no frame, no model, no worker, and is not seen."""
    with listening(place, ours) as refiner, secure_worker(place, ours, "w0"):
        refiner.wait_for(1)
        assert refined_bytes(refiner, 1) == expected(1)
        with open_worker([place], Security(ours.of(STRANGER))) as bus:
            seen: list[str] = []
            bus.follow_frames(keys.ANY_RUN_FRAMES, lambda key, *_: seen.append(key))
            bus.watch(keys.ANY_WORKER_ALIVE, lambda key, _: seen.append(key))
            bus.announce(keys.worker_alive(STRANGER))
            assert bus.fetch(keys.run_frame(refiner.run, 1), 1.0) is None
            assert bus.fetch(keys.run_model(refiner.run, "*"), 1.0) is None
            assert refined_bytes(refiner, 2) == expected(2)
            with pytest.raises(InputError, match=f"be worker '{STRANGER}'; have '{STRANGER}' listed"):
                check_admission(bus, STRANGER, [place], Security(ours.of(STRANGER)), patience_s=SHORT)
        assert set(seen) <= {keys.worker_alive(STRANGER)}  # its own, which never leaves it
        assert refiner.statistics.workers_seen == ("w0",)


def test_worker_opens_its_own_keys_only(place: str, ours: Folder) -> None:
    """A worker cannot ask, watch or serve in place of another, nor publish frames of a run."""
    with listening(place, ours) as refiner, secure_worker(place, ours, "w0") as honest:
        refiner.wait_for(1)
        assert refined_bytes(refiner, 1) == expected(1)
        forged: list[int] = []
        honest.follow_frames(keys.run_frames(refiner.run), lambda _, number, __: forged.append(number))
        with open_worker([place], Security(ours.of("w1"))) as bus:
            assert bus.fetch(keys.run_frame(refiner.run, 1), 1.0) is not None
            seen: list[str] = []
            bus.watch(keys.ANY_WORKER_ALIVE, lambda key, _: seen.append(key))
            bus.serve(keys.run_model(refiner.run, "*"), lambda _: b"forged")
            answers: list[bytes] = []
            ended = threading.Event()
            sender = bus.request_sender(keys.worker_refine("w0"), 1.0)
            sender.send(encode_request(REQUEST), answers.append, answers.append, ended.set)
            bus.publish_frames(keys.run_frames(refiner.run)).put(77, b"forged")
            assert ended.wait(60.0)
            time.sleep(SHORT)
            assert (seen, answers) == ([], [])
            assert 77 not in forged
            assert refined_bytes(refiner, 2) == expected(2)


def test_worker_process_with_a_certificate(place: str, ours: Folder) -> None:
    """A real process is called as its certificate, serves, and survives that its coordinator ends."""
    with started("--connect", place, *ours.options("w1"), command=INSTANT) as process:
        for number in range(2):
            with listening(place, ours) as refiner:
                refiner.wait_for(1)
                assert refined_bytes(refiner, number) == expected(number)
                assert refiner.statistics.workers_seen == ("w1",)
        process.terminate()
        assert process.wait(60.0) in (0, -15)


def test_router_file_is_what_a_router_takes(tmp_path: Path, ours: Folder) -> None:
    """The settings that are written for a router open one, and the run through it works."""
    settings = msgspec.json.decode((ours.path / "router.json5").read_bytes())
    place = f"tls/127.0.0.1:{free_port()}"
    settings["listen"]["endpoints"] = [place]
    options = Pool(workers=0, connect=place, security=Security(ours.of("coordinator")), worker_timeout=60.0)
    with open_session(settings, 2**20), ZenohRefiner(options) as refiner, secure_worker(place, ours, "w0"):
        assert refined_bytes(refiner, 1) == expected(1)
    make_certificates(tmp_path, ("w0",), (), 1, Path("/certificates"))
    moved = msgspec.json.decode((tmp_path / "router.json5").read_bytes())
    assert moved["transport"]["link"]["tls"]["listen_private_key"] == "/certificates/router.key"


@pytest.mark.slow
def test_router_process_routes_until_a_signal(place: str, ours: Folder) -> None:
    """`gepf router` lets a run and a worker meet, and ends with 0."""
    command = (sys.executable, "-m", "coordinator.cli", "router")
    with started("--listen", place, *ours.options("router"), command=command) as process:
        security = Security(ours.of("coordinator"))
        with secure_worker(place, ours, "w0"):
            options = Pool(workers=0, connect=place, security=security, worker_timeout=60.0)
            with ZenohRefiner(options) as refiner:
                assert refined_bytes(refiner, 1) == expected(1)
        process.terminate()
        assert process.wait(60.0) == 0
