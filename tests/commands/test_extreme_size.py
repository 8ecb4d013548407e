"""A size at the limits of what is sought is said at the end of a run, of one person or of several."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from coordinator.bodies.choice import choose_bodies
from coordinator.commands.console.progress import show_on
from coordinator.commands.options.choices import choose_settings
from coordinator.commands.options.job import Job
from coordinator.commands.people import track as people
from coordinator.commands.track import conclude
from coordinator.pool.options import Pool
from coordinator.pool.statistics import PoolStatistics
from coordinator.results.recording.recorded import Recorded
from coordinator.scene.scene import SceneChange
from coordinator.tracking.search.watch import Watch
from coordinator.tracking.starting.measuring import LARGEST, SMALLEST, Measured, Shown
from coordinator.tracking.starting.start import no_start
from coordinator.tracking.state import TrackerState, take_checkpoint

START = no_start(choose_bodies(None, "default"))


def recorded_of(measured: Measured | None) -> Recorded:
    """A run without frames after which a person is known to be of this size."""
    checkpoint = take_checkpoint(
        None, None, None, np.random.default_rng(0), SceneChange(), Watch(), None, measured
    )
    return Recorded({}, [], TrackerState(START, checkpoint), PoolStatistics(), 0.0, 0, 0)


def said_at_the_end(measured: Measured | None) -> tuple[str, str]:
    """What is said of one person, and where several were asked for."""
    one, several = io.StringIO(), io.StringIO()
    recorded = recorded_of(measured)
    job = Job(Path("in"), Path("out"), choose_settings("gepf", "default", 6, 300, 0), Pool(1), people=2)
    conclude(recorded, show_on(Console(file=one, width=300)))
    people.conclude({2: recorded}, job, show_on(Console(file=several, width=300)))
    return one.getvalue(), several.getvalue()


@pytest.mark.parametrize("size", [SMALLEST, LARGEST])
def test_an_extreme_size_is_said(size: tuple[float, float]) -> None:
    """With the measures, and of several people whose they are."""
    upright = Shown(np.zeros(1), np.array([1000.0]), 10.0)
    measured = Measured.guessed(size[0], 1.0).after(upright, 0.0)
    one, several = said_at_the_end(measured)
    assert f"the body came out {size[0]:.2f} m tall" in one
    assert f"person 2: the body came out {size[0]:.2f} m tall" in several
    assert "--model" in one
    assert "--model" not in several  # which refuses it


@pytest.mark.parametrize("measured", [None, Measured.guessed(1.7, 1.0)])
def test_nothing_is_said_of_usual_people_and_of_others(measured: Measured | None) -> None:
    """Nor of a body whose size is not sought."""
    assert not any("came out" in said for said in said_at_the_end(measured))
