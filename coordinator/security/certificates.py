"""A folder with certificates for a trial: authority, coordinator, router and workers."""

from __future__ import annotations

import datetime as dt
import json
import os
import socket
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
)

from common.errors import InputError
from common.transport.access import COORDINATOR, ROUTER
from common.transport.credentials import Credentials
from common.transport.session import Security, session_settings
from coordinator.security.authority import Holder, Signer, host_names, hosts_of, is_over, issue, new_authority
from coordinator.security.roster import ROSTER, list_workers, write_roster

AUTHORITY = "ca"
USUAL_HOSTS = ("localhost", "127.0.0.1", "::1", COORDINATOR, ROUTER)
ROUTER_FILE = "router.json5"
ROUTER_ENDPOINT = "tls/0.0.0.0:7447"


def make_certificates(
    folder: Path, workers: tuple[str, ...], hosts: tuple[str, ...], days: int, mount: Path | None
) -> list[str]:
    """Make what is missing or over in a folder; gives the names of who has a new certificate.

    The folder also gets `workers.txt`, the workers that are let in, and `router.json5`, what a Zenoh
    router is to be started with that sees the folder under `mount`.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make folder {folder}: {error.strerror}; choose another --out") from error
    lifetime = dt.timedelta(days=days)
    signer = find_authority(folder, lifetime)
    hosts = (*USUAL_HOSTS, socket.gethostname(), *hosts)
    listed = tuple(dict.fromkeys((*list_workers(folder / ROSTER), *workers)))
    holders = [Holder(COORDINATOR, hosts), Holder(ROUTER, hosts), *map(Holder, listed)]
    new = [holder for holder in holders if not is_good(folder, holder, signer)]
    for holder in new:
        save(folder, holder.name, *issue(holder, signer, lifetime))
    write_roster(folder / ROSTER, listed)
    (folder / ROUTER_FILE).write_text(router_settings(mount or folder.absolute(), listed))
    return [holder.name for holder in new]


def find_authority(folder: Path, lifetime: dt.timedelta) -> Signer:
    """The folder's authority, or a new one if there is none or it is over."""
    certificate, key = folder / f"{AUTHORITY}.pem", folder / f"{AUTHORITY}.key"
    if certificate.exists() and not key.exists():
        raise InputError(f"{key} is missing, which {certificate} signs with; put it back or use a new folder")
    if certificate.exists():
        signer = Signer(read_certificate(certificate), read_key(key))
        if not is_over(signer.certificate):
            return signer
    signer = new_authority(lifetime)
    save(folder, AUTHORITY, signer.certificate, signer.key)
    return signer


def is_good(folder: Path, holder: Holder, signer: Signer) -> bool:
    """Whether a certificate is there, is not over, is of this authority and holds all hosts."""
    path = folder / f"{holder.name}.pem"
    if not path.exists() or not path.with_suffix(".key").exists():
        return False
    certificate = read_certificate(path)
    ours = certificate.issuer == signer.certificate.subject
    return ours and not is_over(certificate) and hosts_of(certificate) >= set(host_names(holder.hosts))


def read_certificate(path: Path) -> x509.Certificate:
    """A certificate; InputError if it is none."""
    try:
        return x509.load_pem_x509_certificate(path.read_bytes())
    except ValueError as error:
        raise InputError(f"{path} is no certificate; remove it, or use a new folder") from error


def read_key(path: Path) -> ec.EllipticCurvePrivateKey:
    """A key as we make them; InputError if it is none."""
    try:
        key = load_pem_private_key(path.read_bytes(), password=None)
    except (ValueError, TypeError) as error:
        raise InputError(f"{path} is no key; put it back, or use a new folder") from error
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise InputError(f"{path} is not a key that gepf certificates made; use a new folder")
    return key


def save(folder: Path, name: str, certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> None:
    """Write NAME.pem, and NAME.key that only we may read."""
    path = folder / f"{name}.key"
    path.unlink(missing_ok=True)
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    (folder / f"{name}.pem").write_bytes(certificate.public_bytes(Encoding.PEM))


def router_settings(mount: Path, workers: tuple[str, ...]) -> str:
    """What a Zenoh router is started with: TLS on all addresses, access for these workers."""
    own = Credentials(mount / f"{AUTHORITY}.pem", mount / f"{ROUTER}.pem", mount / f"{ROUTER}.key")
    settings = session_settings("router", [ROUTER_ENDPOINT], [], Security(own, workers))
    return json.dumps(settings, indent=1) + "\n"
