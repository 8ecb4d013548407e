"""The renewal of certificates: when the command renews what, and programs that run meanwhile."""

from __future__ import annotations

import datetime as dt
import shutil
import ssl
import time
from contextlib import nullcontext
from pathlib import Path

import pytest
from cryptography import x509

from gepf.common.errors import InputError
from gepf.common.transport.credentials import Credentials, check_holder, holder_of
from gepf.common.transport.endpoints import host_and_port
from gepf.common.transport.opening import open_router
from gepf.common.transport.session import Security
from gepf.coordinator.cli import main
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from gepf.coordinator.security.authority import find_authority
from gepf.coordinator.security.certificates import USUAL_HOSTS, make_certificates
from gepf.coordinator.security.issuing import issue, read_certificates, save, save_certificates
from tests.support.processes.certificates import WORKERS, Folder, listening, make_folder, secure_worker
from tests.support.processes.programs import wait_until
from tests.support.processes.serving import expected, refined_bytes

# A certificate begins an hour before it is made. Lifetimes that put its present age
PAST_TWO_THIRDS = dt.timedelta(minutes=20)  # at 3/4,
IN_THE_LAST_SIXTH = dt.timedelta(minutes=6)  # at 10/11,
OVER = dt.timedelta(minutes=-1)  # and after its end.


def aged_folder(path: Path, lifetime: dt.timedelta) -> Folder:
    """A folder with certificates for `w0` whose authority has this lifetime."""
    path.mkdir()
    save(path, "ca", issue("gepf aged", (), None, lifetime))
    make_certificates(path, ("w0",), (), 1, None)
    return Folder(path)


def test_an_authority_lives_for_years_and_its_certificates_for_days(tmp_path: Path) -> None:
    """Ten years and `--days`; nothing outlives its authority."""
    now = dt.datetime.now(dt.UTC)
    made = make_certificates(tmp_path, ("w0",), (), 30, None)
    ends = {
        name: read_certificates(tmp_path / f"{name}.pem")[0].not_valid_after_utc - now
        for name in ("ca", "coordinator", "w0")
    }
    assert ends["ca"] > dt.timedelta(days=3000)
    assert dt.timedelta(days=29) < ends["w0"] < dt.timedelta(days=31)
    assert dt.timedelta(days=19) < made.renew_from - now < dt.timedelta(days=21)
    short = issue("gepf short", (), None, dt.timedelta(days=2))
    leaf = issue("w0", (), short, dt.timedelta(days=30))
    assert leaf.certificate.not_valid_after_utc == short.certificate.not_valid_after_utc


def test_certificates_are_renewed_from_two_thirds_of_their_life(tmp_path: Path) -> None:
    """One that is old enough is renewed although it is valid; the others keep their bytes."""
    make_certificates(tmp_path, WORKERS, (), 1, None)
    authority, _ = find_authority(tmp_path)
    save(tmp_path, "w0", issue("w0", (), authority, PAST_TWO_THIRDS))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    check_holder(Folder(tmp_path).of("w0"), "w0")
    assert make_certificates(tmp_path, (), (), 1, None).new == ["w0"]
    changed = {path.name for path in tmp_path.iterdir() if before.get(path.name) != path.read_bytes()}
    assert changed == {"w0.pem", "w0.key"}


def test_a_successor_is_known_to_all_before_it_signs(tmp_path: Path) -> None:
    """At each step, hosts with the former files and hosts with the new ones trust each other."""
    folder = aged_folder(tmp_path / "folder", IN_THE_LAST_SIXTH)
    (signer, successor) = read_certificates(folder.path / "ca.pem")
    old = Path(shutil.copytree(folder.path, tmp_path / "old"))
    save_certificates(old / "ca.pem", [signer])
    first = Path(shutil.copytree(folder.path, tmp_path / "first"))
    check_holder(folder.of("w0", ca=old / "ca.pem"), "w0")  # the successor does not sign yet

    made = make_certificates(folder.path, (), (), 1, None)
    assert made.new == ["coordinator", "router", "w0"]
    assert read_certificates(folder.path / "ca.pem") == [successor, signer]
    assert read_certificates(folder.path / "w0.pem")[0].issuer == successor.subject
    check_holder(folder.of("w0", ca=first / "ca.pem"), "w0")
    check_holder(Folder(first).of("w0", ca=folder.path / "ca.pem"), "w0")
    assert make_certificates(folder.path, (), (), 1, None).new == []
    assert not (folder.path / "ca-next.key").exists()


AUTHORITIES = {
    "at two thirds": (PAST_TWO_THIRDS, "to every host; the successor signs from "),
    "in the last sixth": (IN_THE_LAST_SIXTH, "to every host; then run this command again"),
    "over": (OVER, "the authority expired on "),
}


