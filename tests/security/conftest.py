"""Certificates and an encrypted endpoint for the tests of this room."""

from __future__ import annotations

import pytest

from tests.support.processes.certificates import Folder, free_port, make_folder


@pytest.fixture(scope="session")
def ours(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """The certificates of this run."""
    return make_folder(tmp_path_factory.mktemp("ours"))


@pytest.fixture(scope="session")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """Certificates with the same names, of another authority."""
    return make_folder(tmp_path_factory.mktemp("foreign"))


@pytest.fixture
def place() -> str:
    """An encrypted endpoint of this host."""
    return f"tls/127.0.0.1:{free_port()}"
