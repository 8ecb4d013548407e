"""Which certificate a run or router shows, and whom it lets in."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from common.transport.access import COORDINATOR
from common.transport.credentials import check_holder, read_credentials
from common.transport.endpoints import check_endpoint, check_listening
from common.transport.session import Security
from coordinator.security.roster import read_roster


@dataclass(frozen=True, slots=True)
class TlsFiles:
    """Who we are to others: the certificate of who signs all, our own, and its key; all three or none."""

    ca: str | Path | None = None
    cert: str | Path | None = None
    key: str | Path | None = None


def choose_security(
    listen: str | None,
    connect: str | None,
    files: TlsFiles,
    *,
    holder: str = COORDINATOR,
    insecure: bool = False,
) -> Security | None:
    """Certificate and access rules for these endpoints; None for neither.

    InputError for a certificate that is not `holder`'s, and for listening where strangers could come in.
    """
    credentials = read_credentials(files.ca, files.cert, files.key)
    if listen is not None:
        check_listening(listen, credentials, insecure=insecure)
    if connect is not None:
        check_endpoint("--connect", connect, credentials)
    if credentials is None:
        return None
    check_holder(credentials, holder)
    return Security(credentials, None if listen is None else read_roster(credentials.ca))
