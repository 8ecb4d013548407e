"""Encrypted runs: the same bytes, directly and through a router, and no access to other keys."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue

import msgspec
import pytest

from gepf.common.errors import InputError
from gepf.common.protocol import keys
from gepf.common.protocol.messages import decode_refusal, encode_request
from gepf.common.transport.opening import open_router, open_session, open_worker
from gepf.common.transport.session import Security
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from gepf.coordinator.security.certificates import make_certificates
from gepf.worker.connection import Identity, check_admission
from tests.support.processes import warm_processes as warm
from tests.support.processes.certificates import (
    STRANGER,
    WORKERS,
    Folder,
    free_port,
    listening,
    secure_worker,
)
from tests.support.processes.programs import GEPF, INSTANT, started, wait_until
from tests.support.processes.serving import REQUEST, expected, refined_bytes

SHORT = 0.3  # seconds in which something that must not happen would have happened


def test_run_over_tls_gives_the_same_bytes(place: str, ours: Folder) -> None:
    """Directly, with certificates on both sides, and with a local worker, which needs none."""
    options = Pool(1, listen=place, security=ours.listening, worker_command=INSTANT, worker_timeout=300.0)
    with ZenohRefiner(options) as refiner, secure_worker(place, ours, "w0"), secure_worker(place, ours, "w1"):
        refiner.wait_for(3)
        for number in range(3):
            assert refined_bytes(refiner, number) == expected(number)
        assert {*WORKERS} < {*refiner.statistics.workers_seen}


def test_run_through_a_router_gives_the_same_bytes(place: str, ours: Folder) -> None:
    """Through a router with access control, a late worker included, the result is that of the kernel."""
    options = Pool(workers=0, connect=place, security=Security(ours.of("coordinator")), worker_timeout=300.0)
    with open_router([place], (), ours.routing), ZenohRefiner(options) as refiner:
        with secure_worker(place, ours, "w0"):
            assert refined_bytes(refiner, 0) == expected(0)
            with secure_worker(place, ours, "w1"):
                refiner.wait_for(2)
                assert refined_bytes(refiner, 1) == expected(1)
        assert refiner.statistics.workers_seen == WORKERS


def test_other_workers_name_is_never_seen(place: str, ours: Folder) -> None:
    """A valid certificate under another worker's name: no token, no request, and the run goes on."""
    security = Security(ours.of("w0"))
    with listening(place, ours) as refiner, secure_worker(place, ours, "w0"):
        refiner.wait_for(1)
        with secure_worker(place, ours, "w0", claim="w1") as bus:
            with pytest.raises(InputError, match=r"does not admit worker 'w1'; have it listed there"):
                check_admission(bus, Identity("w1", (place,), security))
            for number in range(3):
                assert refined_bytes(refiner, number) == expected(number)
        assert refiner.statistics.workers_seen == ("w0",)


def test_unlisted_certificate_opens_nothing(place: str, ours: Folder) -> None:
    """Signed by the same authority but not listed: no access to frames, models, workers, and not visible."""
    with listening(place, ours) as refiner, secure_worker(place, ours, "w0"):
        refiner.wait_for(1)
        assert refined_bytes(refiner, 1) == expected(1)
        security = Security(ours.of(STRANGER))
        with open_worker([place], security) as bus:
            seen: list[str] = []
            bus.subscribe(keys.of_run(keys.ANY_RUN, "frame"), lambda key, _: seen.append(key))
            bus.watch(keys.of_worker("*", "offer/**"), lambda key, _: seen.append(key))
            bus.announce(keys.of_worker(STRANGER, "offer/**"))
            assert bus.fetch(keys.of_run(refiner.run, "frame/1"), 1.0) is None
            assert bus.fetch(keys.of_run(refiner.run, "model/*"), 1.0) is None
            assert refined_bytes(refiner, 2) == expected(2)
            with pytest.raises(InputError, match=f"does not admit worker '{STRANGER}'"):
                check_admission(bus, Identity(STRANGER, (place,), security))
        assert set(seen) <= {keys.of_worker(STRANGER, "offer/**")}  # its own, which never leaves it
        assert refiner.statistics.workers_seen == ("w0",)


