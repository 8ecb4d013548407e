"""A folder with the certificates of an authority, coordinators, router and workers, and their renewal."""

from __future__ import annotations

import datetime as dt
import json
import socket
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cryptography import x509

from gepf.common.errors import InputError
from gepf.common.transport.credentials import Credentials
from gepf.common.transport.session import COORDINATOR, ROUTER, Security, session_settings
from gepf.coordinator.security.access import (
    COORDINATORS_FILE,
    WORKERS_FILE,
    check_worker,
    list_names,
    read_coordinators,
)
from gepf.coordinator.security.authority import AUTHORITY, find_authority
from gepf.coordinator.security.issuing import Issued, host_name, issue, read_certificates, renewal_time, save

USUAL_HOSTS = ("localhost", "127.0.0.1", "::1", COORDINATOR, ROUTER)


@dataclass(frozen=True, slots=True)
class Made:
    """The names with a new certificate, and what users must know."""

    new: list[str]
    renew_from: dt.datetime  # time from which the first certificate is to be renewed
    succession: str | None  # of the authority


def make_certificates(
    folder: Path,
    workers: tuple[str, ...],
    hosts: tuple[str, ...],
    days: int,
    mount: Path | None,
    coordinators: tuple[str, ...] = (),
) -> Made:
    """Create the certificates of a folder that are missing, or past two thirds of their lifetime.

    The folder also gets `workers.txt` and `coordinators.txt`, which list who is admitted, and `router.json5`,
    the configuration of a Zenoh router that finds the folder at `mount`. Coordinators other than
    `coordinator` can only connect. InputError if a name has two roles.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make folder {folder}: {error.strerror}; choose another --out") from error
    authority, succession = find_authority(folder)
    hosts = (*USUAL_HOSTS, socket.gethostname(), *hosts)
    listed = tuple(dict.fromkeys(map(check_worker, (*list_names(folder / WORKERS_FILE), *workers))))
    admitted = tuple(dict.fromkeys((*read_coordinators(folder / f"{AUTHORITY}.pem"), *coordinators)))
    if several := sorted({*admitted, ROUTER, AUTHORITY} & {*listed} | {*admitted} & {ROUTER, AUTHORITY}):
        raise InputError(f"the name '{several[0]}' is used for two roles; give every role its own name")
    hosts_of = {COORDINATOR: hosts, ROUTER: hosts, **dict.fromkeys((*admitted[1:], *listed), ())}
    new = [name for name in hosts_of if not is_good(folder / f"{name}.pem", hosts_of[name], authority)]
    for name in new:
        save(folder, name, issue(name, hosts_of[name], authority, dt.timedelta(days=days)))
    for file, names in ((WORKERS_FILE, listed), (COORDINATORS_FILE, admitted)):
        (folder / file).write_text("".join(f"{name}\n" for name in names))
    place = mount or folder.absolute()
    own = Credentials(place / f"{AUTHORITY}.pem", place / f"{ROUTER}.pem", place / f"{ROUTER}.key")
    settings = session_settings("router", ["tls/0.0.0.0:7447"], [], Security(own, listed, admitted))
    (folder / "router.json5").write_text(json.dumps(settings, indent=1) + "\n")
    leaves = [read_certificates(folder / f"{name}.pem")[0] for name in hosts_of]
    return Made(new, min(map(renewal_time, leaves)), succession)


def is_good(path: Path, hosts: Sequence[str], authority: Issued) -> bool:
    """Whether a certificate exists, need not be renewed, is signed by this authority and has all hosts."""
    if not path.exists() or not path.with_suffix(".key").exists():
        return False
    certificate: x509.Certificate = read_certificates(path)[0]
    ours = certificate.issuer == authority.certificate.subject
    if not ours or renewal_time(certificate) <= dt.datetime.now(dt.UTC):
        return False
    held = [each.value for each in certificate.extensions if each.oid == x509.SubjectAlternativeName.oid]
    return set(map(host_name, hosts)) <= {name for names in held for name in names}
