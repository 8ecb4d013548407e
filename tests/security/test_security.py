"""Certificates and access: who gets in, what they may do there, and what who does not is told."""

from __future__ import annotations

import stat
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import pytest

from common.errors import BusError, InputError
from common.protocol import keys
from common.protocol.messages import encode_request
from common.transport.bus import (
    Bus,
    open_coordinator,
    open_router,
    open_session,
    open_worker,
)
from common.transport.credentials import Credentials, check_holder, holder_of, read_credentials
from common.transport.endpoints import check_endpoint, check_listening, host_and_port, is_loopback
from common.transport.session import Security, session_settings
from common.transport.tls_probe import why_refused
from coordinator.cli import main
from coordinator.pool.options import Pool
from coordinator.pool.zenoh_refiner import ZenohRefiner
from coordinator.security.certificates import make_certificates
from coordinator.security.roster import choose_names, read_roster
from coordinator.security.tls import TlsFiles, choose_security
from tests.support.certificates import STRANGER, WORKERS, Folder, free_port, make_folder
from tests.support.instant_worker import KERNEL
from tests.support.processes import INSTANT, started, wait_until
from tests.support.serving import REQUEST, expected, refined_bytes, serving
from worker.admission import check_admission
from worker.service import Service

SHORT = 0.3  # seconds in which something that must not happen would have happened


@pytest.fixture(scope="module")
def ours(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """The certificates of this run."""
    return make_folder(tmp_path_factory.mktemp("ours"))


@pytest.fixture(scope="module")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """Certificates with the same names, of another authority."""
    return make_folder(tmp_path_factory.mktemp("foreign"))


@pytest.fixture
def place() -> str:
    """An encrypted endpoint of this host."""
    return f"tls/127.0.0.1:{free_port()}"


@contextmanager
def secure_worker(place: str, folder: Folder, name: str, claim: str | None = None) -> Iterator[Bus]:
    """A worker in a thread, with somebody's certificate, that claims to be somebody."""
    with open_worker([place], Security(folder.of(name))) as bus:
        service = Service(bus, claim or name, KERNEL)
        thread = threading.Thread(target=service.run)
        thread.start()
        try:
            yield bus
        finally:
            service.stop()
            thread.join(5.0)


def listening(place: str, folder: Folder) -> ZenohRefiner:
    """A coordinator that lets workers in."""
    return ZenohRefiner(Pool(workers=0, listen=place, security=folder.listening, worker_timeout=10.0))


def bare_settings(endpoint: str, credentials: Credentials | None) -> dict[str, Any]:
    """A client that gives up soon, and does not check itself what it does."""
    security = None if credentials is None else Security(credentials)
    settings = session_settings("client", (), [endpoint], security)
    settings["connect"] |= {"timeout_ms": 700, "exit_on_failure": True}
    return settings


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
    options = Pool(workers=0, connect=place, security=Security(ours.of("coordinator")), worker_timeout=10.0)
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
        workers=1, listen=place, security=ours.listening, worker_command=INSTANT, worker_timeout=20.0
    )
    with ZenohRefiner(options) as refiner, secure_worker(place, ours, "w0"):
        refiner.wait_for(2)
        assert refined_bytes(refiner, 1) == expected(1)
        assert len(refiner.statistics.workers_seen) == 2


REFUSED = {
    "no certificate": "refuses us without a certificate; add --tls-ca, --tls-cert and --tls-key",
    "foreign authority": "another authority signed it; have it signed by the one there",
    "expired": "it has expired; make a new one with gepf certificates",
    "plain tcp": "admits encrypted connections only; give tls/HOST:PORT with --tls-ca",
}


@pytest.mark.parametrize("case", REFUSED)
def test_listener_refuses_and_the_refused_learns_why(
    case: str, place: str, ours: Folder, foreign: Folder
) -> None:
    """A client that checks nothing itself does not get in, and asking why gives the reason in one line."""
    presented = {
        "no certificate": ours.of("w0"),
        "foreign authority": foreign.of("w0", ca=ours.path / "ca.pem"),
        "expired": ours.of("old"),
        "plain tcp": None,
    }[case]
    endpoint = place.replace("tls/", "tcp/") if case == "plain tcp" else place
    settings = bare_settings(endpoint, presented)
    if case == "no certificate":
        tls = settings["transport"]["link"]["tls"]
        for key in [key for key in tls if key.endswith(("_certificate", "_key")) and "root" not in key]:
            del tls[key]
        presented = None
    with open_coordinator([place], (), ours.listening):
        with pytest.raises(BusError, match="Unable to connect"):
            open_session(settings, 2**20)
        line = why_refused(endpoint, presented)
        assert line is not None
        assert REFUSED[case] in line
        assert "\n" not in line
        assert why_refused(place, ours.of("w0")) is None