@pytest.mark.parametrize("case", AUTHORITIES)
def test_a_line_says_what_to_do_with_an_old_authority(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """For folders of an authority that ends soon or has ended; certificates are valid in any case."""
    lifetime, says = AUTHORITIES[case]
    save(tmp_path, "ca", issue("gepf aged", (), None, lifetime))
    assert main(["certificates", "--out", str(tmp_path), "--workers", "w0"]) == 0
    assert says in capsys.readouterr().err
    check_holder(Folder(tmp_path).of("w0"), "w0")
    assert len(read_certificates(tmp_path / "ca.pem")) == (1 if case == "over" else 2)


def test_a_successor_waits_for_the_last_sixth(tmp_path: Path) -> None:
    """However often the command runs before, the authority signs, and ca.pem stays as it is."""
    folder = aged_folder(tmp_path / "folder", PAST_TWO_THIRDS)
    before = (folder.path / "ca.pem").read_bytes()
    for _ in range(2):
        assert make_certificates(folder.path, (), (), 1, None).succession is not None
    assert (folder.path / "ca.pem").read_bytes() == before


def shown(place: str) -> x509.Certificate | None:
    """The certificate that an endpoint shows; None while it is being opened again."""
    try:
        text = ssl.get_server_certificate(host_and_port(place), timeout=10.0)
    except OSError:
        return None
    return x509.load_pem_x509_certificate(text.encode())


def renew(folder: Folder, listener: str) -> Credentials:
    """Renew the listener's certificate and that of `w1` by another authority, which is made known first."""
    authority = find_authority(folder.path)[0]
    successor = issue("gepf next", (), None, dt.timedelta(days=100))
    save_certificates(folder.path / "ca.pem", [authority.certificate, successor.certificate])
    for name, hosts in ((listener, USUAL_HOSTS), ("w1", ())):
        save(folder.path, name, issue(name, hosts, successor, dt.timedelta(days=1)))
    return folder.of(listener)


@pytest.mark.parametrize("listener", ["coordinator", "router"])
def test_a_running_listener_uses_a_renewed_certificate(listener: str, place: str, tmp_path: Path) -> None:
    """Of a new authority even: the run goes on, its worker comes back, and another with a new one joins."""
    folder = make_folder(tmp_path)
    routed = listener == "router"
    connected = Pool(0, connect=place, security=Security(folder.of("coordinator")), worker_timeout=300.0)
    with (
        open_router([place], (), folder.routing) if routed else nullcontext(),
        ZenohRefiner(connected) if routed else listening(place, folder) as refiner,
        secure_worker(place, folder, "w0"),
    ):
        assert refined_bytes(refiner, 0) == expected(0)
        new = renew(folder, listener)
        (certificate,) = read_certificates(new.cert)
        wait_until(lambda: shown(place) == certificate)
        assert refined_bytes(refiner, 1) == expected(1)
        with secure_worker(place, folder, "w1"):
            refiner.wait_for(2)
            assert refined_bytes(refiner, 2) == expected(2)
        assert refiner.statistics.workers_seen == WORKERS


def test_a_renewed_certificate_that_is_not_valid_is_not_used(
    place: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """One line says so; the former certificate stays in use."""
    folder = make_folder(tmp_path)
    with listening(place, folder) as refiner, secure_worker(place, folder, "w0"):
        assert refined_bytes(refiner, 0) == expected(0)
        before = shown(place)
        (tmp_path / "coordinator.pem").write_bytes(b"nothing")
        wait_until(lambda: "the renewed certificate is not in use" in caplog.text)
        assert shown(place) == before
        assert refined_bytes(refiner, 1) == expected(1)


@pytest.mark.slow
def test_a_run_outlives_its_certificates(place: str, tmp_path: Path) -> None:
    """Certificates of both sides end in mid-run, after they were renewed: the run and its worker go on."""
    folder, lifetime = make_folder(tmp_path), dt.timedelta(seconds=30)
    authority, _ = find_authority(tmp_path)
    for name, hosts in (("coordinator", USUAL_HOSTS), ("w0", ())):
        save(tmp_path, name, issue(name, hosts, authority, lifetime))
    end = time.monotonic() + lifetime.total_seconds()
    former = Path(shutil.copytree(tmp_path, tmp_path / "former"))
    with listening(place, folder) as refiner, secure_worker(place, folder, "w0"):
        assert refined_bytes(refiner, 0) == expected(0)
        assert make_certificates(tmp_path, (), (), 1, None).new == ["coordinator", "w0"]
        number = 1
        while time.monotonic() < end + 5.0:
            assert refined_bytes(refiner, number % 8) == expected(number % 8)
            number += 1
            time.sleep(0.1)
        with pytest.raises(InputError, match="certificate has expired"):
            holder_of(Folder(former).of("w0"))
        refiner.wait_for(1)
        assert refined_bytes(refiner, 0) == expected(0)
