"""A certificate with its key, and the authority that signed it.

A certificate is checked by a handshake in memory, which needs only Python's standard library.
"""

from __future__ import annotations

import ssl
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gepf.common.errors import InputError

MEND = "make a new one with gepf certificates"


@dataclass(frozen=True, slots=True)
class Credentials:
    """Three PEM files."""

    ca: Path  # certificate of the authority that must have signed everybody's certificate
    cert: Path
    key: Path


def read_credentials(
    ca: str | Path | None, cert: str | Path | None, key: str | Path | None
) -> Credentials | None:
    """Read all three or none; InputError otherwise, or for an unreadable file."""
    files = {"--tls-ca": ca, "--tls-cert": cert, "--tls-key": key}
    missing = [option for option, path in files.items() if path is None]
    if len(missing) == len(files):
        return None
    if ca is None or cert is None or key is None:
        raise InputError(f"{' and '.join(missing)} missing; give all of {', '.join(files)}, or none")
    credentials = Credentials(*(Path(file).absolute() for file in (ca, cert, key)))
    for option, path in zip(files, (credentials.ca, credentials.cert, credentials.key), strict=True):
        try:
            path.read_bytes()
        except OSError as error:
            raise InputError(f"{option} {path} cannot be read: {error.strerror}; give a PEM file") from error
    return credentials


def holder_of(credentials: Credentials) -> str:
    """The name in a certificate.

    InputError if it is not signed by its authority, has expired, or does not match its key.
    """
    server, client = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER), ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    client.check_hostname = False
    client.verify_mode = ssl.CERT_NONE
    server.verify_mode = ssl.CERT_REQUIRED
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    try:
        server.load_verify_locations(credentials.ca)
        for context in (server, client):
            context.load_cert_chain(credentials.cert, credentials.key)
        sides = (
            client.wrap_bio(to_client, to_server),
            server.wrap_bio(to_server, to_client, server_side=True),
        )
        for side in 2 * sides:
            with suppress(ssl.SSLWantReadError):
                side.do_handshake()
    except ssl.SSLError as error:
        raise InputError(
            f"{credentials.cert} with {credentials.key} is not valid under {credentials.ca}: {error}; {MEND}"
        ) from error
    subject: Any = (sides[1].getpeercert() or {}).get("subject", ())
    names: list[str] = [value for part in subject for name, value in part if name == "commonName"]
    if len(names) != 1:
        raise InputError(f"certificate {credentials.cert} must name one holder, not {len(names)}")
    return names[0]


def check_holder(credentials: Credentials, name: str) -> None:
    """InputError if the certificate has another name."""
    holder = holder_of(credentials)
    if holder != name:
        raise InputError(
            f"certificate {credentials.cert} is for '{holder}', not for '{name}'; give the right one"
        )
