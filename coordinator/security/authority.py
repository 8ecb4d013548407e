"""An authority that signs certificates for a trial.

A worker's certificate is good for connecting only: nobody takes a worker for a coordinator or router.
"""

from __future__ import annotations

import datetime as dt
import ipaddress
import secrets
from dataclasses import dataclass

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from common.errors import InputError

CLOCK_SKEW = dt.timedelta(hours=1)  # that another host's clock may be behind ours


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