def test_foreign_listener_is_refused(place: str, ours: Folder, foreign: Folder) -> None:
    """A worker does not connect to a coordinator of another authority, and says whose fault it sees."""
    why = pytest.raises(InputError, match=r"shows a certificate that is not valid under .*ours.*ca\.pem")
    with open_coordinator([place], (), foreign.listening), why:
        open_worker([place], Security(ours.of("w0")))


def test_worker_cannot_pose_as_coordinator(place: str, ours: Folder) -> None:
    """A worker's certificate, though of the same authority, is not accepted from one who listens."""
    why = pytest.raises(InputError, match="shows a certificate that is not valid under")
    with open_coordinator([place], (), Security(ours.of("w1"))), why:
        open_worker([place], Security(ours.of("w0")))


def test_certificate_of_another_host_is_refused(ours: Folder) -> None:
    """A coordinator that is reached under a name that its certificate does not hold is not trusted."""
    place = f"tls/127.0.0.2:{free_port()}"
    with open_coordinator([place], (), ours.listening):
        line = why_refused(place, ours.of("w0"))
    assert line == f"{place} shows a certificate for another host; connect by a host name or address in it"


def test_tls_towards_plain_tcp_is_told(ours: Folder) -> None:
    """A worker with a certificate whose coordinator listens without encryption is told so."""
    port = free_port()
    with open_coordinator([f"tcp/127.0.0.1:{port}"]):
        line = why_refused(f"tls/127.0.0.1:{port}", ours.of("w0"))
        assert line is not None
        assert "is not encrypted on the other side" in line
        assert why_refused(f"tcp/127.0.0.1:{port}", None) is None
    assert why_refused(f"tls/127.0.0.1:{port}", ours.of("w0")) is None  # nobody there: no refusal


def test_other_workers_name_is_never_seen(place: str, ours: Folder) -> None:
    """A valid certificate under another worker's name: no token, no request, and the run goes on."""
    with listening(place, ours) as refiner, secure_worker(place, ours, "w0"):
        refiner.wait_for(1)
        with secure_worker(place, ours, "w0", claim="w1") as bus:
            with pytest.raises(InputError, match=r"does not let .*w0\.pem be worker 'w1'; have 'w1' listed"):
                check_admission(bus, "w1", [place], Security(ours.of("w0")), patience=1.0)
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
                check_admission(bus, STRANGER, [place], Security(ours.of(STRANGER)), patience=SHORT)
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
            asker = bus.asker(keys.worker_refine("w0"), 1.0)
            asker.ask(encode_request(REQUEST), answers.append, answers.append, ended.set)
            bus.publish_frames(keys.run_frames(refiner.run)).put(77, b"forged")
            assert ended.wait(3.0)
            time.sleep(SHORT)
            assert (seen, answers) == ([], [])
            assert 77 not in forged
            assert refined_bytes(refiner, 2) == expected(2)


def test_run_that_is_refused_by_its_router_ends(place: str, ours: Folder, foreign: Folder) -> None:
    """A coordinator that a router refuses is told so instead of waiting for workers."""
    with open_router([place], (), ours.routing):
        options = Pool(
            workers=0, connect=place, security=Security(foreign.of("coordinator", ca=ours.path / "ca.pem"))
        )
        with pytest.raises(InputError, match="another authority signed it"):
            ZenohRefiner(options).__enter__()


def test_worker_process_with_a_certificate(place: str, ours: Folder) -> None:
    """A real process is called as its certificate, serves, and survives that its coordinator ends."""
    with started("--connect", place, *ours.options("w1"), command=INSTANT) as process:
        for number in range(2):
            with listening(place, ours) as refiner:
                refiner.wait_for(1)
                assert refined_bytes(refiner, number) == expected(number)
                assert refiner.statistics.workers_seen == ("w1",)
        process.terminate()
        assert process.wait(10.0) in (0, -15)


PROCESSES = {
    "foreign": "is not valid under",
    "foreign world": "shows a certificate that is not valid under",
    "expired": "certificate has expired; make a new one with gepf certificates",
    "plain tcp": "admits encrypted connections only",
    "other name": "is for 'w0', not for 'w1'; give the one for 'w1'",
    "unlisted": f"be worker '{STRANGER}'; have '{STRANGER}' listed there in workers.txt",
}


