"""The demo: from nothing to a table and pictures, again and again."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from rich.console import Console

from common.body import BodyModel
from common.errors import InputError
from common.frame import SubjectFrame
from common.refinement import Refined
from common.settings import RefineSettings
from coordinator.commands.console.progress import Show, show_on
from coordinator.commands.demo import make_room, run_demo, tabulate
from coordinator.pool.options import Pool
from coordinator.pool.statistics import PoolStatistics
from coordinator.results.evaluation import Errors
from coordinator.synthesis.scenes.arm import MOVING
from tests.support.refined import Ready

FRAMES = 4


class StillRefiner:
    """Leaves every particle where it is; the first is the likeliest."""

    statistics = PoolStatistics()

    def publish(self, subject: SubjectFrame) -> None:
        """Look at nothing."""

    def send_ahead(self, subject: SubjectFrame) -> None:
        """Have no use for it."""

    def submit(self, model: BodyModel, poses: NDArray[np.float64], settings: RefineSettings) -> Ready:
        """No descent."""
        assert settings.noise_depth == pytest.approx(0.15, rel=0.05)  # as measured
        assert model.dof_names[-1] == "r_elbow_flexion"
        return Ready(
            Refined(poses.copy(), -np.arange(len(poses), dtype=np.float64), np.full(len(poses), 0.1))
        )


@contextmanager
def connect(pool: Pool, show: Show) -> Iterator[StillRefiner]:
    """Workers that do nothing."""
    assert pool == Pool(workers=2)
    show.say("two workers are there")
    yield StillRefiner()


def errors(angle_deg: float, best_deg: float, frames: int = 100) -> Errors:
    """Constant errors of two angles, huge in the first thirty frames."""
    start = np.where(np.arange(frames) < 30, 90.0, 0.0)[:, None]
    return Errors(
        frame=np.arange(frames),
        dof_names=("r_elbow_flexion", "r_shoulder_abduct"),
        angle_deg=start + angle_deg * np.array([1.0, 3.0]),
        best_angle_deg=start + best_deg * np.array([1.0, 3.0]),
        joint_m=np.zeros((frames, 0)),
    )


def test_the_demo_leaves_a_sequence_runs_and_pictures_and_makes_room_for_the_next(tmp_path: Path) -> None:
    """Both methods are tracked and drawn, the table has the four angles, and another demo can follow."""
    out, screen = tmp_path / "demo", io.StringIO()
    run_demo(out, show_on(Console(file=screen, width=150)), connect, frames=FRAMES)
    assert {p.name for p in out.iterdir()} == {"sequence", "gradient", "gepf"}
    assert len(list((out / "sequence" / "depth").iterdir())) == FRAMES
    for method in ("gradient", "gepf"):
        held = {p.name for p in (out / method).iterdir()}
        assert {"track.npz", "overlay.gif", "sheet.png", "hypotheses.png", "errors.png"} <= held
    table = screen.getvalue().splitlines()
    start = next(k for k, line in enumerate(table) if line.startswith("mean absolute error"))
    assert [line.split()[0] for line in table[start + 2 : start + 7]] == [*MOVING, "mean"]
    make_room(out)
    assert not list(out.iterdir())


def test_the_table_is_of_frames_after_the_wrong_start() -> None:
    """Constant errors come out as they are, to the right of their names, and the mean below."""
    lines = tabulate({"gradient": errors(40.0, 40.0), "gepf": errors(2.0, 1.0)})
    cells = [line.split() for line in lines]
    assert cells[2] == ["r_elbow_flexion", "40.0", "2.0", "1.0"]
    assert cells[3] == ["r_shoulder_abduct", "120.0", "6.0", "3.0"]
    assert cells[4] == ["mean", "80.0", "4.0", "2.0"]
    assert len({len(line) for line in lines[1:5]}) == 1
    assert lines[5] == "gradient: lost from frame 0 on; gepf: not lost"


def test_a_folder_with_other_things_is_left_alone(tmp_path: Path) -> None:
    """The demo removes only what a demo wrote."""
    (tmp_path / "gepf").mkdir()
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(InputError, match="choose another --out"):
        make_room(tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {"gepf", "thesis.tex"}
