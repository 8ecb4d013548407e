"""Several recordings over one pool, and their runs against truths; after Ctrl-C, and with certificates."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import shutil
import subprocess
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from gepf.common.errors import InputError
from gepf.coordinator.cli import main
from gepf.coordinator.commands.job import Job, read_list
from gepf.coordinator.commands.many import choose_runs, track_many
from gepf.coordinator.commands.progress import Show
from gepf.coordinator.commands.track import track
from gepf.coordinator.filters.methods import settings_for
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from gepf.coordinator.results.track import read_track
from tests.support.processes.certificates import free_port, make_folder
from tests.support.processes.place import recorded
from tests.support.processes.programs import INSTANT, in_thread, wait_until
from tests.support.processes.warm_processes import Workers, end, gepf, start, work_instantly
from tests.support.small_sequence import OPTIONS, write_small_sequence
from tests.support.stand_ins import Direct, StillWorkers, sequence, workers  # noqa: F401 fixtures


def copy_of(sequence: Path, name: str) -> Path:
    """A copy of the recording, beside it."""
    return Path(shutil.copytree(sequence, sequence.with_name(name)))


def write_truth(folder: Path) -> None:
    """Where the pelvis was."""
    positions = np.tile([0.0, 0.0, 2.0], (5, 1, 1))
    np.savez(folder / "truth.npz", joint_names=np.array(["pelvis"]), joint_positions=positions)


def small_job(recording: Path, out: Path, seed: int) -> Job:
    """A short `gepf track`, with a worker that starts at once."""
    settings = settings_for("gepf", "default", 6, 300, seed)
    return Job(recording, out, settings, Pool(2, worker_command=INSTANT), pictures=False)


def test_a_list_gives_a_run_each(tmp_path: Path) -> None:
    """Names come from folders and files; the lines of a list are relative to its folder, without comments."""
    (tmp_path / "walk").mkdir()
    (tmp_path / "list.txt").write_text("walk  # slowly\n\n# nothing\nsub/run.mat\n")
    runs = choose_runs(small_job(tmp_path, tmp_path, 0), read_list(tmp_path / "list.txt"))
    assert [each.folder.name for each in runs] == ["walk", "run"]
    assert runs[-1].sequence == tmp_path / "sub" / "run.mat"


@pytest.mark.parametrize(
    ("names", "says"),
    [
        (("a/walk", "b/walk"), "two recordings have the name 'walk'"),
        (("a/walk", "zenoh:camera"), "live input is tracked alone"),
    ],
)
def test_what_cannot_be_several_is_refused(tmp_path: Path, names: tuple[str, ...], says: str) -> None:
    """Equal names, and live input, before anything is read."""
    given = [name if ":" in name else str(tmp_path / name) for name in names]
    job = small_job(tmp_path, tmp_path, 0)
    with pytest.raises(InputError, match=says):
        choose_runs(job, [Path(each) for each in given])


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((), "there is nothing to track; give a recording, or --list FILE"),
        (("walk", "--index", "0"), "--index selects a recording of a list; add --list FILE"),
        (("walk", "--list", "list.txt"), "--list and walk both say what to track"),
        (("--list", "none.txt"), "cannot read none.txt"),
        (("--list", "list.txt", "--index", "2"), "--index 2 is beyond the end of the list; give 0 to 1"),
    ],
)
def test_a_wrong_choice_of_recordings_has_one_line(
    arguments: tuple[str, ...],
    says: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """What is missing, given twice, or beyond the end of the list; nothing is written."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "list.txt").write_text("walk\nrun\n")
    assert main(["track", *arguments, "--out", "runs"]) == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "runs").exists()


def test_a_task_tracks_one_recording_of_a_list_once(
    sequence: Path, tmp_path: Path, workers: StillWorkers, capsys: pytest.CaptureFixture[str]
) -> None:
    """--index gives the bytes of a run alone; again, it does nothing; other settings are refused."""
    for name in ("first", "second"):
        copy_of(sequence, name)
    (tmp_path / "list.txt").write_text(f"{sequence.with_name('first')}\n{sequence.with_name('second')}\n")
    chosen = ["track", "--list", str(tmp_path / "list.txt"), "--index", "1", "--out", str(tmp_path / "runs")]
    chosen.append("--no-pictures")
    assert main(chosen, workers.connect) == 0
    assert workers.track(sequence.with_name("second"), tmp_path / "alone") == 0
    run = tmp_path / "runs" / "second"
    assert [each.name for each in (tmp_path / "runs").iterdir()] == ["second"]
    assert (run / "track.npz").read_bytes() == (tmp_path / "alone" / "track.npz").read_bytes()
    summaries = [json.loads((each / "summary.json").read_text()) for each in (run, tmp_path / "alone")]
    assert summaries[0]["digest"] == summaries[1]["digest"]
    before = {each: each.stat().st_mtime_ns for each in run.iterdir()}
    capsys.readouterr()
    assert main(chosen, workers.connect) == 0
    assert "frames are in" in capsys.readouterr().err
    assert {each: each.stat().st_mtime_ns for each in run.iterdir()} == before
    assert main([*chosen, "--seed", "5"], workers.connect) == 2
    assert "was recorded with other options" in capsys.readouterr().err


