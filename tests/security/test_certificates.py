"""Certificates are made, kept and renewed."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest

from common.errors import InputError
from common.transport.credentials import check_holder, holder_of
from coordinator.security.access import read_roster
from coordinator.security.certificates import make_certificates
from tests.support.processes.certificates import Folder, make_folder


def test_certificates_are_made_once(tmp_path: Path) -> None:
    """A second call keeps valid ones, adds new names, and renews for new hosts and after expiry."""
    first = make_certificates(tmp_path, ("w0",), (), 1, None)
    assert first == ["coordinator", "router", "w0"]
    assert make_certificates(tmp_path, ("w0",), (), 1, None) == []
    assert make_certificates(tmp_path, ("w1",), (), 1, None) == ["w1"]
    assert read_roster(tmp_path / "ca.pem") == ("w0", "w1")
    assert make_certificates(tmp_path, ("w1",), ("10.0.0.5", "far.example"), 1, None) == first[:2]
    (tmp_path / "w0.key").unlink()
    assert make_certificates(tmp_path, (), (), 1, None) == ["w0"]
    for name in ("ca", "coordinator", "router", "w0", "w1"):
        assert stat.S_IMODE((tmp_path / f"{name}.key").stat().st_mode) == 0o600
    for name in ("coordinator", "router", "w0", "w1"):
        check_holder(Folder(tmp_path).of(name), name)
    (tmp_path / "ca.key").unlink()
    with pytest.raises(InputError, match=r"ca\.key is missing"):
        make_certificates(tmp_path, (), (), 1, None)


def test_expired_certificates_are_renewed(tmp_path: Path) -> None:
    """Expired certificates are renewed; with the authority, all that it signed."""
    folder = make_folder(tmp_path)
    (tmp_path / "w0.pem").write_bytes((tmp_path / "old.pem").read_bytes())
    (tmp_path / "w0.key").write_bytes((tmp_path / "old.key").read_bytes())
    with pytest.raises(InputError, match="certificate has expired"):
        holder_of(folder.of("w0"))
    assert make_certificates(tmp_path, (), (), 1, None) == ["w0"]
    check_holder(folder.of("w0"), "w0")
