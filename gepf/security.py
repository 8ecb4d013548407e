"""Certificates for users of the library: the command line's rules, said in Python's words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from common.errors import InputError
from common.transport.session import Security
from coordinator.security.access import TlsFiles, choose_security

IN_PYTHON = {
    "--tls-ca, --tls-cert and --tls-key": "tls=TlsFiles(ca, cert, key)",
    "--tls-": "tls.",
    "--listen ": "listen=",
    "--connect ": "connect=",
    "--insecure": "insecure=True",
}


def secure(
    listen: str | None, connect: str | None, tls: TlsFiles | None = None, *, insecure: bool = False
) -> Security | None:
    """Certificate and access rules for these endpoints; InputError where they do not fit together."""
    with said_in_python():
        return choose_security(listen, connect, tls or TlsFiles(), insecure=insecure)


@contextmanager
def said_in_python(names: Mapping[str, str] = IN_PYTHON) -> Iterator[None]:
    """Have faults of the input name the library's arguments, where they name the command line's options."""
    try:
        yield
    except InputError as error:
        line = str(error)
        for option, name in names.items():
            line = line.replace(option, name)
        raise InputError(line) from error
