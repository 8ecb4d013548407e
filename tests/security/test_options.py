"""Endpoints and certificates that are refused before anything is opened; how certificates are made."""

from __future__ import annotations

import stat
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from gepf.common.errors import InputError
from gepf.common.transport.credentials import Credentials, check_holder, holder_of, read_credentials
from gepf.common.transport.endpoints import CONNECT, LISTEN, check_endpoint
from gepf.common.transport.session import Security
from gepf.coordinator.cli import main
from gepf.coordinator.security.access import (
    TlsFiles,
    choose_names,
    choose_security,
    read_coordinators,
    read_workers,
)
from gepf.coordinator.security.certificates import make_certificates
from tests.support.processes.certificates import Folder, make_folder
from tests.support.processes.programs import WORKER

EXPOSED = {LISTEN: "accepts anyone", CONNECT: "is not encrypted: anyone on the way can read"}
ENDPOINTS = {
    "tcp/127.0.0.1:7447": None,
    "tcp/[::1]:7447": None,
    "tcp/localhost:7447": None,
    "unixsock-stream//tmp/bus": None,
    "tcp/0.0.0.0:7447": EXPOSED,
    "tcp/[::]:7447": EXPOSED,
    "tcp/10.0.0.5:7447": EXPOSED,
    "tcp/camera.example:7447": EXPOSED,
    "udp/10.0.0.5:7447": EXPOSED,
    "ws/0.0.0.0:7447#iface=lo": EXPOSED,
    "tls/10.0.0.5:7447": dict.fromkeys(EXPOSED, "needs a certificate"),
    "7447": dict.fromkeys(EXPOSED, "is not an endpoint"),
}


@pytest.mark.parametrize("option", EXPOSED)
@pytest.mark.parametrize("endpoint", ENDPOINTS)
def test_links_beyond_this_host_need_tls(endpoint: str, option: str) -> None:
    """To listen and to connect: a link that leaves this host needs a certificate or --insecure."""
    faults = ENDPOINTS[endpoint]
    if faults is None:
        check_endpoint(option, endpoint, None, insecure=False)
        return
    with pytest.raises(InputError, match=faults[option]):
        check_endpoint(option, endpoint, None, insecure=False)
    if faults is EXPOSED:
        check_endpoint(option, endpoint, None, insecure=True)


ON_THE_WAY = ("--connect", "tcp/10.0.0.5:7447")
OPEN_LINES = (
    ("track", "recording", "--out", "{}/out", *ON_THE_WAY),
    ("track", "zenoh:camera/depth", "--out", "{}/out", *ON_THE_WAY),
    ("publish", "recording", "--key", "camera/depth", *ON_THE_WAY),
    ("view", "zenoh:camera/depth", *ON_THE_WAY),
    ("router", "--listen", "tcp/127.0.0.1:7447", *ON_THE_WAY),
)


@pytest.mark.parametrize("line", OPEN_LINES, ids=lambda line: " ".join(line[:2]))
def test_no_command_connects_in_the_open_unasked(
    line: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2 and one line that names certificates and --insecure, before anything is opened."""
    with ThreadPoolExecutor(1) as pool:  # `view` gives its thread the lowest priority; children inherit it
        assert pool.submit(main, [word.format(tmp_path) for word in line]).result() == 2
    err = capsys.readouterr().err.splitlines()[-1]
    assert "--connect tcp/10.0.0.5:7447 is not encrypted: anyone on the way can read" in err
    assert "or --insecure" in err


def test_no_worker_connects_in_the_open_unasked(capfd: pytest.CaptureFixture[str]) -> None:
    """`gepf-worker` ends with 2; with --insecure it goes on, here until it is not answered."""
    asked = [*WORKER, *ON_THE_WAY, "--check"]
    assert subprocess.run(asked, check=False, timeout=300.0).returncode == 2
    assert "is not encrypted: anyone on the way can read" in capfd.readouterr().err
    away = [*WORKER, "--connect", "tcp/nowhere.invalid:7447", "--check", "--insecure"]
    assert subprocess.run(away, check=False, timeout=300.0).returncode == 1
    assert "no answer at tcp/nowhere.invalid:7447" in capfd.readouterr().err


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
    with pytest.raises(InputError, match="KEY_VALUES_MISMATCH"):
        holder_of(Credentials(good.ca, good.cert, ours.of("w1").key))
    rubbish = tmp_path / "rubbish"
    rubbish.write_text("rubbish")
    with pytest.raises(InputError, match=r"is not valid under .*rubbish"):
        holder_of(Credentials(rubbish, good.cert, good.key))
    assert read_credentials(None, None, None) is None
    check_holder(good, "w0")


def test_names_of_workers() -> None:
    """A number or a list; the names of the other roles are reserved."""
    assert choose_names("2") == ("worker-0", "worker-1")
    assert choose_names("anna, ben") == ("anna", "ben")
    for bad in ("coordinator", "router", "a/b", "", "a,,b", "*"):
        with pytest.raises(InputError):
            choose_names(bad)


def test_coordinators_are_added_and_share_no_name(tmp_path: Path) -> None:
    """Further ones can only connect; none has the name of a worker or of the router."""
    assert make_certificates(tmp_path, ("w0",), (), 1, None, ("room",)).new[2:] == ["room", "w0"]
    assert make_certificates(tmp_path, (), (), 1, None, ("room-2",)).new == ["room-2"]
    assert read_coordinators(tmp_path / "ca.pem") == ("coordinator", "room", "room-2")
    for workers, coordinators in ((("room",), ()), ((), ("w0",)), ((), ("router",))):
        with pytest.raises(InputError, match="give every role its own name"):
            make_certificates(tmp_path, workers, (), 1, None, coordinators)


def test_certificates_are_made_once(tmp_path: Path) -> None:
    """A second call keeps valid ones, adds new names, and renews for new hosts and after expiry."""
    first = make_certificates(tmp_path, ("w0",), (), 1, None).new
    assert first == ["coordinator", "router", "w0"]
    assert make_certificates(tmp_path, ("w0",), (), 1, None).new == []
    assert make_certificates(tmp_path, ("w1",), (), 1, None).new == ["w1"]
    assert read_workers(tmp_path / "ca.pem") == ("w0", "w1")
    assert make_certificates(tmp_path, ("w1",), ("10.0.0.5", "far.example"), 1, None).new == first[:2]
    (tmp_path / "w0.key").unlink()
    assert make_certificates(tmp_path, (), (), 1, None).new == ["w0"]
    for name in ("ca", "coordinator", "router", "w0", "w1"):
        assert stat.S_IMODE((tmp_path / f"{name}.key").stat().st_mode) == 0o600
    for name in ("coordinator", "router", "w0", "w1"):
        check_holder(Folder(tmp_path).of(name), name)
    (tmp_path / "ca.key").unlink()
    with pytest.raises(InputError, match=r"ca\.key, the private key of .*, is missing"):
        make_certificates(tmp_path, (), (), 1, None)


def test_expired_certificates_are_renewed(tmp_path: Path) -> None:
    """Expired certificates are renewed; with the authority, all that it signed."""
    folder = make_folder(tmp_path)
    (tmp_path / "w0.pem").write_bytes((tmp_path / "old.pem").read_bytes())
    (tmp_path / "w0.key").write_bytes((tmp_path / "old.key").read_bytes())
    with pytest.raises(InputError, match="certificate has expired"):
        holder_of(folder.of("w0"))
    assert make_certificates(tmp_path, (), (), 1, None).new == ["w0"]
    check_holder(folder.of("w0"), "w0")
