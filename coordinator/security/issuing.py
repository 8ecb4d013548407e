"""Certificates with their keys: signing, reading and writing them.

The certificate of a worker is valid for connecting only, so no worker can impersonate a coordinator or
router.
"""

from __future__ import annotations

import datetime as dt
import inspect
import ipaddress
import os
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

CLOCK_SKEW = dt.timedelta(hours=1)  # by which the clock of another host may be slow


@dataclass(frozen=True, slots=True)
class Issued:
    """A certificate with its key."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey


def issue(name: str, hosts: Sequence[str], authority: Issued | None, lifetime: dt.timedelta) -> Issued:
    """A certificate for connecting, and with hosts also for listening; without an authority, a new authority.

    An authority cannot sign other authorities. No certificate outlives its authority.
    """
    key, now = ec.generate_private_key(ec.SECP256R1()), dt.datetime.now(dt.UTC)
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    may = dict.fromkeys(inspect.signature(x509.KeyUsage).parameters, False) | {
        "key_cert_sign": authority is None,
        "digital_signature": authority is not None,
    }
    end = (
        now + lifetime
        if authority is None
        else min(now + lifetime, authority.certificate.not_valid_after_utc)
    )
    made = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject if authority is None else authority.certificate.subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - CLOCK_SKEW)
        .not_valid_after(end)
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
        raise InputError(f"'{host}' is not a host name; separate names or addresses by commas") from error


def renewal_time(certificate: x509.Certificate) -> dt.datetime:
    """The time from which a certificate is to be renewed: two thirds of its life."""
    begin, end = certificate.not_valid_before_utc, certificate.not_valid_after_utc
    return begin + (end - begin) * 2 / 3


def read_certificates(path: Path) -> list[x509.Certificate]:
    """Read the certificates of a file; InputError if there is none, or an invalid one."""
    try:
        return x509.load_pem_x509_certificates(path.read_bytes())
    except ValueError as error:
        raise InputError(f"{path} is not a certificate; remove it, or use a new folder") from error


def read_key(path: Path) -> ec.EllipticCurvePrivateKey:
    """Read a key; InputError if it is invalid."""
    try:
        key = load_pem_private_key(path.read_bytes(), password=None)
    except (ValueError, TypeError) as error:
        raise InputError(f"{path} is not a key; restore it, or use a new folder") from error
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise InputError(f"{path} was not made by gepf certificates; use a new folder")
    return key


def save(folder: Path, name: str, issued: Issued) -> None:
    """Write NAME.pem, and NAME.key, which only its owner can read."""
    save_key(folder / f"{name}.key", issued.key)
    save_certificates(folder / f"{name}.pem", [issued.certificate])


def save_key(path: Path, key: ec.EllipticCurvePrivateKey) -> None:
    """Replace a file by a key that only its owner can read."""
    replace_file(path, key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()), 0o600)


def save_certificates(path: Path, certificates: Sequence[x509.Certificate]) -> None:
    """Replace a file by certificates."""
    replace_file(path, b"".join(each.public_bytes(Encoding.PEM) for each in certificates), 0o644)


def replace_file(path: Path, content: bytes, mode: int) -> None:
    """Replace a file atomically, because a running program may read it at any time."""
    new = path.with_name(f"{path.name}.new")
    new.unlink(missing_ok=True)
    with os.fdopen(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
        file.write(content)
    new.replace(path)
