"""Certificates for users of the library: the command line's rules, said in Python's words."""

from __future__ import annotations

from common.errors import InputError
from common.transport.session import Security
from coordinator.security.tls import TlsFiles, choose_security

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
    try:
        return choose_security(listen, connect, tls or TlsFiles(), insecure=insecure)
    except InputError as error:
        raise InputError(in_python(str(error))) from error


def in_python(line: str) -> str:
    """A line of the command line with the library's names in place of options."""
    for option, name in IN_PYTHON.items():
        line = line.replace(option, name)
    return line
