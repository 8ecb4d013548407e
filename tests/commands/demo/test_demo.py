"""The demo makes a table and pictures, and can be repeated."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from gepf.coordinator.commands.demo import FILTER, LONE, make_room, run_demo, tabulate
from gepf.coordinator.commands.progress import Show
from gepf.coordinator.pool.options import Pool
from tests.support.processes.programs import INSTANT

FRAMES = 4


@pytest.mark.parametrize(("scene", "seeds"), [("person", (0, 1)), ("arm", (0,))])
def test_a_scene_is_tracked_in_both_ways_and_compared(
    scene: str, seeds: tuple[int, ...], tmp_path: Path
) -> None:
    """Real processes over one pool: a run of each sequence and way, pictures of the first one."""
    out, screen = tmp_path / "demo", io.StringIO()
    show, pool = Show(Console(file=screen, width=150)), Pool(2, worker_command=INSTANT)
    run_demo(out, show, scene, pool, seeds, FRAMES)
    runs = {f"{way}-{seed}" for way in (LONE, FILTER) for seed in seeds}
    assert {p.name for p in out.iterdir()} == {f"sequence-{seed}" for seed in seeds} | runs
    assert all(len(list((out / f"sequence-{seed}" / "depth").iterdir())) == FRAMES for seed in seeds)
    assert all((out / run / "track.npz").exists() for run in runs)
    drawn = {f"{LONE}-0", f"{FILTER}-0"}
    assert {run for run in runs if (out / run / "overlay.mp4").exists()} == drawn
    assert all((out / run / "sheet.png").exists() for run in drawn)
    table = screen.getvalue().splitlines()
    start = next(k for k, line in enumerate(table) if "one particle" in line and "gepf, 20" in line)
    rows = [line.split()[0] for line in table[start + 1 :]]
    assert rows[: len(seeds) + 1] == [*[scene] * len(seeds), "mean"]
    make_room(out)
    assert not list(out.iterdir())


def test_the_table_of_people_has_means_of_both_ways() -> None:
    """Of three people, one particle first."""
    screen, good, fair = io.StringIO(), (100.0, 1.0), (80.0, 5.0)
    Console(file=screen, width=150).print(
        tabulate("person", np.array([[good, fair], [fair, good], [good, good]]))
    )
    assert screen.getvalue().splitlines()[-1].split() == ["mean", *2 * ("93.3", "%", "(2.3", "cm)")]