def test_worker_opens_its_own_keys_only(place: str, ours: Folder) -> None:
    """A worker cannot send requests, watch, serve instead of another, or publish frames of a run."""
    with listening(place, ours) as refiner, secure_worker(place, ours, "w0") as honest:
        refiner.wait_for(1)
        assert refined_bytes(refiner, 1) == expected(1)
        frames: list[bytes] = []
        honest.subscribe(keys.of_run(refiner.run, "frame"), lambda _, payload: frames.append(payload))
        with open_worker([place], Security(ours.of("w1"))) as bus:
            assert bus.fetch(keys.of_run(refiner.run, "frame/1"), 1.0) is not None
            seen: list[str] = []
            bus.watch(keys.of_worker("*", "offer/**"), lambda key, _: seen.append(key))
            bus.serve(keys.of_run(refiner.run, "model/*"), lambda _: b"forged")
            answers: SimpleQueue[tuple[str, bytes]] = SimpleQueue()
            sender = bus.request_sender(keys.of_worker("w0", "refine/coordinator"), 1.0)
            sender.send(encode_request(REQUEST), lambda *how: answers.put(how))
            bus.publish(keys.of_run(refiner.run, "frame")).put(b"forged")
            assert answers.get(timeout=300.0) == ("nothing", b"")
            time.sleep(SHORT)
            assert not seen
            assert refined_bytes(refiner, 2) == expected(2)
            wait_until(lambda: bool(frames))
            assert b"forged" not in frames


def room(name: str, place: str, ours: Folder) -> ZenohRefiner:
    """A coordinator at a router."""
    security = Security(ours.of(name))
    return ZenohRefiner(Pool(workers=0, connect=place, security=security, worker_timeout=300.0))


def test_coordinators_share_a_router_and_its_workers(place: str, ours: Folder) -> None:
    """Each with its own certificate and runs of its own name, and with the bytes of the kernel."""
    with (
        open_router([place], (), ours.routing),
        secure_worker(place, ours, "w0"),
        room("room", place, ours) as one,
        room("room-2", place, ours) as two,
    ):
        for number in range(3):
            assert refined_bytes(one, number) == expected(number)
            assert refined_bytes(two, 5 + number) == expected(5 + number)
        assert [keys.coordinator_of(each.run) for each in (one, two)] == ["room", "room-2"]


