"""The demo makes a table and pictures, and can be repeated."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from coordinator.commands.demo import (
    FILTER,
    LONE,
    demo_arm,
    demo_person,
    make_room,
    tabulate,
)
from coordinator.commands.progress import Show
from coordinator.pool.options import Pool
from coordinator.synthesis.scenes import ARM_DOFS
from coordinator.tracking.preparation import Unmoved
from tests.support.asked import Asked, unmoved
from tests.support.processes.programs import INSTANT
from tests.support.stand_ins import StandIn

FRAMES = 4


class StillRefiner(StandIn):
    """Leaves every particle where it is; the first is the likeliest."""

    def answer(self, asked: Asked) -> Unmoved:
        """No descent."""
        assert asked.settings.noise_depth == pytest.approx(0.15, rel=0.05)  # as measured
        assert asked.model.dof_names[-1] == "r_elbow_flexion"
        likelihood = -np.arange(len(asked.poses), dtype=np.float64)
        still = unmoved(asked.poses.copy(), covariance=asked.covariance)
        return Unmoved(replace(still, log_likelihood=likelihood))


@contextmanager
def connect(pool: Pool, show: Show) -> Iterator[StillRefiner]:
    """Workers that do nothing."""
    assert pool == Pool(workers=2)
    show.say("two workers are there")
    yield StillRefiner()


def test_the_demo_leaves_a_sequence_runs_and_pictures_and_makes_room_for_the_next(tmp_path: Path) -> None:
    """Both methods are tracked and drawn, the table has the four angles, and another demo can follow."""
    out, screen = tmp_path / "demo", io.StringIO()
    demo_arm(out, Show(Console(file=screen, width=150)), Pool(2), connect, frames=FRAMES)
    assert {p.name for p in out.iterdir()} == {"sequence", "gradient", "gepf"}
    assert len(list((out / "sequence" / "depth").iterdir())) == FRAMES
    for method in ("gradient", "gepf"):
        held = {p.name for p in (out / method).iterdir()}
        assert {"track.npz", "overlay.mp4", "sheet.png", "hypotheses.png", "errors.png"} <= held
    table = screen.getvalue().splitlines()
    start = next(k for k, line in enumerate(table) if "mean absolute error" in line)
    assert [line.split()[0] for line in table[start + 1 : start + 6]] == [*ARM_DOFS, "mean"]
    make_room(out)
    assert not list(out.iterdir())


def test_people_are_tracked_in_both_ways_and_compared(tmp_path: Path) -> None:
    """Real processes over one pool: a run of each person and way, pictures of the first person's."""
    out, screen = tmp_path / "demo", io.StringIO()
    demo_person(out, Show(Console(file=screen, width=150)), Pool(2, worker_command=INSTANT), (0, 1), 2)
    runs = {f"{way}-{seed}" for way in (LONE, FILTER) for seed in (0, 1)}
    assert {p.name for p in out.iterdir()} == {"sequence-0", "sequence-1", *runs}
    assert all((out / run / "track.npz").exists() for run in runs)
    assert {run for run in runs if (out / run / "overlay.mp4").exists()} == {f"{LONE}-0", f"{FILTER}-0"}
    table = screen.getvalue().splitlines()
    start = next(k for k, line in enumerate(table) if "joints within 10 cm" in line)
    assert [line.split()[0] for line in table[start + 1 : start + 4]] == ["person", "person", "mean"]
    assert "person 0" in table[start + 1]
    make_room(out)
    assert not list(out.iterdir())


def test_the_table_of_people_has_means_of_both_ways() -> None:
    """Of three people, one particle first."""
    screen, good, fair = io.StringIO(), (100.0, 1.0), (80.0, 5.0)
    Console(file=screen, width=150).print(tabulate(np.array([[good, fair], [fair, good], [good, good]])))
    assert screen.getvalue().splitlines()[-1].split() == ["mean", *2 * ("93.3", "%", "(2.3", "cm)")]
