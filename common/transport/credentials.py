"""Who we are to others: a certificate with its key, and the authority that signs everybody's.

What a certificate is good for is found out by presenting it to ourselves: a handshake in memory, which
needs no other library than Python's own.
"""

from __future__ import annotations

import ssl
from dataclasses import dataclass, fields
from pathlib import Path

from common.errors import InputError

MEND = "make a new one with gepf certificates"


@dataclass(frozen=True, slots=True)
class Credentials:
    """Three PEM files."""

    ca: Path  # the certificate of the authority; only who is signed by it comes in
    cert: Path
    key: Path


def read_credentials(
    ca: str | Path | None, cert: str | Path | None, key: str | Path | None
) -> Credentials | None:
    """All three or none; InputError otherwise, or for a file that cannot be read."""
    given = {"--tls-ca": ca, "--tls-cert": cert, "--tls-key": key}
    missing = [option for option, path in given.items() if path is None]
    if len(missing) == len(given):
        return None
    if ca is None or cert is None or key is None:
        raise InputError(f"{' and '.join(missing)} missing; give all of {', '.join(given)}, or none")
    credentials = Credentials(*(Path(file).absolute() for file in (ca, cert, key)))
    for field in fields(credentials):
        check_readable(f"--tls-{field.name}", getattr(credentials, field.name))
    return credentials


def check_readable(option: str, path: Path) -> None:
    """InputError for a file that is not there or not ours to read."""
    try:
        path.read_bytes()
    except OSError as error:
        raise InputError(f"{option} {path} cannot be read: {error.strerror}; give a PEM file") from error


def holder_of(credentials: Credentials) -> str:
    """The name that a certificate is made out to.

    InputError for one that is not signed by its authority, is over, or has another key.
    """
    server, client = contexts_of(credentials)
    try:
        subject = present(client, server)
    except ssl.SSLCertVerificationError as error:
        fault = f"is not valid under {credentials.ca}: {error.verify_message}"
        raise InputError(f"certificate {credentials.cert} {fault}; {MEND}") from error
    except ssl.SSLError as error:
        raise InputError(f"certificate {credentials.cert} cannot be used: {error.reason}; {MEND}") from error
    names = [value for part in subject for name, value in part if name == "commonName"]
    if len(names) != 1:
        raise InputError(f"certificate {credentials.cert} names {len(names)} holders, expected one; {MEND}")
    return names[0]


def check_holder(credentials: Credentials, name: str) -> None:
    """InputError unless the certificate is made out to this name."""
    holder = holder_of(credentials)
    if holder != name:
        raise InputError(
            f"certificate {credentials.cert} is for '{holder}', not for '{name}'; give the one for '{name}'"
        )


def contexts_of(credentials: Credentials) -> tuple[ssl.SSLContext, ssl.SSLContext]:
    """A server that asks for certificates of the authority, and a client that presents ours."""
    server = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    client = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    client.check_hostname = False
    client.verify_mode = ssl.CERT_NONE
    server.verify_mode = ssl.CERT_REQUIRED
    try:
        server.load_verify_locations(credentials.ca)
    except ssl.SSLError as error:
        raise InputError(f"--tls-ca {credentials.ca} is no certificate; give a PEM file") from error
    for context in (server, client):
        try:
            context.load_cert_chain(credentials.cert, credentials.key)
        except ssl.SSLError as error:
            raise InputError(
                f"--tls-cert {credentials.cert} and --tls-key {credentials.key} are no certificate "
                f"with its key: {error.reason}; give a pair of PEM files"
            ) from error
    return server, client


def present(client: ssl.SSLContext, server: ssl.SSLContext) -> tuple[tuple[tuple[str, str], ...], ...]:
    """The subject that the server sees of the client. Raises SSLError if it would not let it in."""
    there, back = ssl.MemoryBIO(), ssl.MemoryBIO()
    ours = client.wrap_bio(back, there)
    theirs = server.wrap_bio(there, back, server_side=True)
    for _ in range(2):
        for side in (ours, theirs):
            try:
                side.do_handshake()
            except ssl.SSLWantReadError:
                continue
    peer = theirs.getpeercert()
    return peer["subject"] if peer else ()  # type: ignore[return-value]