def test_several_have_the_bytes_of_each_alone_and_one_fault_stops_no_other(
    sequence: Path, tmp_path: Path
) -> None:
    """Real processes that share a worker; the table has a line for each, also for the one that is refused.

    The exit code is the most severe one.
    """
    names = ("first", "second", "damaged")
    recordings = [copy_of(sequence, name) for name in names]
    (recordings[-1] / "depth" / "000000.png").write_bytes(b"no picture")
    jobs = [small_job(each, tmp_path / "runs" / each.name, seed) for seed, each in enumerate(recordings)]
    written = io.StringIO()
    show = Show(Console(file=written, width=300))
    assert track_many(jobs, show) == 2
    lines = written.getvalue().splitlines()
    table = lines[[line.strip().startswith("recording  ") for line in lines].index(True) :]
    assert [line.split()[0] for line in table[1:]] == list(names)  # though the damaged one ends first
    assert "exit code 2" in table[-1]
    assert not (tmp_path / "runs" / "damaged").exists()
    with (tmp_path / "runs" / "runs.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [Path(row["folder"]).name for row in rows] == list(names)
    assert [row["exit_code"] for row in rows][2] == "2"
    assert [row["frames"] for row in rows] == ["5", "5", ""]
    assert len({row["digest"] for row in rows}) == 3  # of another recording, another seed, and of none
    for job in jobs[:2]:
        out = tmp_path / "alone" / job.folder.name
        track(replace(job, out=out), show, ZenohRefiner)
        whole, single = (folder / "track.npz" for folder in (job.folder, out))
        assert whole.read_bytes() == single.read_bytes()


def test_a_terminal_shows_a_line_per_run(sequence: Path, tmp_path: Path) -> None:
    """While they run: its name, its frames, and its state; what it says stands above."""
    jobs = [small_job(copy_of(sequence, name), tmp_path / "runs" / name, 0) for name in ("first", "second")]
    written = io.StringIO()
    show = Show(Console(file=written, width=200, force_terminal=True))
    assert track_many(jobs, show) in {0, 3}
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", written.getvalue()).replace("\r", "\n")
    for name in ("first", "second"):
        assert re.search(rf"\d/\d.*\s{name}: .*(hypothes|looking)", text)
        assert re.search(rf"^{name}: .*frames", text, re.MULTILINE)


def test_workers_join_and_leave_during_a_list(sequence: Path, endpoint: str, tmp_path: Path) -> None:
    """The only worker is killed when a run has frames, and two join: all have the bytes of one alone."""
    recordings = [copy_of(sequence, f"walk{n}") for n in range(4)]
    jobs = [small_job(each, tmp_path / "runs" / each.name, 0) for each in recordings]
    jobs = [replace(job, pool=Pool(0, listen=endpoint)) for job in jobs]

    crew = Workers((endpoint,), tmp_path / "workers.log")

    def replace_worker(stop: threading.Event) -> None:
        while not any(recorded(job.folder) for job in jobs) and not stop.wait(0.01):
            pass
        crew.kill("first")
        crew.start("second")
        crew.start("third")

    show = Show(Console(file=io.StringIO()))
    with crew:
        crew.start("first")
        with in_thread(replace_worker):
            assert track_many(jobs, show) == 0
    track(replace(jobs[0], out=tmp_path / "alone"), show, Direct().connect)
    alone = (tmp_path / "alone" / "track.npz").read_bytes()
    assert [(job.folder / "track.npz").read_bytes() == alone for job in jobs] == [True] * 4
    seen = [json.loads((job.folder / "summary.json").read_text())["workers_seen"] for job in jobs]
    assert {"first"} < {name for names in seen for name in names} <= {"first", "second", "third"}


def test_runs_are_compared_with_their_own_truths_alone(
    sequence: Path,
    tmp_path: Path,
    workers: StillWorkers,
    capsys: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
) -> None:
    """--csv has one line per run, and names those without truth; a truth of other frames is refused."""
    known, other = copy_of(sequence, "known"), copy_of(sequence, "other")
    shutil.copy(other / "depth" / "000003.png", other / "depth" / "000000.png")
    for folder in (known, other):
        write_truth(folder)
    run, without = str(tmp_path / "a"), str(tmp_path / "b")
    assert workers.track(known, Path(run)) == workers.track(sequence, Path(without)) == 0
    capsys.readouterr()
    assert main(["evaluate", without, run, "--csv"]) == 0
    heads, *rows = capsys.readouterr().out.splitlines()
    assert heads.startswith("run,frames,")
    assert [row.split(",")[:2] for row in rows] == [[run, "5"]]
    assert f"{without} is left out: its sequence has no truth" in caplog.text
    assert main(["evaluate", run]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 5
    for asked, says in (
        ((run, "--truth", str(other / "truth.npz")), "is for other, but"),
        ((run, without), "add --csv"),
        ((without, "--csv"), "has no truth for this body, or was moved; give --truth"),
    ):
        assert main(["evaluate", *asked]) == 2
        assert says in capsys.readouterr().err


def test_a_task_of_slurm_takes_the_line_of_its_number(tmp_path: Path) -> None:
    """The example's script, with a gepf that prints what it was called with."""
    (tmp_path / "gepf").write_text('#!/bin/sh\necho "$@"\n')
    (tmp_path / "gepf").chmod(0o755)
    script = Path(__file__).parents[3] / "examples" / "batch" / "slurm.sh"
    numbers = {"SLURM_ARRAY_TASK_ID": "2", "SLURM_CPUS_PER_TASK": "8"}
    done = subprocess.run(
        ["bash", script, "list.txt", "runs"],
        env={**os.environ, **numbers, "PATH": f"{tmp_path}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "track --list list.txt --index 2 --out runs --no-pictures --workers 8\n"


FRAMES, NAMES = 60, ("a", "b", "c")


def test_an_interrupt_ends_all_and_each_can_be_gone_on_with(tmp_path: Path) -> None:
    """Exit code 130 in seconds, running recordings keep their frames, and the same command does the rest."""
    write_small_sequence(tmp_path / "a", FRAMES)
    recordings = [tmp_path / "a", *(copy_of(tmp_path / "a", name) for name in NAMES[1:])]
    options = ["--out", str(tmp_path / "runs"), "--no-pictures", *OPTIONS]
    command = ["track", *map(str, recordings), *options, "--workers", "1"]
    said = tmp_path / "said"
    process = start(gepf, *command, log=said)
    wait_until(lambda: recorded(tmp_path / "runs" / NAMES[0]) > 1, 300.0)
    assert end(process) == 130
    assert said.read_text().splitlines()[-1] == "gepf: stopped"
    assert 0 < len(read_track(tmp_path / "runs" / NAMES[0]).frame) < FRAMES
    some = ["--frames", f"0:{FRAMES}"]
    again = start(gepf, *command, *some, "-q", log=said)
    again.join(300.0)
    assert again.exitcode in (0, 3)
    tracks = [read_track(tmp_path / "runs" / name) for name in NAMES]
    assert all(np.array_equal(track.pose, tracks[0].pose) for track in tracks)
    assert len(tracks[0].frame) == FRAMES


def test_a_batch_takes_workers_with_certificates(tmp_path: Path) -> None:
    """Two recordings through one TLS listener: a worker with a certificate works for both."""
    made, place = make_folder(tmp_path / "certificates"), f"127.0.0.1:{free_port()}"
    write_small_sequence(tmp_path / "a", 4)
    recordings = [tmp_path / "a", *(copy_of(tmp_path / "a", name) for name in NAMES[1:2])]
    options = ["--no-pictures", *OPTIONS, "--workers", "0", "--worker-timeout", "300"]
    shown = ["--listen", f"tls/{place}", *made.options("coordinator")]
    connect = ("--connect", f"tls/{place}")
    command = ["track", *map(str, recordings), "--out", str(tmp_path / "runs"), *options, *shown]
    batch = start(gepf, *command, log=tmp_path / "said")
    worker = start(work_instantly, *connect, "--name", "w0", *made.options("w0"), log=tmp_path / "worker")
    batch.join(300.0)
    worker.terminate()
    worker.join()
    said = (tmp_path / "said").read_text()
    assert batch.exitcode in (0, 3), said
    assert "w0 joined" in said
    assert [len(read_track(tmp_path / "runs" / name).frame) for name in NAMES[:2]] == [4, 4]