def test_a_coordinator_opens_its_own_keys_only(place: str, ours: Folder) -> None:
    """It cannot publish, serve or end what is another's, read frames of people there, or ask in its name.

    A real session tries each, and the same with its own keys, which work.
    """
    with (
        open_router([place], (), ours.routing),
        secure_worker(place, ours, "w0") as honest,
        room("room", place, ours) as victim,
        open_worker([place], Security(ours.of("room-2"))) as intruder,
        open_worker([place], Security(ours.of("room"))) as watcher,
        open_worker([place], Security(ours.of("room-2"))) as accomplice,
    ):
        assert refined_bytes(victim, 1) == expected(1)
        came, seen = list[tuple[str, bytes]](), list[str]()
        for run in (victim.run, "room-2/run"):
            honest.subscribe(keys.of_run(run, "frame"), lambda *sample: came.append(sample))
        for bus in (watcher, accomplice):
            for name in ("room", "room-2"):
                bus.subscribe(keys.of_live(name, "depth"), lambda *sample: came.append(sample))
        accomplice.subscribe(keys.of_run(victim.run, "frame"), lambda key, _: seen.append(key))
        accomplice.watch(keys.of_run(victim.run, "alive"), lambda key, _: seen.append(key))
        for what in ("frame/1", "model/*", "present"):
            assert intruder.fetch(keys.of_run(victim.run, what), 1.0) is None

        intruder.serve(keys.of_run(victim.run, "model/*"), lambda _: b"forged")
        with open_worker([place], Security(ours.of("room-2"))) as ending:
            ending.announce(keys.of_run(victim.run, "alive"))  # its end would drop the run's requests
        answers: SimpleQueue[tuple[str, bytes]] = SimpleQueue()
        for name, run, ends in (
            ("room", victim.run, "nothing"),
            ("room-2", victim.run, "refusal"),
            ("room-2", "room-2/run", "refusal"),  # which has no such frame, but is heard
        ):
            sender = intruder.request_sender(keys.of_worker("w0", f"refine/{name}"), 5.0)
            sender.send(encode_request(replace(REQUEST, run=run)), lambda *how: answers.put(how))
            ending_of, payload = answers.get(timeout=300.0)
            assert ending_of == ends
            if (name, run) == ("room-2", victim.run):
                assert decode_refusal(payload).reason == f"run {run} does not belong to room-2"
        forged = [keys.of_run(victim.run, "frame"), keys.of_live("room", "depth")]
        own = [keys.of_run("room-2/run", "frame"), keys.of_live("room-2", "depth")]
        for key in (*forged, *own):
            intruder.publish(key).put(b"forged")
        wait_until(lambda: {key for key, payload in came if payload == b"forged"} == {*own})
        for number in range(2, 5):
            assert refined_bytes(victim, number) == expected(number)
        assert {key for key, payload in came if payload == b"forged"} == {*own}
        assert not seen
        assert victim.statistics.counts["batches_sent_again"] == 0


def test_a_coordinator_that_a_router_does_not_list_reads_what_to_do(place: str, ours: Folder) -> None:
    """Instead of waiting for workers that it can never see."""
    says = f"does not admit coordinator '{STRANGER}'; have it listed there in coordinators.txt"
    with open_router([place], (), ours.routing), pytest.raises(InputError, match=says):
        room(STRANGER, place, ours)


def test_worker_process_with_a_certificate(place: str, ours: Folder, tmp_path: Path) -> None:
    """A real process has the name of its certificate, serves, and continues after its coordinator ends."""
    with warm.started(
        warm.work_instantly, "--connect", place, *ours.options("w1"), log=tmp_path / "log"
    ) as process:
        for number in range(2):
            with listening(place, ours) as refiner:
                refiner.wait_for(1)
                assert refined_bytes(refiner, number) == expected(number)
                assert refiner.statistics.workers_seen == ("w1",)
        process.terminate()
        process.join()
        assert process.exitcode in (0, -15)


def test_router_file_is_what_a_router_takes(tmp_path: Path, ours: Folder) -> None:
    """The settings that are written for a router open one, and the run through it works."""
    settings = msgspec.json.decode((ours.path / "router.json5").read_bytes())
    place = f"tls/127.0.0.1:{free_port()}"
    settings["listen"]["endpoints"] = [place]
    options = Pool(workers=0, connect=place, security=Security(ours.of("coordinator")), worker_timeout=300.0)
    with open_session(settings), ZenohRefiner(options) as refiner, secure_worker(place, ours, "w0"):
        assert refined_bytes(refiner, 1) == expected(1)
    make_certificates(tmp_path, ("w0",), (), 1, Path("/certificates"))
    moved = msgspec.json.decode((tmp_path / "router.json5").read_bytes())
    assert moved["transport"]["link"]["tls"]["listen_private_key"] == "/certificates/router.key"


@pytest.mark.slow
def test_router_process_routes_until_a_signal(place: str, ours: Folder) -> None:
    """`gepf router` lets a run and a worker meet, and ends with 0."""
    with started("router", "--listen", place, *ours.options("router"), command=GEPF) as process:
        security = Security(ours.of("coordinator"))
        with secure_worker(place, ours, "w0"):
            options = Pool(workers=0, connect=place, security=security, worker_timeout=300.0)
            with ZenohRefiner(options) as refiner:
                assert refined_bytes(refiner, 1) == expected(1)
        process.terminate()
        assert process.wait(300.0) == 0
