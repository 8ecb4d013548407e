"""Endpoints of sessions: validity, need for encryption, and reasons for a refused connection.

Zenoh does not report why it refuses a connection, so the reason is found by a separate TLS handshake.
"""

from __future__ import annotations

import ipaddress
import re
import socket
import ssl
from contextlib import suppress

from gepf.common.errors import InputError
from gepf.common.transport.channels import ANSWER_S
from gepf.common.transport.credentials import MEND, Credentials

ENDPOINT = re.compile(r"(tcp|tls|udp|quic|ws|unixsock-stream)/\S+")
ENCRYPTED, LOCAL = "tls", "unixsock-stream"
LISTEN, CONNECT = "--listen", "--connect"
TLS_OPTIONS = "--tls-ca, --tls-cert and --tls-key"


def check_endpoint(option: str, endpoint: str, credentials: Credentials | None, *, insecure: bool) -> None:
    """InputError for an invalid endpoint, or one that does not fit the certificate.

    Beyond this host, everybody must have a certificate unless `insecure` is set: depth images show people.
    """
    if not ENDPOINT.fullmatch(endpoint) or (
        protocol_of(endpoint) != LOCAL and host_and_port(endpoint)[1] >= 2**16
    ):
        raise InputError(f"{option} '{endpoint}' is not an endpoint; give one such as tcp/127.0.0.1:7447")
    encrypted = protocol_of(endpoint) == ENCRYPTED
    if encrypted and credentials is None:
        raise InputError(f"{option} {endpoint} needs a certificate; add {TLS_OPTIONS}")
    if credentials is not None and not encrypted:
        raise InputError(f"{option} {endpoint} is not encrypted; with a certificate, give tls/HOST:PORT")
    if not (encrypted or insecure or is_loopback(endpoint)):
        danger = "accepts anyone" if option == LISTEN else "is not encrypted: anyone on the way can read"
        raise InputError(
            f"{option} {endpoint} {danger}; give tls/HOST:PORT with {TLS_OPTIONS} "
            "(gepf certificates makes them), or --insecure"
        )


def is_loopback(endpoint: str) -> bool:
    """Whether only programs of this host can connect."""
    if protocol_of(endpoint) == LOCAL:
        return True
    host, _ = host_and_port(endpoint)
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def protocol_of(endpoint: str) -> str:
    """The protocol of an endpoint: `tcp` of `tcp/localhost:7447`."""
    return endpoint.partition("/")[0]


def host_and_port(endpoint: str) -> tuple[str, int]:
    """Host, without the brackets of IPv6, and port; port 0 if it is missing."""
    address = re.split(r"[?#]", endpoint.partition("/")[2], maxsplit=1)[0]
    host, _, port = address.rpartition(":")
    return host.strip("[]"), int(port) if port.isascii() and port.isdigit() else 0


def why_refused(endpoint: str, credentials: Credentials | None) -> str | None:
    """Why an endpoint refuses the connection, as one line; None if it does not, or has no TLS."""
    protocol, (host, port) = protocol_of(endpoint), host_and_port(endpoint)
    if protocol not in ("tcp", ENCRYPTED):
        return None
    refusal: ssl.SSLError | None = None
    try:
        with (
            socket.create_connection((host, port), ANSWER_S) as link,
            context_for(credentials).wrap_socket(link, server_hostname=host) as encrypted,
            suppress(TimeoutError),
        ):
            encrypted.recv(1)  # a refusal of our certificate arrives after the handshake
    except ssl.SSLError as error:
        refusal = error
    except OSError:  # no server, or the network failed
        return None
    if protocol == "tcp":
        if refusal is not None and "ALERT" not in (refusal.reason or ""):
            return None
        return f"{endpoint} accepts only encrypted connections; give tls/HOST:PORT with {TLS_OPTIONS}"
    return None if refusal is None else describe_refusal(endpoint, credentials, refusal)


def describe_refusal(endpoint: str, credentials: Credentials | None, refusal: ssl.SSLError) -> str:
    """What is wrong with a certificate of either side of a TLS handshake, and the remedy."""
    if isinstance(refusal, ssl.SSLCertVerificationError):
        mend = "give its authority with --tls-ca, or connect by a host name in the certificate"
        return f"{endpoint} shows a certificate that is not valid here: {refusal.verify_message}; {mend}"
    if credentials is None:
        return f"{endpoint} refuses connections without a certificate; add {TLS_OPTIONS}"
    reason = (refusal.reason or "no reason given").lower().replace("_", " ")
    mend = "have a certificate signed by the authority there"
    return f"{endpoint} refuses {credentials.cert}: {reason}; {mend}, or {MEND}"


def context_for(credentials: Credentials | None) -> ssl.SSLContext:
    """A client with our certificate; without one, a client that trusts any server."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    if credentials is None:
        context.check_hostname = False
        context.verify_mode = ssl.CERT_NONE
    else:
        context.load_verify_locations(credentials.ca)
        context.load_cert_chain(credentials.cert, credentials.key)
    return context
