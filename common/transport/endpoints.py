"""Endpoints: where a session listens or connects to, and which of them may go without encryption."""

from __future__ import annotations

import ipaddress
import re

from common.errors import InputError
from common.transport.credentials import Credentials

ENDPOINT = re.compile(r"(tcp|tls|udp|quic|ws|unixsock-stream)/\S+")
ENCRYPTED, LOCAL = "tls", "unixsock-stream"
TLS_OPTIONS = "--tls-ca, --tls-cert and --tls-key"


def check_endpoint(option: str, endpoint: str, credentials: Credentials | None) -> None:
    """InputError for what is no endpoint, and where endpoint and certificate do not belong together."""
    if not ENDPOINT.fullmatch(endpoint):
        raise InputError(f"{option} '{endpoint}' is no endpoint; give one such as tcp/127.0.0.1:7447")
    encrypted = protocol_of(endpoint) == ENCRYPTED
    if encrypted and credentials is None:
        raise InputError(f"{option} {endpoint} needs a certificate; add {TLS_OPTIONS}")
    if credentials is not None and not encrypted:
        raise InputError(f"{option} {endpoint} is not encrypted; with a certificate, give tls/HOST:PORT")


def check_listening(endpoint: str, credentials: Credentials | None, *, insecure: bool) -> None:
    """InputError for a place where strangers could come in."""
    check_endpoint("--listen", endpoint, credentials)
    if credentials is None and not insecure and not is_loopback(endpoint):
        raise InputError(
            f"--listen {endpoint} lets everyone in who can reach it; give tls/HOST:PORT with {TLS_OPTIONS} "
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
    """What an endpoint speaks: `tcp` of `tcp/localhost:7447`."""
    return endpoint.partition("/")[0]


def host_and_port(endpoint: str) -> tuple[str, int]:
    """Host, without the brackets of IPv6, and port; port 0 where there is none."""
    address = re.split(r"[?#]", endpoint.partition("/")[2], maxsplit=1)[0]
    host, _, port = address.rpartition(":")
    return host.strip("[]"), int(port) if port.isascii() and port.isdigit() else 0
