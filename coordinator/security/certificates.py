"""Certificates for a trial: an authority, and a folder with those of coordinator, router and workers.

A worker's certificate is good for connecting only: no worker can pass for a coordinator or router.
"""

from __future__ import annotations

import datetime as dt
import ipaddress
import json
import os
import secrets
import socket
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

from common.errors import InputError
from common.transport.credentials import Credentials
from common.transport.session import COORDINATOR, ROUTER, Security, session_settings
from coordinator.security.access import ROSTER, list_workers, write_roster

CLOCK_SKEW = dt.timedelta(hours=1)  # that another host's clock may be behind ours
AUTHORITY = "ca"
USUAL_HOSTS = ("localhost", "127.0.0.1", "::1", COORDINATOR, ROUTER)
ROUTER_FILE = "router.json5"
ROUTER_ENDPOINT = "tls/0.0.0.0:7447"


@dataclass(frozen=True, slots=True)
class Signer:
    """An authority with its key."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey


@dataclass(frozen=True, slots=True)
class Holder:
    """Who a certificate is made out to; one with hosts may be listened on."""

    name: str
    hosts: tuple[str, ...] = ()


def new_authority(lifetime: dt.timedelta) -> Signer:
    """An authority that signs no other authorities; its name is its own."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = common_name(f"gepf {secrets.token_hex(4)}")
    may = x509.KeyUsage(
        digital_signature=False,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=True,
        crl_sign=True,
        encipher_only=False,
        decipher_only=False,
    )
    certificate = (
        builder(name, name, key.public_key(), lifetime)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(may, critical=True)
        .sign(key, hashes.SHA256())
    )
    return Signer(certificate, key)


def issue(
    holder: Holder, signer: Signer, lifetime: dt.timedelta
) -> tuple[x509.Certificate, ec.EllipticCurvePrivateKey]:
    """A certificate and its key; for connecting, and with hosts also for listening."""
    key = ec.generate_private_key(ec.SECP256R1())
    uses = [ExtendedKeyUsageOID.CLIENT_AUTH] + [ExtendedKeyUsageOID.SERVER_AUTH] * bool(holder.hosts)
    authority = x509.AuthorityKeyIdentifier.from_issuer_public_key(signer.key.public_key())
    made = (
        builder(common_name(holder.name), signer.certificate.subject, key.public_key(), lifetime)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(x509.ExtendedKeyUsage(uses), critical=False)
        .add_extension(authority, critical=False)
    )
    if holder.hosts:
        made = made.add_extension(x509.SubjectAlternativeName(host_names(holder.hosts)), critical=False)
    return made.sign(signer.key, hashes.SHA256()), key


def builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, lifetime: dt.timedelta
) -> x509.CertificateBuilder:
    """What all certificates have in common."""
    now = dt.datetime.now(dt.UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - CLOCK_SKEW)
        .not_valid_after(now + lifetime)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
    )


def common_name(name: str) -> x509.Name:
    """A subject of a name alone."""
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def host_names(hosts: tuple[str, ...]) -> list[x509.GeneralName]:
    """Host names and addresses, each once."""
    return [host_name(host) for host in dict.fromkeys(hosts)]


def host_name(host: str) -> x509.GeneralName:
    """One host name or address."""
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        pass
    try:
        return x509.DNSName(host)
    except ValueError as error:
        raise InputError(f"'{host}' is no host name; give names or addresses between commas") from error


def is_over(certificate: x509.Certificate) -> bool:
    """Whether its time has passed."""
    return certificate.not_valid_after_utc <= dt.datetime.now(dt.UTC)


def hosts_of(certificate: x509.Certificate) -> set[x509.GeneralName]:
    """The hosts that it may be listened with on."""
    try:
        return set(certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value)
    except x509.ExtensionNotFound:
        return set()


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
