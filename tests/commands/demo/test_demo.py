"""The demo makes a table and pictures, and can be repeated."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from gepf.common.errors import InputError
from gepf.coordinator.commands.demo import FILTER, LONE, MARKER, make_room, run_demo, tabulate
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
    assert {p.name for p in out.iterdir()} == {f"sequence-{seed}" for seed in seeds} | runs | {MARKER}
    assert all(len(list((out / f"sequence-{seed}" / "depth").iterdir())) == FRAMES for seed in seeds)
    assert all((out / run / "track.npz").exists() for run in runs)
    assert f"tracking {len(runs)} runs; the first time, compiling" in screen.getvalue()
    drawn = {f"{LONE}-0", f"{FILTER}-0"}
    assert {run for run in runs if (out / run / "overlay.mp4").exists()} == drawn
    assert all((out / run / "sheet.png").exists() for run in drawn)
    table = screen.getvalue().splitlines()
    start = next(k for k, line in enumerate(table) if "one particle" in line and "gepf, 20" in line)
    rows = [line.split()[0] for line in table[start + 1 :]]
    assert rows[: len(seeds) + 1] == [*[scene] * len(seeds), "mean"]
    make_room(out, [])
    assert [path.name for path in out.iterdir()] == [MARKER]


def test_the_table_of_people_has_means_of_both_ways() -> None:
    """Of three people, one particle first."""
    screen, good, fair = io.StringIO(), (100.0, 1.0), (80.0, 5.0)
    Console(file=screen, width=150).print(
        tabulate("person", np.array([[good, fair], [fair, good], [good, good]]))
    )
    assert screen.getvalue().splitlines()[-1].split() == ["mean", *2 * ("93.3", "%", "(2.3", "cm)")]


def clone(folder: Path) -> Path:
    """A folder like a clone of this repository; returns a file of its history."""
    head = folder / ".git" / "HEAD"
    head.parent.mkdir(parents=True)
    head.write_text("ref: refs/heads/main\n")
    return head


@pytest.mark.parametrize("name", ["gepf", "gepf-0", "sequence-12"])
def test_a_folder_that_no_demo_made_stays(name: str, tmp_path: Path) -> None:
    """Also if it is all there is, has a name like those of the demo, and holds a clone."""
    head = clone(tmp_path / "src" / name)
    with pytest.raises(InputError, match=f"{name}' was not made by gepf demo; choose another --out"):
        run_demo(tmp_path / "src", Show(Console(quiet=True)))
    assert head.exists()
    assert [path.name for path in (tmp_path / "src").iterdir()] == [name]


def test_what_is_put_beside_a_demo_stays(tmp_path: Path) -> None:
    """Another demo replaces the folders of the first one, and refuses to replace one that is foreign."""
    make_room(tmp_path, ["gepf-0", "gepf-1"])
    for name in ("gepf-0", "gepf-1"):
        (tmp_path / name).mkdir()
    head, notes = clone(tmp_path / "gepf-2"), tmp_path / "notes.txt"
    notes.touch()
    make_room(tmp_path, ["gepf-0"])
    assert {path.name for path in tmp_path.iterdir()} == {"gepf-2", "notes.txt", MARKER}
    with pytest.raises(InputError, match="gepf-2' was not made by gepf demo"):
        make_room(tmp_path, ["gepf-0", "gepf-1", "gepf-2"])
    assert head.exists()
    assert notes.exists()
