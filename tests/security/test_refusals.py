"""Clients that are refused, and what is reported: by the session, by the probe, by the process."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from gepf.common.errors import BusError, InputError
from gepf.common.protocol import keys
from gepf.common.transport.credentials import Credentials
from gepf.common.transport.endpoints import why_refused
from gepf.common.transport.opening import open_coordinator, open_router, open_session, open_worker
from gepf.common.transport.session import Security, session_settings
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from tests.support.processes.certificates import STRANGER, Folder, free_port
from tests.support.processes.warm_processes import start, work_instantly


def bare_settings(endpoint: str, credentials: Credentials | None) -> dict[str, Any]:
    """A client with a short timeout that does not check its own certificate."""
    security = None if credentials is None else Security(credentials)
    settings = session_settings("client", (), [endpoint], security)
    settings["connect"] |= {"timeout_ms": 700, "exit_on_failure": True}
    return settings


REFUSED = {
    "no certificate": "refuses connections without a certificate; add --tls-ca, --tls-cert and --tls-key",
    "foreign authority": "have a certificate signed by the authority there",
    "expired": "certificate expired; have a certificate signed by the authority there, or make a new one",
    "plain tcp": "accepts only encrypted connections; give tls/HOST:PORT with --tls-ca",
}


@pytest.mark.parametrize("case", REFUSED)
def test_listener_refuses_and_the_refused_learns_why(
    case: str, place: str, ours: Folder, foreign: Folder
) -> None:
    """A client without own checks is refused, and `why_refused` gives the reason in one line."""
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
            open_session(settings)
        line = why_refused(endpoint, presented)
        assert line is not None
        assert REFUSED[case] in line
        assert "\n" not in line
        assert why_refused(place, ours.of("w0")) is None


def test_false_coordinator_is_refused(place: str, ours: Folder, foreign: Folder) -> None:
    """A worker connects neither to a coordinator of another authority nor to another worker, and says why."""
    for listening in (foreign.listening, Security(ours.of("w1"))):
        why = pytest.raises(InputError, match="shows a certificate that is not valid here")
        with open_coordinator([place], (), listening), why:
            open_worker([place], Security(ours.of("w0")))


def test_certificate_of_another_host_is_refused(ours: Folder) -> None:
    """A coordinator reached by a host name that is not in its certificate is not trusted."""
    place = f"tls/127.0.0.2:{free_port()}"
    with open_coordinator([place], (), ours.listening):
        line = why_refused(place, ours.of("w0"))
    assert line is not None
    assert "connect by a host name in the certificate" in line


def test_who_speaks_no_tls_refuses_nobody(ours: Folder) -> None:
    """There is no reason for a listener without encryption, or without a listener."""
    port = free_port()
    with open_coordinator([f"tcp/127.0.0.1:{port}"]):
        assert why_refused(f"tls/127.0.0.1:{port}", ours.of("w0")) is None
        assert why_refused(f"tcp/127.0.0.1:{port}", None) is None
    assert why_refused(f"tls/127.0.0.1:{port}", ours.of("w0")) is None


def test_run_that_is_refused_by_its_router_ends(
    place: str, ours: Folder, foreign: Folder, tmp_path: Path
) -> None:
    """A coordinator that a router refuses reports that instead of waiting for workers.

    It trusts both authorities, so its own certificate is valid for it, and so is that of the router.
    """
    both = tmp_path / "ca.pem"
    both.write_bytes(b"".join((folder.path / "ca.pem").read_bytes() for folder in (ours, foreign)))
    with open_router([place], (), ours.routing):
        options = Pool(workers=0, connect=place, security=Security(foreign.of("coordinator", ca=both)))
        with pytest.raises(InputError, match="have a certificate signed by the authority there"):
            ZenohRefiner(options).__enter__()


PROCESSES = {
    "foreign": "is not valid under",
    "other name": "is for 'w0', not for 'w1'",
    "unlisted": f"does not admit worker '{STRANGER}'; have it listed there in workers.txt",
}


@pytest.mark.parametrize("case", PROCESSES)
def test_refused_process_says_so_in_one_line(
    case: str, place: str, ours: Folder, foreign: Folder, tmp_path: Path
) -> None:
    """A `gepf-worker` that is refused ends with exit code 2 and one line that says why."""
    options = {
        "foreign": [*foreign.options("w0")[2:], "--tls-ca", str(ours.path / "ca.pem")],
        "other name": [*ours.options("w0"), "--name", "w1"],
        "unlisted": ours.options(STRANGER),
    }[case]
    seen: list[str] = []
    with open_coordinator([place], (), ours.listening) as bus:
        bus.watch(keys.of_worker("*", "offer/**"), lambda key, _: seen.append(key))
        process = start(work_instantly, "--connect", place, *options, log=tmp_path / "log")
        process.join(300.0)
        assert process.exitcode == 2
    lines = (tmp_path / "log").read_text().splitlines()
    progress = (
        "loading",
        "connecting to",
        "connected to",
        f"{place} is gone",
    )  # a busy machine may lose a link
    prefixes = tuple(f"gepf-worker: {doing}" for doing in progress)
    (reason,) = (line for line in lines if not line.startswith(prefixes))
    assert PROCESSES[case] in reason
    assert seen == []
