"""Interrupts while libraries load, and in code that hides them or treats them as an error."""

from __future__ import annotations

import signal
import subprocess
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import Any

import pytest

from gepf.common.errors import InputError
from gepf.coordinator.cli import main
from gepf.coordinator.commands.console import loading, noted_interrupts
from gepf.coordinator.pool.options import Pool
from tests.support.processes.programs import GEPF, wait_until
from tests.support.processes.warm_processes import end, start
from tests.support.stand_ins import Desk, desk, sequence, workers  # noqa: F401 fixtures


def load_for_ever(begun: Path) -> None:
    """Load a library that hides all exceptions."""
    with loading():
        begun.touch()
        while True:
            with suppress(BaseException):
                time.sleep(60.0)


def test_an_interrupt_while_libraries_load_ends_the_process_at_once(tmp_path: Path) -> None:
    """The signal ends the process, though the library hides exceptions and sleeps."""
    begun = tmp_path / "begun"
    process = start(load_for_ever, begun, log=tmp_path / "log")
    try:
        wait_until(begun.exists, 300.0)
        assert end(process) == -signal.SIGINT
    finally:
        process.kill()


def test_after_loading_interrupts_are_exceptions_again() -> None:
    """An ignored signal, as in a background job, stays ignored."""
    with loading():
        assert signal.getsignal(signal.SIGINT) is signal.SIG_DFL
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with loading(), noted_interrupts():
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)


def fail_to_load() -> None:
    """An interrupt within its loading."""
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        raise ImportError("initialization failed") from None


def swallow(number: signal.Signals = signal.SIGINT) -> None:
    """An interrupt within a callback that lets nothing through."""
    with suppress(KeyboardInterrupt):
        signal.raise_signal(number)


@pytest.mark.parametrize("happens", [fail_to_load, swallow])
def test_what_was_swallowed_or_turned_into_a_fault_is_raised_at_the_end(happens: Callable[[], None]) -> None:
    """As KeyboardInterrupt."""
    with pytest.raises(KeyboardInterrupt), noted_interrupts():
        happens()


def test_a_fault_without_an_interrupt_stays_what_it_is() -> None:
    """Also after an interrupt that was handled."""
    swallow()
    with pytest.raises(ImportError), noted_interrupts():
        raise ImportError("really missing")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_run_whose_interrupt_was_swallowed_ends_with_the_next_frame(
    desk: Desk, number: signal.Signals
) -> None:
    """Exit code 130, and the tracked frames are kept."""

    def connect_and_swallow(pool: Pool, report: Callable[[str], None]) -> AbstractContextManager[Any]:
        swallow(number)
        return desk.workers.connect(pool, report)

    assert main(["track", str(desk.sequence), "--out", str(desk.out)], connect_and_swallow) == 130
    *_, early, last = desk.said()
    assert last == "gepf: stopped"
    assert early.startswith("ended early with 1 of 5 frames in ")


def test_info_interrupted_between_its_facts_and_the_scene(sequence: Path) -> None:
    """When Open3D begins to load; the exit code is that of an interrupt."""
    command = [*GEPF, "info", str(sequence)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=300.0)
    assert process.returncode in (130, -signal.SIGINT)


def test_what_could_not_be_kept_after_an_interrupt_is_said(desk: Desk) -> None:
    """For example a full disk while results of an interrupted run are written: one line before the last."""

    def connect(*_: object) -> AbstractContextManager[Any]:
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            raise InputError("cannot write to the folder: no space is left")

    assert main(["track", str(desk.sequence), "--out", str(desk.out)], connect) == 130
    assert desk.said()[-2:] == ["gepf: cannot write to the folder: no space is left", "gepf: stopped"]
