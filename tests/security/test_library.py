"""Certificates in the library: live input from a real publisher, encrypted, directly and through a router."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, nullcontext
from pathlib import Path
from typing import Any

import pytest

import gepf
from gepf.common.transport.opening import open_coordinator, open_router
from tests.support.people import SETTINGS, STANDING, shown
from tests.support.processes.certificates import Folder, secure_worker
from tests.support.processes.warm_processes import gepf as gepf_command
from tests.support.processes.warm_processes import started
from tests.support.refusals import refused
from tests.support.small_sequence import write_small_sequence

KEY = "gepf/live/coordinator/depth"


def files_of(folder: Folder, name: str) -> gepf.TlsFiles:
    """The three files of a certificate as strings."""
    own = folder.of(name)
    return gepf.TlsFiles(str(own.ca), str(own.cert), str(own.key))


@pytest.mark.parametrize("way", ["listen", "connect"])
def test_encrypted_live_input_arrives(way: str, place: str, ours: Folder, tmp_path: Path) -> None:
    """All frames of `gepf publish` with the coordinator's certificate, to the end; or through a router."""
    write_small_sequence(tmp_path / "seq", 3)
    playing = ["publish", str(tmp_path / "seq"), "--key", KEY, "--connect", place]
    ends: dict[str, Any] = {way: place}
    live = gepf.live(KEY, **ends, tls=files_of(ours, "coordinator"), idle_timeout=60.0)
    with (
        open_router([place], (), ours.routing) if way == "connect" else nullcontext(),
        started(gepf_command, *playing, *ours.options("coordinator"), log=tmp_path / "log"),
    ):
        numbers = [frame.number for frame in live]
    assert numbers[-1] == 2
    assert (live.counts["received"], live.counts["malformed"]) == (3, 0)


@pytest.mark.parametrize("way", ["listen", pytest.param("router", marks=pytest.mark.slow)])
def test_a_tracker_has_workers_with_certificates(way: str, place: str, ours: Folder) -> None:
    """Workers that come to a pool that listens, and workers behind a router."""
    workers: gepf.Pool | str = gepf.Pool(0, listen=place, worker_timeout=300.0) if way == "listen" else place
    with ExitStack() as stack:
        if way == "router":
            stack.enter_context(open_router([place], (), ours.routing))
        tracker = gepf.Tracker(
            gepf.Measures.of(1.82), SETTINGS, workers, STANDING, tls=files_of(ours, "coordinator")
        )
        stack.enter_context(tracker)
        stack.enter_context(secure_worker(place, ours, "w0"))
        assert tracker.track(shown("standing").frames[0]).particles == SETTINGS.filter.particles


def test_what_does_not_fit_is_refused_before_anything_is_opened(place: str, ours: Folder) -> None:
    """Another name's certificate, a plain endpoint, a key that is not allowed: one line each."""
    tls, pool = files_of(ours, "coordinator"), gepf.Pool(0, listen="tcp/127.0.0.1:1")
    mistakes: list[tuple[Callable[[], object], str]] = [
        (lambda: gepf.live(KEY, listen=place, tls=files_of(ours, "w0")), "is for 'w0', not for"),
        (lambda: gepf.live(KEY, listen="tcp/127.0.0.1:1", tls=tls), "listen=.* is not encrypted"),
        (lambda: gepf.live("camera/depth", listen=place, tls=tls), "use gepf/live/coordinator/camera/depth"),
        (lambda: gepf.Tracker(workers=place), r"^connect=.* needs a certificate; add tls=TlsFiles\("),
        (lambda: gepf.PeopleTracker(workers=pool, tls=tls), "^listen=.* is not encrypted"),
    ]
    for mistake, says in mistakes:
        with refused(says) as caught:
            mistake()
        assert "--" not in str(caught.value)


def test_a_client_that_is_not_let_in_reads_what_to_give(place: str, ours: Folder) -> None:
    """Without certificates at an encrypted port: messages name Python parameters, for input and workers."""
    plain = place.replace("tls/", "tcp/")
    with open_coordinator([place], (), ours.listening):
        for mistake in (lambda: list(gepf.live(KEY, connect=plain)), lambda: gepf.Tracker(workers=plain)):
            with pytest.raises(gepf.InputError, match=r"give tls/HOST:PORT with tls=TlsFiles\(") as caught:
                mistake()
            assert "--" not in str(caught.value)
