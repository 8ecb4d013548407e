"""The authority that signs the certificates of a folder, and its succession.

The first certificate in `ca.pem` is the authority that signs, with the key `ca.key`. From two thirds of its
life on, a successor follows, with the key `ca-next.key`, so that all hosts know it before it signs.
The successor takes over during the last sixth of that life, but not when it is made; then `ca.pem` holds the
former authority, too, until the next succession.
"""

from __future__ import annotations

import datetime as dt
import secrets
from pathlib import Path

from gepf.common.errors import InputError
from gepf.coordinator.security.issuing import (
    Issued,
    issue,
    read_certificates,
    read_key,
    renewal_time,
    save_certificates,
    save_key,
)

AUTHORITY = "ca"
LIFETIME = dt.timedelta(days=3650)


def find_authority(folder: Path) -> tuple[Issued, str | None]:
    """The authority that signs, made if there is none, and what users must know of its succession."""
    path, key = folder / f"{AUTHORITY}.pem", folder / f"{AUTHORITY}.key"
    next_key, now = folder / f"{AUTHORITY}-next.key", dt.datetime.now(dt.UTC)
    if not path.exists():
        return establish(path, key), None
    if not key.exists():
        raise InputError(f"{key}, the private key of {path}, is missing; restore it or use a new folder")
    certificates = read_certificates(path)
    signer = Issued(certificates[0], read_key(key))
    end, takeover = signer.certificate.not_valid_after_utc, takeover_time(signer)
    if now < renewal_time(signer.certificate):
        return signer, None
    if next_key.exists() and now >= takeover:
        successor = Issued(certificates[-1], read_key(next_key))
        save_key(key, successor.key)
        save_certificates(path, [successor.certificate, *([signer.certificate] if now < end else [])])
        next_key.unlink()
        return successor, f"a new authority, which {path} already held, took over; it signs from now on"
    if now >= end:
        new = establish(path, key)
        next_key.unlink(missing_ok=True)
        return new, f"the authority expired on {end:%Y-%m-%d}; copy the new {path} to every host"
    if not next_key.exists():
        successor = new_authority()
        save_key(next_key, successor.key)
        save_certificates(path, [signer.certificate, successor.certificate])
    says = f"the authority expires on {end:%Y-%m-%d}; copy {path}, which has its successor, to every host"
    when = (
        "then run this command again"
        if now >= takeover
        else f"the successor signs from {takeover:%Y-%m-%d} on"
    )
    return signer, f"{says}; {when}"


def takeover_time(signer: Issued) -> dt.datetime:
    """The time from which a successor signs: the last sixth of the life of an authority."""
    begin, end = signer.certificate.not_valid_before_utc, signer.certificate.not_valid_after_utc
    return end - (end - begin) / 6


def establish(path: Path, key: Path) -> Issued:
    """A new authority, alone."""
    new = new_authority()
    save_key(key, new.key)
    save_certificates(path, [new.certificate])
    return new


def new_authority() -> Issued:
    """A new authority with a name of its own."""
    return issue(f"gepf {secrets.token_hex(4)}", (), None, LIFETIME)
