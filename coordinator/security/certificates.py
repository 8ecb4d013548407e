"""Creates certificates: an authority, and a folder with those of coordinator, router and workers.

The certificate of a worker is valid for connecting only, so no worker can impersonate a coordinator or
router.
"""

from __future__ import annotations

import datetime as dt
import inspect
import ipaddress
import json
import os
import secrets
import socket
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
)
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from gepf.common.errors import InputError
from gepf.common.transport.credentials import Credentials
from gepf.common.transport.session import COORDINATOR, ROUTER, Security, session_settings
from gepf.coordinator.security.access import ROSTER, list_workers

CLOCK_SKEW = dt.timedelta(hours=1)  # by which the clock of another host may be slow
AUTHORITY = "ca"
USUAL_HOSTS = ("localhost", "127.0.0.1", "::1", COORDINATOR, ROUTER)


@dataclass(frozen=True, slots=True)
class Issued:
    """A certificate with its key."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey


def issue(name: str, hosts: Sequence[str], authority: Issued | None, lifetime: dt.timedelta) -> Issued:
    """A certificate for connecting, and with hosts also for listening; without an authority, a new authority.

    An authority cannot sign other authorities.
    """
    key, now = ec.generate_private_key(ec.SECP256R1()), dt.datetime.now(dt.UTC)
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    may = dict.fromkeys(inspect.signature(x509.KeyUsage).parameters, False) | {
        "key_cert_sign": authority is None,
        "digital_signature": authority is not None,
    }
    made = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject if authority is None else authority.certificate.subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - CLOCK_SKEW)
        .not_valid_after(now + lifetime)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .add_extension(x509.KeyUsage(**may), critical=True)
        .add_extension(
            x509.BasicConstraints(ca=authority is None, path_length=0 if authority is None else None),
            critical=True,
        )
    )
    if authority is not None:
        uses = [ExtendedKeyUsageOID.CLIENT_AUTH] + [ExtendedKeyUsageOID.SERVER_AUTH] * bool(hosts)
        signer = x509.AuthorityKeyIdentifier.from_issuer_public_key(authority.key.public_key())
        made = made.add_extension(x509.ExtendedKeyUsage(uses), critical=False)
        made = made.add_extension(signer, critical=False)
    if hosts:
        names = [host_name(host) for host in dict.fromkeys(hosts)]
        made = made.add_extension(x509.SubjectAlternativeName(names), critical=False)
    return Issued(made.sign(key if authority is None else authority.key, hashes.SHA256()), key)


def host_name(host: str) -> x509.GeneralName:
    """One host name or address."""
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        pass
    try:
        return x509.DNSName(host)
    except ValueError as error:
        raise InputError(f"'{host}' is no host name; give names or addresses, separated by commas") from error


def make_certificates(
    folder: Path, workers: tuple[str, ...], hosts: tuple[str, ...], days: int, mount: Path | None
) -> list[str]:
    """Create missing or expired certificates in a folder; returns the names with a new certificate.

    The folder also gets `workers.txt`, the admitted workers, and `router.json5`, the configuration of a Zenoh
    router that has the folder at `mount`.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make folder {folder}: {error.strerror}; choose another --out") from error
    lifetime = dt.timedelta(days=days)
    authority = find_authority(folder, lifetime)
    hosts = (*USUAL_HOSTS, socket.gethostname(), *hosts)
    listed = tuple(dict.fromkeys((*list_workers(folder / ROSTER), *workers)))
    hosts_of = {COORDINATOR: hosts, ROUTER: hosts, **dict.fromkeys(listed, ())}
    new = [name for name in hosts_of if not is_good(folder / f"{name}.pem", hosts_of[name], authority)]
    for name in new:
        save(folder, name, issue(name, hosts_of[name], authority, lifetime))
    (folder / ROSTER).write_text("".join(f"{worker}\n" for worker in listed))
    place = mount or folder.absolute()
    own = Credentials(place / f"{AUTHORITY}.pem", place / f"{ROUTER}.pem", place / f"{ROUTER}.key")
    settings = session_settings("router", ["tls/0.0.0.0:7447"], [], Security(own, listed))
    (folder / "router.json5").write_text(json.dumps(settings, indent=1) + "\n")
    return new


def find_authority(folder: Path, lifetime: dt.timedelta) -> Issued:
    """The authority in the folder, or a new one if it is missing or expired."""
    certificate, key = folder / f"{AUTHORITY}.pem", folder / f"{AUTHORITY}.key"
    if certificate.exists() and not key.exists():
        raise InputError(f"{key} is missing, which {certificate} signs with; restore it or use a new folder")
    if certificate.exists():
        authority = Issued(read_certificate(certificate), read_key(key))
        if authority.certificate.not_valid_after_utc > dt.datetime.now(dt.UTC):
            return authority
    authority = issue(f"gepf {secrets.token_hex(4)}", (), None, lifetime)
    save(folder, AUTHORITY, authority)
    return authority


def is_good(path: Path, hosts: Sequence[str], authority: Issued) -> bool:
    """Whether a certificate exists, is not expired, is signed by this authority and has all hosts."""
    if not path.exists() or not path.with_suffix(".key").exists():
        return False
    certificate = read_certificate(path)
    ours = certificate.issuer == authority.certificate.subject
    if not ours or certificate.not_valid_after_utc <= dt.datetime.now(dt.UTC):
        return False
    held = [each.value for each in certificate.extensions if each.oid == x509.SubjectAlternativeName.oid]
    return set(map(host_name, hosts)) <= {name for names in held for name in names}


def read_certificate(path: Path) -> x509.Certificate:
    """Read a certificate; InputError if it is invalid."""
    try:
        return x509.load_pem_x509_certificate(path.read_bytes())
    except ValueError as error:
        raise InputError(f"{path} is not a certificate; remove it, or use a new folder") from error


def read_key(path: Path) -> ec.EllipticCurvePrivateKey:
    """Read a key; InputError if it is invalid."""
    try:
        key = load_pem_private_key(path.read_bytes(), password=None)
    except (ValueError, TypeError) as error:
        raise InputError(f"{path} is not a key; restore it, or use a new folder") from error
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise InputError(f"{path} is not a key that gepf certificates made; use a new folder")
    return key


def save(folder: Path, name: str, issued: Issued) -> None:
    """Write NAME.pem, and NAME.key, which only its owner can read."""
    path = folder / f"{name}.key"
    path.unlink(missing_ok=True)
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(issued.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    (folder / f"{name}.pem").write_bytes(issued.certificate.public_bytes(Encoding.PEM))