@pytest.mark.parametrize("case", PROCESSES)
def test_refused_process_says_so_in_one_line(case: str, place: str, ours: Folder, foreign: Folder) -> None:
    """`gepf-worker` that is not let in ends with exit code 2 and one line that says why."""
    options = {
        "foreign": [*foreign.options("w0")[2:], "--tls-ca", str(ours.path / "ca.pem")],
        "foreign world": foreign.options("w0"),
        "expired": ours.options("old"),
        "plain tcp": [],
        "other name": [*ours.options("w0"), "--name", "w1"],
        "unlisted": ours.options(STRANGER),
    }[case]
    endpoint = place.replace("tls/", "tcp/") if case == "plain tcp" else place
    seen: list[str] = []
    with open_coordinator([place], (), ours.listening) as bus:
        bus.watch(keys.ANY_WORKER_ALIVE, lambda key, _: seen.append(key))
        with started("--connect", endpoint, *options, command=INSTANT) as process:
            assert process.wait(30.0) == 2
            assert process.stderr is not None
            lines = process.stderr.read().splitlines()
    assert len(lines) == 1
    assert PROCESSES[case] in lines[0]
    assert seen == []


LISTENING = {
    "tcp/127.0.0.1:7447": None,
    "tcp/127.8.9.1:7447": None,
    "tcp/[::1]:7447": None,
    "tcp/localhost:7447": None,
    "unixsock-stream//tmp/bus": None,
    "tcp/0.0.0.0:7447": "lets everyone in",
    "tcp/[::]:7447": "lets everyone in",
    "tcp/10.0.0.5:7447": "lets everyone in",
    "tcp/localhost.example:7447": "lets everyone in",
    "udp/0.0.0.0:7447": "lets everyone in",
    "ws/0.0.0.0:7447#iface=lo": "lets everyone in",
    "quic/0.0.0.0:7447": "lets everyone in",
    "tls/127.0.0.1:7447": "needs a certificate",
    "tls/0.0.0.0:7447": "needs a certificate",
    "7447": "is no endpoint",
}


@pytest.mark.parametrize("endpoint", LISTENING)
def test_listening_beyond_this_host_needs_tls(endpoint: str) -> None:
    """What others can reach is refused without a certificate, unless the user insists."""
    fault = LISTENING[endpoint]
    if fault is None:
        check_listening(endpoint, None, insecure=False)
        return
    with pytest.raises(InputError, match=fault):
        check_listening(endpoint, None, insecure=False)
    if fault == "lets everyone in":
        check_listening(endpoint, None, insecure=True)


def test_commands_refuse_to_listen_openly(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`gepf track` and `gepf router` end with 2 and one line before they open anything."""
    for command in (["track", "nowhere", "--out", str(tmp_path / "run")], ["router"]):
        assert main([*command, "--listen", "tcp/0.0.0.0:7447"]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert "--insecure" in error
    assert not (tmp_path / "run").exists()


def test_certificate_forbids_plain_endpoints(ours: Folder) -> None:
    """Who gives a certificate means to be encrypted; a plain endpoint beside it is a mistake."""
    for option in ("--listen", "--connect"):
        with pytest.raises(InputError, match="is not encrypted; with a certificate, give tls/HOST:PORT"):
            check_endpoint(option, "tcp/127.0.0.1:7447", ours.of("coordinator"))
    check_endpoint("--connect", "tls/somewhere:7447", ours.of("coordinator"))


def test_only_the_coordinators_certificate_runs(ours: Folder) -> None:
    """A run with a worker's certificate is refused at once, and the right one knows its workers."""
    files = {
        name: TlsFiles(*(getattr(ours.of(name), f) for f in ("ca", "cert", "key")))
        for name in ("coordinator", "w0")
    }
    with pytest.raises(InputError, match="is for 'w0', not for 'coordinator'"):
        choose_security("tls/0.0.0.0:1", None, files["w0"])
    assert choose_security("tls/0.0.0.0:1", None, files["coordinator"]) == ours.listening
    connecting = choose_security(None, "tls/router:1", files["coordinator"])
    assert connecting == Security(ours.of("coordinator"))
    assert choose_security("tcp/127.0.0.1:1", None, TlsFiles()) is None


def test_certificate_files_that_are_none(ours: Folder, tmp_path: Path) -> None:
    """Missing files, other files and another certificate's key are each named."""
    good = ours.of("w0")
    with pytest.raises(InputError, match="--tls-key missing; give all of --tls-ca, --tls-cert, --tls-key"):
        read_credentials(good.ca, good.cert, None)
    with pytest.raises(InputError, match=r"--tls-cert .*nothing.* cannot be read"):
        read_credentials(good.ca, tmp_path / "nothing", good.key)
    with pytest.raises(InputError, match="are no certificate with its key: KEY_VALUES_MISMATCH"):
        holder_of(Credentials(good.ca, good.cert, ours.of("w1").key))
    rubbish = tmp_path / "rubbish"
    rubbish.write_text("rubbish")
    with pytest.raises(InputError, match=r"--tls-ca .*rubbish is no certificate"):
        holder_of(Credentials(rubbish, good.cert, good.key))
    with pytest.raises(InputError, match="are no certificate with its key"):
        holder_of(Credentials(good.ca, rubbish, good.key))
    assert read_credentials(None, None, None) is None
    check_holder(good, "w0")


def test_certificates_are_made_once(tmp_path: Path) -> None:
    """A second call keeps what is good, adds who is new, and renews for new hosts and what is over."""
    first = make_certificates(tmp_path, ("w0",), (), 1, None)
    assert first == ["coordinator", "router", "w0"]
    assert make_certificates(tmp_path, ("w0",), (), 1, None) == []
    assert make_certificates(tmp_path, ("w1",), (), 1, None) == ["w1"]
    assert read_roster(tmp_path / "ca.pem") == ("w0", "w1")
    assert make_certificates(tmp_path, ("w1",), ("10.0.0.5", "far.example"), 1, None) == first[:2]
    (tmp_path / "w0.key").unlink()
    assert make_certificates(tmp_path, (), (), 1, None) == ["w0"]
    for name in ("ca", "coordinator", "router", "w0", "w1"):
        assert stat.S_IMODE((tmp_path / f"{name}.key").stat().st_mode) == 0o600
    for name in ("coordinator", "router", "w0", "w1"):
        check_holder(Folder(tmp_path).of(name), name)
    (tmp_path / "ca.key").unlink()
    with pytest.raises(InputError, match=r"ca\.key is missing"):
        make_certificates(tmp_path, (), (), 1, None)


def test_expired_certificates_are_renewed(tmp_path: Path) -> None:
    """What is over is made anew; with the authority, all that it signed."""
    folder = make_folder(tmp_path)
    (tmp_path / "w0.pem").write_bytes((tmp_path / "old.pem").read_bytes())
    (tmp_path / "w0.key").write_bytes((tmp_path / "old.key").read_bytes())
    with pytest.raises(InputError, match="certificate has expired"):
        holder_of(folder.of("w0"))
    assert make_certificates(tmp_path, (), (), 1, None) == ["w0"]
    check_holder(folder.of("w0"), "w0")


def test_names_of_workers() -> None:
    """A number or a list; the names of the other roles are taken."""
    assert choose_names("2") == ("worker-0", "worker-1")
    assert choose_names("anna, ben") == ("anna", "ben")
    for bad in ("coordinator", "router", "a/b", "", "a,,b", "*"):
        with pytest.raises(InputError):
            choose_names(bad)


def test_router_file_is_what_a_router_takes(tmp_path: Path, ours: Folder) -> None:
    """The settings that are written for a router open one, and the run through it works."""
    settings = msgspec.json.decode((ours.path / "router.json5").read_bytes())
    place = f"tls/127.0.0.1:{free_port()}"
    settings["listen"]["endpoints"] = [place]
    options = Pool(workers=0, connect=place, security=Security(ours.of("coordinator")), worker_timeout=10.0)
    with open_session(settings, 2**20), ZenohRefiner(options) as refiner, secure_worker(place, ours, "w0"):
        assert refined_bytes(refiner, 1) == expected(1)
    make_certificates(tmp_path, ("w0",), (), 1, Path("/certificates"))
    moved = msgspec.json.decode((tmp_path / "router.json5").read_bytes())
    assert moved["transport"]["link"]["tls"]["listen_private_key"] == "/certificates/router.key"


def test_router_process_routes_until_told_to_end(place: str, ours: Folder) -> None:
    """`gepf router` lets a run and a worker meet, and ends with 0."""
    command = (sys.executable, "-m", "coordinator.cli", "router")
    with started("--listen", place, *ours.options("router"), command=command) as process:
        security = Security(ours.of("coordinator"))
        with secure_worker(place, ours, "w0"):
            options = Pool(workers=0, connect=place, security=security, worker_timeout=10.0)
            with ZenohRefiner(options) as refiner:
                assert refined_bytes(refiner, 1) == expected(1)
        process.terminate()
        assert process.wait(10.0) == 0


def test_parts_of_endpoints() -> None:
    """Host and port, with IPv6 and options of the transport."""
    assert host_and_port("tls/[::1]:7447") == ("::1", 7447)
    assert host_and_port("tcp/host.example:1?rel=1#iface=eth0") == ("host.example", 1)
    assert host_and_port("unixsock-stream//tmp/bus")[1] == 0
    assert is_loopback("tcp/[::1]:7447")
    assert not is_loopback("tcp/:7447")


def test_plain_workers_need_nothing(place: str) -> None:
    """Without certificates, on this host, all is as it was."""
    endpoint = place.replace("tls/", "tcp/")
    with (
        ZenohRefiner(Pool(workers=0, listen=endpoint, worker_timeout=5.0)) as refiner,
        serving(endpoint, "w"),
    ):
        wait_until(lambda: why_refused(endpoint, None) is None)
        assert refined_bytes(refiner, 1) == expected(1)
